# SPDX-License-Identifier: Apache-2.0
"""Adds the nodes and submaps of local SLAM to the pose graph and to what is searched."""

from __future__ import annotations

from cartoloop.global_slam.closure_search import FinishedSubmap
from cartoloop.global_slam.graph_records import recorded_submap, submap_record
from cartoloop.global_slam.pose_graph import ConstraintKind, PoseGraph
from cartoloop.global_slam.restoring import finished_submap, inserted_rows
from cartoloop.global_slam.sparse_scans import are_sparse
from cartoloop.journal.frames import Kind
from cartoloop.journal.outcomes import RecordedOutcomes
from cartoloop.runtime.stage_timer import StageTimer
from cartoloop.sensor.pose import IDENTITY, Pose, compose, relative
from cartoloop.sensor.scan_points import NodePoints
from cartoloop.submaps.node import Node, information_in_begun
from cartoloop.submaps.submap import Submap


class GraphBuilder:
    """Adds nodes and submaps to the pose graph, and keeps what searches need of them.

    Parameters
    ----------
    graph : pose graph, which grows.
    intra_submap_weight : of the constraints between a node and its submaps.
    timer : takes the times.
    outcomes : of a run with a journal; grids are replayed from there, or recorded there.

    Attributes
    ----------
    finished : the finished submaps, in order.
    node_points : the returns of each node.
    submap_nodes : of each submap the nodes that were inserted into it.
    tf_local_last_submap : of the latest submap.
    """

    def __init__(
        self,
        graph: PoseGraph,
        intra_submap_weight: float,
        timer: StageTimer,
        outcomes: RecordedOutcomes,
    ) -> None:
        self._graph = graph
        self._weight = intra_submap_weight
        self._timer = timer
        self._recorded = outcomes
        self.finished: list[FinishedSubmap] = []
        self.node_points = NodePoints()
        self.submap_nodes: list[set[int]] = []
        self.tf_local_last_submap = IDENTITY

    def add_node(self, node: Node, tf_map_local: Pose) -> None:
        """Add a node, the submaps that begin with it, and its intra-submap constraints."""
        graph, pose = self._graph, node.tf_local_tracking
        graph.add_node(compose(tf_map_local, pose))
        self.node_points.append(node.points)
        informations = [node.information for _ in node.submaps]
        for number, submap in enumerate(node.submaps):
            if submap.index == graph.num_submaps:
                informations[number] = information_in_begun(node.information)
                graph.add_submap(compose(tf_map_local, submap.tf_local_submap))
                self.tf_local_last_submap = submap.tf_local_submap
                self.submap_nodes.append(set())
                if submap.index == 0:
                    graph.fix_submap(0)
            self.submap_nodes[submap.index].add(node.index)
        graph.add_constraints(
            ConstraintKind.INTRA_SUBMAP,
            [submap.index for submap in node.submaps],
            [node.index for _ in node.submaps],
            [relative(submap.tf_local_submap, pose) for submap in node.submaps],
            [self._weight * information for information in informations],
        )

    def finish(self, submap: Submap) -> FinishedSubmap:
        """Return a submap that gets no more scans, as it is searched."""
        if (recorded := self._recorded.replay(Kind.SUBMAP)) is not None:
            own = inserted_rows(self._graph, submap.index)
            is_sparse = are_sparse(self._graph.relative_poses[own])
            finished = FinishedSubmap(submap.index, *recorded_submap(recorded), is_sparse=is_sparse)
            self.finished.append(finished)
            return finished
        with self._timer.measure("finish submap"):
            grid = submap.grid.finish()
            finished = finished_submap(submap.index, grid, self._graph, self.node_points.view)
        if self._recorded.is_recording:
            record = submap_record(submap.index, finished.grid, finished.own_score)
            self._recorded.record(Kind.SUBMAP, record)
        self.finished.append(finished)
        return finished
