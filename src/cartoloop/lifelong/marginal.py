# SPDX-License-Identifier: Apache-2.0
"""What the constraints of removed vertices say about the submaps that stay.

Vertices are marginalized out (Schur complements of the linearized problem), which leaves a dense
normal distribution of the poses of the submaps that stay: once of the whole graph, and once of the
constraints that stay. The difference is what would be lost.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from cartoloop.arrays import BoolArray, FloatArray, IntArray
from cartoloop.global_slam.pose_graph import ConstraintKind, PoseGraph
from cartoloop.sensor.pose import wrap_angles

_HELD = 1e-6
"""Added to what is eliminated: vertices that nothing holds stay where they are."""


Sparse = Any
"""A sparse matrix of SciPy, which is imported where it is needed and has no types."""


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
    stay out of the constraints that stay: the difference. Nodes without a removed constraint say
    the same both times, and are left out.
    """
    removed = touching(graph, kept_submaps, kept_nodes)
    concerned = _concerned(graph, removed)
    first, _ = _ends(graph)
    ends = np.unique(first[concerned & (graph.kinds != ConstraintKind.NODE_TO_NODE)])
    submaps = ends[kept_submaps[ends]]
    before = _reduced(graph, np.flatnonzero(concerned), submaps, weights)
    after = _reduced(graph, np.flatnonzero(concerned & ~removed), submaps, weights)
    return Marginal(submaps, before[0] - after[0], before[1] - after[1])


def _concerned(graph: PoseGraph, removed: BoolArray) -> BoolArray:
    """Return the constraints of nodes that have a removed one, or that are linked to such nodes."""
    is_link = graph.kinds == ConstraintKind.NODE_TO_NODE
    index_a, index_b = graph.index_a, graph.index_b
    nodes = np.zeros(graph.num_nodes, dtype=bool)
    nodes[index_b[removed]] = True
    nodes[index_a[removed & is_link]] = True
    while True:
        linked = is_link & nodes[index_b]
        linked[is_link] |= nodes[index_a[is_link]]
        if nodes[index_a[linked]].all() and nodes[index_b[linked]].all():
            concerned: BoolArray = nodes[index_b] | linked
            return concerned
        nodes[index_a[linked]] = nodes[index_b[linked]] = True


def _reduced(
    graph: PoseGraph, chosen: IntArray, submaps: IntArray, weights: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return what constraints say about some submaps: matrix and gradient of their cost.

    Parameters
    ----------
    chosen : the constraints.
    submaps : k of them; the cost is of their 3 k coordinates.
    """
    from scipy.sparse import identity  # slow to import
    from scipy.sparse.linalg import splu

    first, second = (ends[chosen] for ends in _ends(graph))
    is_link = graph.kinds[chosen] == ConstraintKind.NODE_TO_NODE
    # Nodes without links do not know of each other: they are eliminated first, each by itself.
    rank = np.zeros(graph.num_submaps + graph.num_nodes, dtype=np.int64)
    rank[: graph.num_submaps] = rank[first[is_link]] = rank[second[is_link]] = 1
    rank[submaps] = 2
    used = np.unique(np.concatenate((first, second, submaps)))
    used = used[np.argsort(rank[used], kind="stable")]
    place = np.full(len(rank), -1)
    place[used] = np.arange(len(used))
    hessian, gradient = _normal_equations(graph, chosen, place, len(used), weights)
    cut = 3 * int(np.count_nonzero(rank[used] == 0))
    hessian, gradient = _without_blocks(hessian, gradient, cut)
    cut = len(gradient) - 3 * len(submaps)
    kept, across = hessian[cut:, cut:].toarray(), hessian[:cut, cut:].toarray()
    if cut:
        inner = hessian[:cut, :cut] + _HELD * identity(cut, format="csc")
        solved = splu(inner.tocsc()).solve(np.column_stack((across, gradient[:cut])))
        kept -= across.T @ solved[:, :-1]
        gradient = gradient - np.concatenate((np.zeros(cut), across.T @ solved[:, -1]))
    return (kept + kept.T) / 2, gradient[cut:]


def _normal_equations(
    graph: PoseGraph, chosen: IntArray, place: IntArray, count: int, weights: FloatArray
) -> tuple[Sparse, FloatArray]:
    """Return matrix and gradient of the cost of constraints, by the poses of `count` vertices.

    Parameters
    ----------
    place : of each vertex among these.
    """
    from scipy.sparse import coo_matrix  # slow to import

    first, second = (ends[chosen] for ends in _ends(graph))
    poses = np.concatenate((graph.submap_poses, graph.node_poses))
    information, residual = _in_map(graph, chosen, poses, first, second)
    information *= weights[chosen][:, None, None]
    gradient = np.zeros((count, 3))
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
    everything = (np.concatenate(values), np.concatenate(entries, axis=1))
    return coo_matrix(everything, (3 * count, 3 * count)).tocsc(), gradient.reshape(-1)


def _without_blocks(hessian: Sparse, gradient: FloatArray, cut: int) -> tuple[Sparse, FloatArray]:
    """Eliminate the first vertices, which are not coupled to each other: 3x3 blocks each.

    Parameters
    ----------
    cut : number of their coordinates.
    """
    from scipy.sparse import bsr_matrix  # slow to import

    if cut == 0:
        return hessian, gradient
    blocks = np.zeros((cut // 3, 3, 3))
    diagonal = hessian[:cut, :cut].tocoo()
    blocks[diagonal.row // 3, diagonal.row % 3, diagonal.col % 3] = diagonal.data
    inverses = np.linalg.inv(blocks + _HELD * np.eye(3))
    count = cut // 3
    inverse = bsr_matrix((inverses, np.arange(count), np.arange(count + 1)), (cut, cut)).tocsc()
    across = hessian[:cut, cut:]
    left = (across.T @ inverse).tocsc()
    return (hessian[cut:, cut:] - left @ across).tocsc(), gradient[cut:] - left @ gradient[:cut]


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
