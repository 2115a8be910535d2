# SPDX-License-Identifier: Apache-2.0
"""What the constraints of removed vertices say about the vertices that stay, as few constraints.

Removed nodes and submaps are marginalized out of the constraints that touch them (a Schur
complement of the linearized problem), which leaves a dense normal distribution of the poses of the
submaps that stay. It is approximated by constraints along the spanning tree of the best known
relative poses, each with its marginal covariance: the closed form of nonlinear factor recovery for
a tree (Mazuran, Burgard, Tipaldi, "Nonlinear factor recovery for long-term SLAM", 2016; the tree of
Chow and Liu, 1968). Nodes that stay are taken as rigid parts of their submaps meanwhile.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cartoloop.arrays import BoolArray, FloatArray, IntArray
from cartoloop.global_slam.pose_graph import ConstraintKind, PoseGraph
from cartoloop.sensor.pose import compose_all, relative_all, wrap_angles

_LEAST_INFORMATION = 1e-3
"""Added to what is inverted: vertices that nothing holds stay where they are."""

_LEAST_COUPLING = 1e-6
"""Blocks of a smaller norm do not connect two submaps."""


class Links(NamedTuple):
    """Constraints between nodes.

    Attributes
    ----------
    node_a, node_b : int64, shape (n,).
    tf_a_b : float64, shape (n, 3) [m, m, rad].
    information : float64, shape (n, 3, 3), frame of a.
    """

    node_a: IntArray
    node_b: IntArray
    tf_a_b: FloatArray
    information: FloatArray


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


def replacements(
    graph: PoseGraph,
    kept_submaps: BoolArray,
    kept_nodes: BoolArray,
    weights: FloatArray,
    memory: float,
) -> Links:
    """Return the constraints that replace those of removed vertices.

    Parameters
    ----------
    graph : adjusted, with all vertices.
    kept_submaps, kept_nodes : bool, shapes (m,), (n,). Each node that stays was inserted into a
        submap that stays, and each of these has such a node.
    weights : shape (num_constraints,), what robust losses leave of each constraint.
    memory : share of the information that is kept.

    Returns
    -------
    links between nodes that stay, numbered as in `graph`.
    """
    hosts = host_submaps(graph, kept_submaps)
    marginal = marginalized(graph, kept_submaps, kept_nodes, hosts, weights)
    return _links(graph, *_tree(marginal, graph.submap_poses), memory)


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


def marginalized(
    graph: PoseGraph,
    kept_submaps: BoolArray,
    kept_nodes: BoolArray,
    hosts: IntArray,
    weights: FloatArray,
) -> Marginal:
    """Return what the constraints of removed vertices say about the submaps that stay."""
    from scipy.sparse import coo_matrix, identity  # slow to import
    from scipy.sparse.linalg import splu

    num_submaps = graph.num_submaps
    chosen = np.flatnonzero(touching(graph, kept_submaps, kept_nodes))
    first, second = (ends[chosen] for ends in _ends(graph))
    poses = np.concatenate((graph.submap_poses, graph.node_poses))
    # The vertex whose pose stands for each vertex: of nodes that stay, their submap.
    stands = np.concatenate((np.arange(num_submaps), np.where(kept_nodes, hosts, -1)))
    own = np.flatnonzero(stands < 0)
    stands[own] = own
    information, residual = _in_map(graph, chosen, poses, first, second)
    information *= weights[chosen][:, None, None]
    by_a = _lever(poses[second] - poses[first]) @ _lever(poses[first] - poses[stands[first]])
    by_b = -_lever(poses[second] - poses[stands[second]])

    is_kept = np.concatenate((kept_submaps, np.zeros(graph.num_nodes, dtype=bool)))
    used = np.unique(np.concatenate((stands[first], stands[second])))
    used = used[np.argsort(is_kept[used], kind="stable")]  # those to be removed first
    place = np.full(len(poses), -1)
    place[used] = np.arange(len(used))
    num_removed = int(np.count_nonzero(~is_kept[used]))

    jacobians = ((place[stands[first]], by_a), (place[stands[second]], by_b))
    size = 3 * len(used)
    gradient = np.zeros((len(used), 3))
    rows, cols, values = [], [], []
    for row, left in jacobians:
        weighted = np.swapaxes(left, 1, 2) @ information
        np.add.at(gradient, row, (weighted @ residual[:, :, None])[:, :, 0])
        for col, right in jacobians:
            blocks = weighted @ right
            axes = np.arange(3)
            rows.append(np.broadcast_to(3 * row[:, None, None] + axes[:, None], blocks.shape))
            cols.append(np.broadcast_to(3 * col[:, None, None] + axes, blocks.shape))
            values.append(blocks)
    entries = (np.concatenate(rows).ravel(), np.concatenate(cols).ravel())
    hessian = coo_matrix((np.concatenate(values).ravel(), entries), (size, size)).tocsc()

    cut = 3 * num_removed
    kept, across = hessian[cut:, cut:].toarray(), hessian[:cut, cut:].toarray()
    flat = gradient.reshape(-1)
    if cut:
        inner = hessian[:cut, :cut] + _LEAST_INFORMATION * identity(cut, format="csc")
        solved = splu(inner.tocsc()).solve(np.column_stack((across, flat[:cut])))
        kept -= across.T @ solved[:, :-1]
        flat[cut:] -= across.T @ solved[:, -1]
    return Marginal(used[num_removed:], (kept + kept.T) / 2, flat[cut:])


def _in_map(
    graph: PoseGraph, chosen: IntArray, poses: FloatArray, first: IntArray, second: IntArray
) -> tuple[FloatArray, FloatArray]:
    """Return information and residual of constraints, map axes; see kernels/.../residuals.py."""
    turns = _turns(poses[first, 2])
    information = turns @ graph.informations[chosen] @ np.swapaxes(turns, 1, 2)
    measured = (turns @ graph.relative_poses[chosen][:, :, None])[:, :, 0]
    residual = measured - (poses[second] - poses[first])
    residual[:, 2] = wrap_angles(residual[:, 2])
    return information, residual


def _turns(angles: FloatArray) -> FloatArray:
    """Return matrices that turn x and y, shape (n, 3, 3)."""
    cos, sin, zero = np.cos(angles), np.sin(angles), np.zeros(len(angles))
    columns = (cos, -sin, zero, sin, cos, zero, zero, zero, zero + 1.0)
    return np.stack(columns, axis=1).reshape(-1, 3, 3)


def _lever(offset: FloatArray) -> FloatArray:
    """Return how a point moves with a body: by its changes of pose, shape (n, 3, 3), map axes.

    Parameters
    ----------
    offset : of the point from the body's origin, shape (n, 2 or more) [m].
    """
    levers = np.broadcast_to(np.eye(3), (len(offset), 3, 3)).copy()
    levers[:, 0, 2], levers[:, 1, 2] = -offset[:, 1], offset[:, 0]
    return levers


def _members(graph: PoseGraph, submaps: IntArray) -> IntArray:
    """Return a node that was inserted into each of the submaps."""
    own = np.flatnonzero(graph.kinds == ConstraintKind.INTRA_SUBMAP)
    order = np.lexsort((graph.index_b[own], graph.index_a[own]))
    firsts = np.searchsorted(graph.index_a[own][order], submaps)
    nodes: IntArray = graph.index_b[own][order[firsts]]
    return nodes


def _tree(marginal: Marginal, submap_poses: FloatArray) -> tuple[IntArray, FloatArray, FloatArray]:
    """Return the relative poses that approximate a distribution best.

    Returns
    -------
    pairs : int64, shape (n, 2), of submaps.
    tf_a_b : float64, shape (n, 3), mean [m, m, rad].
    information : float64, shape (n, 3, 3), frame of a.
    """
    count = len(marginal.submaps)
    blocks = np.abs(marginal.information.reshape(count, 3, count, 3)).max(axis=(1, 3))
    pairs, poses, informations = [np.zeros((0, 2), np.int64)], [], []
    for members in _components(blocks > _LEAST_COUPLING):
        submaps = marginal.submaps[members]
        mean, relative_information = _relative(marginal, members, submap_poses[submaps])
        edges = _spanning_tree(np.linalg.slogdet(relative_information)[1])
        one, other = edges.T
        turns = np.swapaxes(_turns(mean[one, 2]), 1, 2)
        pairs.append(submaps[edges])
        poses.append(relative_all(mean[one], mean[other]))
        informations.append(turns @ relative_information[one, other] @ np.swapaxes(turns, 1, 2))
    none = np.zeros((0, 3))
    return (
        np.concatenate(pairs),
        np.concatenate([none, *poses]),
        np.concatenate([none.reshape(0, 3, 3), *informations]),
    )


def _relative(
    marginal: Marginal, members: IntArray, poses: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the mean poses of connected submaps, and the information of all relative poses.

    Shapes (k, 3) and (k, k, 3, 3), map axes; the first submap is held.
    """
    count = len(members)
    axes = (3 * members[:, None] + np.arange(3)).ravel()[3:]
    inner = marginal.information[np.ix_(axes, axes)]
    covariance = np.zeros((3 * count, 3 * count))
    covariance[3:, 3:] = np.linalg.inv(inner + _LEAST_INFORMATION * np.eye(len(axes)))
    change = np.zeros(3 * count)
    change[3:] = -covariance[3:, 3:] @ marginal.gradient[axes]
    mean = poses + change.reshape(count, 3)
    mean[:, 2] = wrap_angles(mean[:, 2])
    blocks = np.swapaxes(covariance.reshape(count, 3, count, 3), 1, 2)
    own = blocks[np.arange(count), np.arange(count)]
    one, other = (index.ravel() for index in np.indices((count, count)))
    lever = _lever(mean[other] - mean[one])
    across = lever @ blocks[one, other]
    relative = (
        own[other]
        + lever @ own[one] @ np.swapaxes(lever, 1, 2)
        - across
        - np.swapaxes(across, 1, 2)
    )
    relative[one == other] = np.eye(3)
    information = np.linalg.inv(relative)
    information = (information + np.swapaxes(information, 1, 2)) / 2
    return mean, information.reshape(count, count, 3, 3)


