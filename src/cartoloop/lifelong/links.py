# SPDX-License-Identifier: Apache-2.0
"""Constraints that replace those of removed vertices: links between nodes of submaps that stay."""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np

from cartoloop.arrays import BoolArray, FloatArray, IntArray
from cartoloop.global_slam.pose_graph import ConstraintKind, PoseGraph
from cartoloop.lifelong.marginal import lever, lost_information, turns
from cartoloop.lifelong.recovery import recovered
from cartoloop.sensor.pose import compose_all, relative_all, wrap_angles

ANCHOR_INFORMATION = np.diag((1e8, 1e8, 1e10))
"""Of the pose of a node in its submap that stands for the submap [1/m^2, 1/rad^2]."""

_SIDES: tuple[Literal["left"], Literal["right"]] = ("left", "right")

_LEAST_INFORMATION = 1e-3
"""Added to what is inverted: directions that nothing determines are known to 30 m."""


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
        """Add them to a graph that numbers nodes and submaps alike.

        A link between two nodes that are linked already, by an earlier trimming, is merged with
        that one, so that links do not add up.
        """
        merged, absorbed = self._merged(graph)
        if absorbed.any():
            graph.remove(absorbed)
        anchors = self.anchors
        is_new = ~np.isin(
            _keys(anchors.submap, anchors.node),
            _keys(*(ends[_is_anchor(graph)] for ends in (graph.index_a, graph.index_b))),
        )
        graph.add_constraints(
            ConstraintKind.INTRA_SUBMAP,
            anchors.submap[is_new],
            anchors.node[is_new],
            anchors.tf_submap_node[is_new],
            np.broadcast_to(ANCHOR_INFORMATION, (int(np.count_nonzero(is_new)), 3, 3)),
        )
        graph.add_constraints(
            ConstraintKind.NODE_TO_NODE,
            merged.node_a,
            merged.node_b,
            merged.tf_a_b,
            merged.information,
        )

    def _merged(self, graph: PoseGraph) -> tuple[Links, BoolArray]:
        """Return the links with those of a graph between the same nodes, and which these are."""
        poses, information = self.tf_a_b.copy(), self.information.copy()
        absorbed = np.zeros(graph.num_constraints, dtype=bool)
        number_of = {pair: number for number, pair in enumerate(self._pairs())}
        for constraint in np.flatnonzero(graph.kinds == ConstraintKind.NODE_TO_NODE).tolist():
            pair = (int(graph.index_a[constraint]), int(graph.index_b[constraint]))
            number = number_of.get(pair)
            if number is None:
                continue
            absorbed[constraint] = True
            offset = graph.relative_poses[constraint] - poses[number]
            offset[2] = wrap_angles(offset[2:])[0]
            total = information[number] + graph.informations[constraint]
            gain = np.linalg.solve(
                total + _LEAST_INFORMATION * np.eye(3), graph.informations[constraint]
            )
            poses[number] += gain @ offset
            information[number] = total
        return self._replace(tf_a_b=poses, information=information), absorbed

    def _pairs(self) -> list[tuple[int, int]]:
        return list(zip(self.node_a.tolist(), self.node_b.tolist(), strict=True))


def _is_anchor(graph: PoseGraph) -> BoolArray:
    """Return which constraints of a graph are anchors of an earlier trimming."""
    anchors: BoolArray = (graph.kinds == ConstraintKind.INTRA_SUBMAP) & (
        graph.informations[:, 0, 0] == ANCHOR_INFORMATION[0, 0]
    )
    return anchors


def _keys(submap: IntArray, node: IntArray) -> IntArray:
    return submap << 32 | node


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
    pairs, tf_a_b, information = recovered(lost, graph.submap_poses)
    nodes = np.full(graph.num_submaps, -1, dtype=np.int64)
    nodes[kept_submaps] = _members(graph, np.flatnonzero(kept_submaps))
    has_nodes = (nodes[pairs] >= 0).all(axis=1)
    pairs, tf_a_b, information = pairs[has_nodes], tf_a_b[has_nodes], information[has_nodes]
    tf_submap_node = relative_all(graph.submap_poses, graph.node_poses[nodes])
    used = np.unique(pairs)
    anchors = Anchors(used, nodes[used], tf_submap_node[used])
    links = _between_nodes(pairs, tf_a_b, memory * information, tf_submap_node)
    return Links(nodes[pairs[:, 0]], nodes[pairs[:, 1]], *links, anchors)


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
    rotation = turns(tf_node_a[:, 2])
    back = np.linalg.inv(rotation @ lever(to_node - tf_a_b))
    at_nodes = np.swapaxes(back, 1, 2) @ information @ back
    return compose_all(tf_node_a, to_node), (at_nodes + np.swapaxes(at_nodes, 1, 2)) / 2
