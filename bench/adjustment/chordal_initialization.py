# SPDX-License-Identifier: Apache-2.0
"""A start for pose adjustment from the constraints alone, where the given poses are too far off.

Chordal relaxation (Carlone et al., "Initialization techniques for 3D SLAM", 2015). In the plane it
is two linear least squares problems in complex numbers: headings r = exp(i theta) that minimise the
errors of r_b = r_a exp(i theta_ab), without the constraint |r| = 1; then, for these headings,
positions t that minimise the errors of t_b = t_a + r_a t_ab. Neither depends on a start, so there
is no local minimum.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.linalg import splu

from cartoloop.arrays import BoolArray, FloatArray, IntArray
from cartoloop.global_slam.pose_adjustment import constraint_ends, held_of
from cartoloop.global_slam.pose_graph import PoseGraph
from cartoloop.sensor.pose import wrap_angles

ComplexArray = NDArray[np.complex128]

_LEAST_WEIGHT = 1e-12
"""Least weight of a constraint, as a share of the largest: it keeps the system regular where only
constraints of zero weight connect vertices."""


def initialize_from_constraints(graph: PoseGraph) -> None:
    """Replace the poses of a graph by estimates from its constraints, in place.

    Fixed vertices keep their poses, and so does the first vertex of each connected part without a
    fixed one. There is no robust loss: not for graphs with many false loop closures.
    """
    if graph.num_constraints == 0:
        return
    vertex_a, vertex_b = constraint_ends(graph)
    poses = np.concatenate((graph.submap_poses, graph.node_poses))
    held = held_of(graph)
    measured = graph.relative_poses
    turns = np.exp(1j * measured[:, 2])
    headings = np.exp(1j * poses[:, 2])
    headings = _propagate(
        vertex_a, vertex_b, turns, np.zeros_like(turns), graph.informations[:, 2, 2], headings, held
    )
    headings /= np.maximum(np.abs(headings), np.finfo(float).tiny)
    offsets = headings[vertex_a] * (measured[:, 0] + 1j * measured[:, 1])
    weights = 0.5 * (graph.informations[:, 0, 0] + graph.informations[:, 1, 1])
    positions = poses[:, 0] + 1j * poses[:, 1]
    positions = _propagate(
        vertex_a, vertex_b, np.ones_like(turns), offsets, weights, positions, held
    )
    poses = np.column_stack((positions.real, positions.imag, wrap_angles(np.angle(headings))))
    graph.submap_poses[:] = poses[: graph.num_submaps]
    graph.node_poses[:] = poses[graph.num_submaps :]


def _propagate(
    vertex_a: IntArray,
    vertex_b: IntArray,
    factors: ComplexArray,
    offsets: ComplexArray,
    weights: FloatArray,
    values: ComplexArray,
    held: BoolArray,
) -> ComplexArray:
    """Return x that minimises sum w |x_b - f x_a - o|^2, with the values of held vertices kept."""
    free = np.flatnonzero(~held)
    if free.size == 0:
        return values
    count, num_vertices = vertex_a.size, values.size
    root = np.sqrt(np.maximum(weights, _LEAST_WEIGHT * weights.max(initial=1.0)))
    lines = np.arange(count)
    jacobian = coo_matrix(
        (
            np.concatenate((root.astype(np.complex128), -root * factors)),
            (np.concatenate((lines, lines)), np.concatenate((vertex_b, vertex_a))),
        ),
        shape=(count, num_vertices),
    ).tocsc()
    right = root * offsets - jacobian[:, held] @ values[held]
    own = jacobian[:, free]
    adjoint = own.conj().T.tocsr()
    factor = splu(
        (adjoint @ own).tocsc(),
        permc_spec="MMD_AT_PLUS_A",
        diag_pivot_thresh=0.0,
        options={"SymmetricMode": True},
    )
    result = values.copy()
    result[free] = factor.solve(adjoint @ right)
    return result