def _components(connected: BoolArray) -> list[IntArray]:
    """Return the members of each connected set of two or more, ascending."""
    left = np.ones(len(connected), dtype=bool)
    found = []
    for first in range(len(connected)):
        if not left[first]:
            continue
        members = np.zeros(len(connected), dtype=bool)
        members[first] = True
        while True:
            reached = members | connected[members].any(axis=0)
            if np.array_equal(reached, members):
                break
            members = reached
        left &= ~members
        if np.count_nonzero(members) > 1:
            found.append(np.flatnonzero(members))
    return found


def _spanning_tree(weights: FloatArray) -> IntArray:
    """Return the pairs of the spanning tree of the largest weights, shape (k - 1, 2)."""
    count = len(weights)
    best, nearest = weights[0].copy(), np.zeros(count, dtype=np.int64)
    outside = np.ones(count, dtype=bool)
    outside[0] = False
    edges = np.empty((count - 1, 2), dtype=np.int64)
    for number in range(count - 1):
        new = int(np.argmax(np.where(outside, best, -np.inf)))
        edges[number] = nearest[new], new
        outside[new] = False
        closer = weights[new] > best
        best[closer], nearest[closer] = weights[new][closer], new
    return edges


def _links(
    graph: PoseGraph,
    pairs: IntArray,
    tf_a_b: FloatArray,
    information: FloatArray,
    memory: float,
) -> Links:
    """Return constraints between submaps as ones between nodes of these.

    Parameters
    ----------
    pairs : shape (n, 2), of submaps.
    tf_a_b, information : of these, shapes (n, 3), (n, 3, 3), frame of a.
    memory : share of the information that is kept.
    """
    node_a, node_b = _members(graph, pairs[:, 0]), _members(graph, pairs[:, 1])
    tf_node_a = relative_all(graph.node_poses[node_a], graph.submap_poses[pairs[:, 0]])
    tf_b_node = relative_all(graph.submap_poses[pairs[:, 1]], graph.node_poses[node_b])
    to_node = compose_all(tf_a_b, tf_b_node)
    # A change of tf_a_b, axes of a, moves node b by the lever of what lies beyond submap b.
    turns = _turns(tf_node_a[:, 2])
    back = np.linalg.inv(turns @ _lever(to_node - tf_a_b))
    at_nodes = memory * np.swapaxes(back, 1, 2) @ information @ back
    return Links(
        node_a,
        node_b,
        compose_all(tf_node_a, to_node),
        (at_nodes + np.swapaxes(at_nodes, 1, 2)) / 2,
    )
