# SPDX-License-Identifier: Apache-2.0
"""What the constraints of removed vertices say about the submaps that stay.

Vertices are marginalized out (Schur complements of the linearized problem), which leaves a dense
normal distribution of the poses of the submaps that stay: once of the whole graph, and once of the
constraints that stay. The difference is what would be lost.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cartoloop.arrays import BoolArray, FloatArray, IntArray
from cartoloop.global_slam.pose_graph import ConstraintKind, PoseGraph
from cartoloop.sensor.pose import wrap_angles

_HELD = 1e-6
"""Added to what is eliminated: vertices that nothing holds stay where they are."""


class Marginal(NamedTuple):
    """A normal distribution of submap poses, as a quadratic cost of their changes, map axes.

    Attributes
    ----------
    submaps : int64, shape (k,), which.
    information : float64, shape (3 k, 3 k).
    gradient : float64, shape (3 k,), of the cost at the present poses.
    """

    submaps: IntArray
    information: FloatArray
    gradient: FloatArray


def touching(graph: PoseGraph, kept_submaps: BoolArray, kept_nodes: BoolArray) -> BoolArray:
    """Return which constraints end at a removed vertex, shape (num_constraints,)."""
    first, second = _ends(graph)
    kept = np.concatenate((kept_submaps, kept_nodes))
    removed: BoolArray = ~(kept[first] & kept[second])
    return removed


def host_submaps(graph: PoseGraph, kept_submaps: BoolArray) -> IntArray:
    """Return of each node the first submap that stays and that it was inserted into, or -1."""
    hosts = np.full(graph.num_nodes, graph.num_submaps, dtype=np.int64)
    own = (graph.kinds == ConstraintKind.INTRA_SUBMAP) & _is_kept_submap(graph, kept_submaps)
    np.minimum.at(hosts, graph.index_b[own], graph.index_a[own])
    hosts[hosts == graph.num_submaps] = -1
    return hosts


def _is_kept_submap(graph: PoseGraph, kept_submaps: BoolArray) -> BoolArray:
    """Return which constraints start at a submap that stays."""
    is_submap = graph.kinds != ConstraintKind.NODE_TO_NODE
    kept = np.zeros(graph.num_constraints, dtype=bool)
    kept[is_submap] = kept_submaps[graph.index_a[is_submap]]
    return kept


def _ends(graph: PoseGraph) -> tuple[IntArray, IntArray]:
    """Return both vertices of each constraint: submaps, then nodes."""
    first_node = graph.num_submaps
    is_node = graph.kinds == ConstraintKind.NODE_TO_NODE
    return graph.index_a + first_node * is_node, graph.index_b + first_node


def lost_information(
    graph: PoseGraph, kept_submaps: BoolArray, kept_nodes: BoolArray, weights: FloatArray
) -> Marginal:
    """Return what is known about the submaps that stay only by the constraints of removed vertices.

    All nodes and the removed submaps are marginalized out of the whole graph, and the nodes that
    stay out of the constraints that stay: the difference.
    """
    removed = touching(graph, kept_submaps, kept_nodes)
    everything, everything_gradient = _reduced(
        graph, np.arange(graph.num_constraints), kept_submaps, weights
    )
    staying, staying_gradient = _reduced(graph, np.flatnonzero(~removed), kept_submaps, weights)
    return Marginal(
        np.flatnonzero(kept_submaps),
        everything - staying,
        everything_gradient - staying_gradient,
    )


def _reduced(
    graph: PoseGraph, chosen: IntArray, kept_submaps: BoolArray, weights: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return what constraints say about the submaps that stay: matrix and gradient of their cost.

    Parameters
    ----------
    chosen : the constraints.
    """
    from scipy.sparse import coo_matrix, identity  # slow to import
    from scipy.sparse.linalg import splu

    first, second = (ends[chosen] for ends in _ends(graph))
    poses = np.concatenate((graph.submap_poses, graph.node_poses))
    information, residual = _in_map(graph, chosen, poses, first, second)
    information *= weights[chosen][:, None, None]
    # Those to be removed first.
    order = np.argsort(
        np.concatenate((kept_submaps, np.zeros(graph.num_nodes, bool))), kind="stable"
    )
    place = np.empty(len(poses), dtype=np.int64)
    place[order] = np.arange(len(poses))
    gradient = np.zeros((len(poses), 3))
    axes, entries, values = np.arange(3), [], []
    by_second = np.broadcast_to(-np.eye(3), information.shape)
    ends = ((place[first], lever(poses[second] - poses[first])), (place[second], by_second))
    for row, left in ends:
        weighted = np.swapaxes(left, 1, 2) @ information
        np.add.at(gradient, row, (weighted @ residual[:, :, None])[:, :, 0])
        for col, right in ends:
            rows = np.broadcast_to(3 * row[:, None, None] + axes[:, None], information.shape)
            cols = np.broadcast_to(3 * col[:, None, None] + axes, information.shape)
            entries.append(np.stack((rows.ravel(), cols.ravel())))
            values.append((weighted @ right).ravel())
    size, cut = 3 * len(poses), 3 * int(len(poses) - np.count_nonzero(kept_submaps))
    everything = (np.concatenate(values), np.concatenate(entries, axis=1))
    hessian = coo_matrix(everything, (size, size)).tocsc()
    kept, across = hessian[cut:, cut:].toarray(), hessian[:cut, cut:].toarray()
    flat = gradient.reshape(-1)
    inner = hessian[:cut, :cut] + _HELD * identity(cut, format="csc")
    solved = splu(inner.tocsc()).solve(np.column_stack((across, flat[:cut])))
    kept -= across.T @ solved[:, :-1]
    return (kept + kept.T) / 2, flat[cut:] - across.T @ solved[:, -1]


def _in_map(
    graph: PoseGraph, chosen: IntArray, poses: FloatArray, first: IntArray, second: IntArray
) -> tuple[FloatArray, FloatArray]:
    """Return information and residual of constraints, map axes; see kernels/.../residuals.py."""
    rotation = turns(poses[first, 2])
    information = rotation @ graph.informations[chosen] @ np.swapaxes(rotation, 1, 2)
    measured = (rotation @ graph.relative_poses[chosen][:, :, None])[:, :, 0]
    residual = measured - (poses[second] - poses[first])
    residual[:, 2] = wrap_angles(residual[:, 2])
    return information, residual


def turns(angles: FloatArray) -> FloatArray:
    """Return matrices that turn x and y, shape (n, 3, 3)."""
    cos, sin, zero = np.cos(angles), np.sin(angles), np.zeros(len(angles))
    columns = (cos, -sin, zero, sin, cos, zero, zero, zero, zero + 1.0)
    return np.stack(columns, axis=1).reshape(-1, 3, 3)


def lever(offset: FloatArray) -> FloatArray:
    """Return how a point moves with a body: by its changes of pose, shape (n, 3, 3), map axes.

    Parameters
    ----------
    offset : of the point from the body's origin, shape (n, 2 or more) [m].
    """
    levers = np.broadcast_to(np.eye(3), (len(offset), 3, 3)).copy()
    levers[:, 0, 2], levers[:, 1, 2] = -offset[:, 1], offset[:, 0]
    return levers
