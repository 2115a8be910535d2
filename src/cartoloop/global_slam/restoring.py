# SPDX-License-Identifier: Apache-2.0
"""Brings what selects and searches pairs into the state after the nodes of earlier maps."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cartoloop.arrays import IntArray
from cartoloop.global_slam.closure_search import FinishedSubmap
from cartoloop.global_slam.closures import Closures
from cartoloop.global_slam.graph_adjustment import violated_closures
from cartoloop.global_slam.pair_selection import PairSelection
from cartoloop.global_slam.pose_graph import ConstraintKind, PoseGraph
from cartoloop.global_slam.sessions import MappedSessions, NodeSubmaps, SessionRanges
from cartoloop.global_slam.wide_search import WideSearch
from cartoloop.sensor.pose import Pose
from cartoloop.sensor.scan_points import NodePoints, ScanPoints
from cartoloop.submaps.finished_grid import FinishedGrid
from cartoloop.submaps.node import LOST_ROTATION_INFORMATION, is_lost


def restore(
    mapped: Sequence[MappedSessions],
    graph: PoseGraph,
    closures: Closures,
    sessions: SessionRanges,
    pairs: PairSelection,
    wide: WideSearch,
    node_points: NodePoints,
    finished: list[FinishedSubmap],
) -> list[set[int]]:
    """Note all of earlier maps; return of each submap the nodes that were inserted into it.

    Parameters
    ----------
    mapped : the maps.
    graph, closures, sessions : of all of them.
    pairs, wide, node_points : that the nodes are added to.
    finished : that the submaps are added to.
    """
    submap_nodes = _restore_nodes(mapped, graph, sessions, pairs, wide, node_points)
    for index, grid in enumerate(grid for each in mapped for grid in each.grids):
        finished.append(finished_submap(index, grid, graph, node_points.view))
    _restore_closures(graph, closures, pairs)
    return submap_nodes


def _restore_nodes(
    mapped: Sequence[MappedSessions],
    graph: PoseGraph,
    sessions: SessionRanges,
    pairs: PairSelection,
    wide: WideSearch,
    node_points: NodePoints,
) -> list[set[int]]:
    """Note the nodes of maps; return of each submap the nodes that were inserted into it."""
    submaps = NodeSubmaps.of(graph)
    begins = set(sessions.first_nodes[1:])
    for points in (points for each in mapped for points in each.node_points):
        node_points.append(points)
    all_points = node_points.view
    inserted = np.flatnonzero(graph.kinds == ConstraintKind.INTRA_SUBMAP)
    weak = inserted[graph.informations[inserted, 2, 2] < LOST_ROTATION_INFORMATION]
    lost = {int(graph.index_b[row]) for row in weak if is_lost(graph.informations[row])}
    tf_local_node = np.concatenate([each.tf_local_node for each in mapped])
    for node, pose in enumerate(tf_local_node.tolist()):
        if node in begins:
            pairs.begin_session()
            wide.begin_session()
        own = (int(submaps.first[node]), int(submaps.last[node]))
        was_lost = node in lost
        pairs.add((pose[0], pose[1]), len(all_points[node]), own, was_lost=was_lost)
        wide.restore_node(Pose(*pose), all_points, was_lost=was_lost)
    submap_nodes: list[set[int]] = [set() for _ in range(graph.num_submaps)]
    for submap, node in zip(
        graph.index_a[inserted].tolist(), graph.index_b[inserted].tolist(), strict=True
    ):
        submap_nodes[submap].add(node)
    return submap_nodes


def _restore_closures(graph: PoseGraph, closures: Closures, pairs: PairSelection) -> None:
    """Note the requests and closures of maps; closures that hold connect submaps."""
    pairs.note_requested(closures)
    in_graph, is_violated = violated_closures(graph)
    pairs.note_adjusted(graph, in_graph[~is_violated])


def finished_submap(
    index: int, grid: FinishedGrid, graph: PoseGraph, node_points: ScanPoints
) -> FinishedSubmap:
    """Return a finished submap, with what its own scans say about it."""
    own = inserted_rows(graph, index)
    points = node_points.take(graph.index_b[own])
    return FinishedSubmap.of(index, grid, points, graph.relative_poses[own])


def inserted_rows(graph: PoseGraph, submap: int) -> IntArray:
    """Return the constraints of the nodes that were inserted into a submap."""
    return np.flatnonzero((graph.index_a == submap) & (graph.kinds == ConstraintKind.INTRA_SUBMAP))
