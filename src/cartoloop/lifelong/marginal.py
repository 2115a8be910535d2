# SPDX-License-Identifier: Apache-2.0
"""What the constraints of removed vertices say about the vertices that stay, as few constraints.

Vertices are marginalized out (Schur complements of the linearized problem), which leaves a dense
normal distribution of the poses of the submaps that stay. What the removed constraints say is
approximated by constraints between the pairs with the best known relative poses, such that these
are as well known as before (after Mazuran, Burgard, Tipaldi, "Nonlinear factor recovery for
long-term SLAM", 2016).
"""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np

from cartoloop.arrays import BoolArray, FloatArray, IntArray
from cartoloop.global_slam.pose_graph import ConstraintKind, PoseGraph
from cartoloop.sensor.pose import compose_all, relative_all, wrap_angles

_HELD = 1e-6
"""Added to what is eliminated: vertices that nothing holds stay where they are."""

_LEAST_INFORMATION = 1e-3
"""Added to what is inverted: directions that nothing determines are known to 30 m."""

_LEAST_COUPLING = 1e-6
"""Blocks of a smaller norm do not connect two submaps."""


ANCHOR_INFORMATION = np.diag((1e8, 1e8, 1e10))
"""Of the pose of a node in its submap that stands for the submap [1/m^2, 1/rad^2]."""

_NUM_NEIGHBOURS = 6
"""Each submap that stays is constrained to at least this many others, the best known ones."""

_NUM_FITTING_ROUNDS = 10
"""Rounds of fitting the constraints to how well relative poses are known."""


_SIDES: tuple[Literal["left"], Literal["right"]] = ("left", "right")


class Anchors(NamedTuple):
    """Nodes that stand for their submaps in links.

    Attributes
    ----------
    submap, node : int64, shape (n,).
    tf_submap_node : float64, shape (n, 3) [m, m, rad].
    """

    submap: IntArray
    node: IntArray
    tf_submap_node: FloatArray


class Links(NamedTuple):
    """Constraints between nodes.

    Attributes
    ----------
    node_a, node_b : int64, shape (n,).
    tf_a_b : float64, shape (n, 3) [m, m, rad].
    information : float64, shape (n, 3, 3), frame of a.
    anchors : a single node is loosely connected to its submap. These are held there.
    """

    node_a: IntArray
    node_b: IntArray
    tf_a_b: FloatArray
    information: FloatArray
    anchors: Anchors

    def numbered(self, submaps: IntArray, nodes: IntArray) -> Links:
        """Return them with the new numbers of submaps and nodes, by the old ones."""
        return self._replace(
            node_a=nodes[self.node_a],
            node_b=nodes[self.node_b],
            anchors=self.anchors._replace(
                submap=submaps[self.anchors.submap], node=nodes[self.anchors.node]
            ),
        )

    def add_to(self, graph: PoseGraph) -> None:
        """Add them to a graph that numbers nodes and submaps alike."""
        graph.add_constraints(
            ConstraintKind.INTRA_SUBMAP,
            self.anchors.submap,
            self.anchors.node,
            self.anchors.tf_submap_node,
            np.broadcast_to(ANCHOR_INFORMATION, (len(self.anchors.node), 3, 3)),
        )
        graph.add_constraints(
            ConstraintKind.NODE_TO_NODE, self.node_a, self.node_b, self.tf_a_b, self.information
        )


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
    links between nodes that stay, and their anchors, numbered as in `graph`.
    """
    lost = lost_information(graph, kept_submaps, kept_nodes, weights)
    pairs, tf_a_b, information = _recovered(lost, graph.submap_poses)
    nodes = np.full(graph.num_submaps, -1, dtype=np.int64)
    nodes[kept_submaps] = _members(graph, np.flatnonzero(kept_submaps))
    has_nodes = (nodes[pairs] >= 0).all(axis=1)
    pairs, tf_a_b, information = pairs[has_nodes], tf_a_b[has_nodes], information[has_nodes]
    tf_submap_node = relative_all(graph.submap_poses, graph.node_poses[nodes])
    used = np.unique(pairs)
    anchors = Anchors(used, nodes[used], tf_submap_node[used])
    links = _between_nodes(pairs, tf_a_b, memory * information, tf_submap_node)
    return Links(nodes[pairs[:, 0]], nodes[pairs[:, 1]], *links, anchors)


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
    ends = ((place[first], _lever(poses[second] - poses[first])), (place[second], by_second))
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
    """Return a node that was inserted into each of the submaps, each another one; -1 for none."""
    own = np.flatnonzero(graph.kinds == ConstraintKind.INTRA_SUBMAP)
    order = own[np.lexsort((graph.index_b[own], graph.index_a[own]))]
    firsts, ends = (np.searchsorted(graph.index_a[order], submaps, side) for side in _SIDES)
    taken: set[int] = set()
    members = np.full(len(submaps), -1, dtype=np.int64)
    for number, (first, end) in enumerate(zip(firsts.tolist(), ends.tolist(), strict=True)):
        nodes = graph.index_b[order[first:end]].tolist()
        members[number] = next((node for node in nodes if node not in taken), -1)
        taken.add(int(members[number]))
    return members


def _recovered(
    marginal: Marginal, submap_poses: FloatArray
) -> tuple[IntArray, FloatArray, FloatArray]:
    """Return the relative poses that approximate a distribution.

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
        mean, known = _relative(marginal, members, submap_poses[submaps])
        edges = _best_known(np.linalg.slogdet(known)[1])
        one, other = edges.T
        fitted = fitted_informations(mean, edges, known[one, other], len(members) - 1)
        turns = np.swapaxes(_turns(mean[one, 2]), 1, 2)
        pairs.append(submaps[edges])
        poses.append(relative_all(mean[one], mean[other]))
        informations.append(turns @ fitted @ np.swapaxes(turns, 1, 2))
    none = np.zeros((0, 3))
    return (
        np.concatenate(pairs),
        np.concatenate([none, *poses]),
        np.concatenate([none.reshape(0, 3, 3), *informations]),
    )


