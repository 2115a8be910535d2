# SPDX-License-Identifier: Apache-2.0
"""A start for pose adjustment from the constraints alone, when the poses at hand are too far off.

Chordal relaxation (Carlone et al., "Initialization techniques for 3D SLAM", 2015), which in the
plane is two linear systems in complex numbers: headings r = exp(i theta) that come nearest to
r_b = r_a exp(i theta_ab), their length of one left aside; then, headings given, positions t nearest
to t_b = t_a + r_a t_ab. Both are solved whatever the start: no local minimum is in the way.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.linalg import splu

from cartoloop.global_slam.pose_adjustment import constraint_ends, held_of
from cartoloop.global_slam.pose_graph import PoseGraph
from cartoloop.sensor.pose import wrap_angles

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]
IntArray = NDArray[np.int64]

_LEAST_WEIGHT = (
    1e-12  # of the heaviest: what ties vertices that only weightless constraints connect
)


def initialize_from_constraints(graph: PoseGraph) -> None:
    """Replace the poses of a graph by what its constraints say, in place.

    Vertices stay that adjustment would hold: the fixed ones and the first of each part that is tied
    to none. All constraints are believed: not for graphs with many false loop closures.
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
    held: NDArray[np.bool_],
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
