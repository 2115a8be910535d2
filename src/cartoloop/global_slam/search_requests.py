# SPDX-License-Identifier: Apache-2.0
"""Where nodes are sought: what a new node, or a submap just finished, gives the search to do."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from cartoloop.config import ConstraintSearchConfig
from cartoloop.global_slam.growing_array import GrowingArray
from cartoloop.global_slam.loop_closure import LoopClosure, SearchRequest
from cartoloop.global_slam.pair_selection import CLOSURE_LENGTH_M, PairSelection
from cartoloop.global_slam.pose_graph import PoseGraph
from cartoloop.sensor.pose import FloatArray, Pose, relative
from cartoloop.submaps.node import Node

IntArray = NDArray[np.int64]


class SearchRequests:
    """Knows of each node how far the robot had come and which submaps it was inserted into.

    Attributes
    ----------
    node_points : the returns of each node [m], tracking frame, shapes (n, 2).
    """

    def __init__(self, config: ConstraintSearchConfig) -> None:
        self._config = config
        self._selection = PairSelection(config)
        self.node_points: list[FloatArray] = []
        self._submaps: list[tuple[int, ...]] = []
        self._first_submap = GrowingArray((), np.int64)
        self._travelled = GrowingArray((), np.float64)
        self._submap_travelled = GrowingArray((), np.float64)
        self._last_position = (0.0, 0.0)
        self._tied_nodes = self._tied_to = np.empty(0, dtype=np.int64)

    def add_node(self, node: Node) -> None:
        """Learn of a node, and of a submap that begins with it."""
        x, y, _ = node.tf_local_tracking
        step = math.dist((x, y), self._last_position)
        travelled = self._travelled.view[-1] + step if self.node_points else 0.0
        self._last_position = (x, y)
        self._travelled.append(travelled)
        self.node_points.append(node.points)
        self._submaps.append(tuple(submap.index for submap in node.submaps))
        self._first_submap.append(node.submaps[0].index)
        if node.submaps[-1].index == len(self._submap_travelled):
            self._submap_travelled.append(travelled)

    def note_found(self, closure: LoopClosure) -> None:
        """Learn of a loop closure."""
        self._selection.note_found(closure.submap, self._submaps[closure.node][0])

    def note_adjusted(self, graph: PoseGraph, closures: IntArray) -> None:
        """Learn which constraints of the graph are loop closures that hold, shape (k,)."""
        nodes, submaps = graph.index_b[closures], graph.index_a[closures]
        ends = np.column_stack((submaps, self._first_submap.view[nodes]))
        self._selection.update(self._submap_travelled.view, ends)
        order = np.argsort(nodes, kind="stable")
        self._tied_nodes, self._tied_to = nodes[order], submaps[order]

    def of_node(self, graph: PoseGraph, node: int, num_finished: int) -> list[SearchRequest]:
        """Return where to seek a node: in the finished submaps near enough, which are the first."""
        submaps = np.arange(num_finished)
        are_near = self._are_near(graph.submap_poses[:num_finished], graph.node_poses[node])
        near = np.flatnonzero(self._selection.may_be_due(submaps, node) & are_near)
        return self._requests(graph, near, np.full(len(near), node))

    def in_submap(self, graph: PoseGraph, submap: int) -> list[SearchRequest]:
        """Return which nodes to seek in a submap: those near enough."""
        nodes = np.arange(graph.num_nodes)
        are_near = self._are_near(graph.node_poses, graph.submap_poses[submap])
        near = np.flatnonzero(self._selection.may_be_due(submap, nodes) & are_near)
        return self._requests(graph, np.full(len(near), submap), near)

    def _are_near(self, poses: FloatArray, pose: FloatArray) -> NDArray[np.bool_]:
        """Return which of the poses, shape (n, 3), are near enough to another for a search."""
        distances = np.hypot(poses[:, 0] - pose[0], poses[:, 1] - pose[1])
        near: NDArray[np.bool_] = distances <= self._config.max_constraint_distance
        return near

    def _requests(
        self, graph: PoseGraph, submaps: IntArray, nodes: IntArray
    ) -> list[SearchRequest]:
        """Return the searches for those of the pairs by which there is something to be gained."""
        own = self._first_submap.view[nodes]
        from_submaps = np.abs(self._travelled.view[nodes] - self._submap_travelled.view[submaps])
        lengths = self._selection.uncertain_lengths(submaps, *self._anchors(nodes), from_submaps)
        due = np.flatnonzero(self._selection.are_due(submaps, nodes, lengths))
        pairs = zip(
            submaps[due].tolist(),
            nodes[due].tolist(),
            own[due].tolist(),
            lengths[due].tolist(),
            strict=True,
        )
        return [
            self._request(graph, submap, node, node_submap, length)
            for submap, node, node_submap, length in pairs
            if submap not in self._submaps[node]
            and len(self.node_points[node]) >= self._config.min_num_points
            and self._selection.take(submap, node_submap, length)
        ]

    def _anchors(self, nodes: IntArray) -> tuple[IntArray, FloatArray]:
        """Return the submaps that nodes, shape (n,), are best tied to, and how far along the path.

        A node is tied to the submap that it was inserted into, and by the nearest nodes before and
        behind it that closed a loop to the submaps that these were found in.
        """
        anchors, travelled = self._first_submap.view[nodes], self._travelled.view
        ways: FloatArray = np.abs(travelled[nodes] - self._submap_travelled.view[anchors])
        if len(self._tied_nodes) == 0:
            return anchors, ways
        behind = np.searchsorted(self._tied_nodes, nodes)
        for tied in (np.maximum(behind - 1, 0), np.minimum(behind, len(self._tied_nodes) - 1)):
            steps = np.abs(travelled[nodes] - travelled[self._tied_nodes[tied]])
            is_nearer = steps + CLOSURE_LENGTH_M < ways
            anchors = np.where(is_nearer, self._tied_to[tied], anchors)
            ways = np.where(is_nearer, steps + CLOSURE_LENGTH_M, ways)
        return anchors, ways

    def _request(
        self, graph: PoseGraph, submap: int, node: int, node_submap: int, length: float
    ) -> SearchRequest:
        """Return the search for a pair that stands apart by an uncertain length [m]."""
        estimate = relative(
            Pose(*graph.submap_poses[submap].tolist()), Pose(*graph.node_poses[node].tolist())
        )
        window = self._selection.window(length)
        points = self.node_points[node]
        return SearchRequest(submap, node, node_submap, points, estimate, *window, graph.num_nodes)