def fitted_informations(
    mean: FloatArray, edges: IntArray, known: FloatArray, num_tree: int
) -> FloatArray:
    """Return information matrices of constraints with which relative poses are as well known.

    Parameters
    ----------
    mean : poses, shape (k, 3).
    edges : pairs of them that are constrained, shape (n, 2); the first `num_tree` are a tree.
    known : information of each relative pose, shape (n, 3, 3), map axes.

    Returns
    -------
    float64, shape (n, 3, 3), positive semi-definite, map axes.

    Notes
    -----
    Iterative proportional fitting: each constraint in turn gets what its relative pose lacks,
    until all of them are as well known as they should be. For a tree, `known` is the solution.
    """
    count = len(mean)
    fitted = np.zeros_like(known)
    fitted[:num_tree] = known[:num_tree]
    jacobians = np.zeros((len(edges), 3, 3 * count))
    for number, (one, other) in enumerate(edges.tolist()):
        offset = (mean[other] - mean[one])[None]
        jacobians[number, :, 3 * one : 3 * one + 3] = -_lever(offset)[0]
        jacobians[number, :, 3 * other : 3 * other + 3] = np.eye(3)
    jacobians = jacobians[:, :, 3:]  # the first pose is held
    for _ in range(_NUM_FITTING_ROUNDS):
        total = np.einsum("nai,nab,nbj->ij", jacobians, fitted, jacobians)
        covariance = np.linalg.inv(total + _LEAST_INFORMATION * np.eye(len(total)))
        for number, jacobian in enumerate(jacobians):
            across = jacobian @ covariance
            present = across @ jacobian.T
            lacking = known[number] - np.linalg.inv(present)
            change = _positive(fitted[number] + lacking) - fitted[number]
            fitted[number] += change
            covariance -= across.T @ np.linalg.solve(np.eye(3) + change @ present, change) @ across
    return fitted


def _positive(information: FloatArray) -> FloatArray:
    """Return the nearest symmetric positive semi-definite matrix, shape (3, 3)."""
    values, vectors = np.linalg.eigh((information + information.T) / 2)
    nearest: FloatArray = (vectors * np.maximum(values, 0.0)) @ vectors.T
    return nearest


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


def _best_known(weights: FloatArray) -> IntArray:
    """Return the pairs that are constrained: a spanning tree, then the best known of each.

    Parameters
    ----------
    weights : of the pairs, symmetric, shape (k, k).
    """
    tree = _spanning_tree(weights)
    others = weights.copy()
    np.fill_diagonal(others, -np.inf)
    nearest = np.argsort(-others, axis=1, kind="stable")[:, :_NUM_NEIGHBOURS]
    best = np.column_stack((np.repeat(np.arange(len(weights)), nearest.shape[1]), nearest.ravel()))
    best = best[best[:, 0] != best[:, 1]]
    chosen = {(min(pair), max(pair)) for pair in best.tolist()}
    chosen -= {(min(pair), max(pair)) for pair in tree.tolist()}
    return np.array([*tree.tolist(), *sorted(chosen)], dtype=np.int64).reshape(-1, 2)


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


def _between_nodes(
    pairs: IntArray, tf_a_b: FloatArray, information: FloatArray, tf_submap_node: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return relative poses of submaps, and their information, as those of a node of each.

    Parameters
    ----------
    pairs : shape (n, 2), of submaps.
    tf_a_b, information : of these, shapes (n, 3), (n, 3, 3), frame of a.
    tf_submap_node : of all submaps, shape (m, 3).
    """
    to_node = compose_all(tf_a_b, tf_submap_node[pairs[:, 1]])
    tf_node_a = relative_all(tf_submap_node[pairs[:, 0]], np.zeros((len(pairs), 3)))
    # A change of tf_a_b, axes of a, moves node b by the lever of what lies beyond submap b.
    turns = _turns(tf_node_a[:, 2])
    back = np.linalg.inv(turns @ _lever(to_node - tf_a_b))
    at_nodes = np.swapaxes(back, 1, 2) @ information @ back
    return compose_all(tf_node_a, to_node), (at_nodes + np.swapaxes(at_nodes, 1, 2)) / 2
