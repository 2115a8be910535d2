# SPDX-License-Identifier: Apache-2.0
"""Where nodes are sought: what a new node, or a submap just finished, gives the search to do."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from cartoloop.config import ConstraintSearchConfig
from cartoloop.global_slam.closures import Requests
from cartoloop.global_slam.pair_selection import CLOSURE_LENGTH_M, PairSelection
from cartoloop.global_slam.pose_graph import PoseGraph
from cartoloop.growing_array import GrowingArray
from cartoloop.kernels.due_pairs import due_pairs, nearest_tie
from cartoloop.sensor.pose import FloatArray
from cartoloop.submaps.node import Node

IntArray = NDArray[np.int64]


class SearchRequests:
    """Knows of each node how far the robot had come and which submaps it was inserted into."""

    def __init__(self, config: ConstraintSearchConfig) -> None:
        self._config = config
        self._selection = PairSelection(config)
        self._node_submaps = GrowingArray((2,), np.int64)
        self._travelled = GrowingArray((), np.float64)
        self._submap_travelled = GrowingArray((), np.float64)
        self._is_sought = GrowingArray((), np.bool_)
        self._last_position = (0.0, 0.0)
        self._ties = np.empty((2, 0), dtype=np.int64)

    def add_node(self, node: Node) -> None:
        """Learn of a node, and of a submap that begins with it."""
        x, y, _ = node.tf_local_tracking
        step = math.dist((x, y), self._last_position)
        travelled = self._travelled.view[-1] + step if len(self._travelled) else 0.0
        self._last_position = (x, y)
        self._travelled.append(travelled)
        self._is_sought.append(len(node.points) >= self._config.min_num_points)
        self._node_submaps.append((node.submaps[0].index, node.submaps[-1].index))
        if node.submaps[-1].index == len(self._submap_travelled):
            self._submap_travelled.append(travelled)

    def note_found(self, submaps: NDArray[np.integer], nodes: NDArray[np.integer]) -> None:
        """Learn of loop closures."""
        node_submaps = self._node_submaps.view[nodes, 0]
        for pair in zip(submaps.tolist(), node_submaps.tolist(), strict=True):
            self._selection.note_found(*pair)

    def note_adjusted(self, graph: PoseGraph, closures: IntArray) -> None:
        """Learn which constraints of the graph are loop closures that hold, shape (k,)."""
        nodes, submaps = graph.index_b[closures], graph.index_a[closures]
        ends = np.column_stack((submaps, self._node_submaps.view[nodes, 0]))
        self._selection.update(self._submap_travelled.view, ends)
        order = np.argsort(nodes, kind="stable")
        self._ties = np.array((nodes[order], submaps[order]))

    def of_node(self, graph: PoseGraph, node: int, num_finished: int) -> Requests:
        """Return where to seek a node: in the finished submaps near enough, which are the first."""
        tie, _ = nearest_tie(
            node,
            self._travelled.view,
            self._node_submaps.view,
            self._submap_travelled.view,
            self._ties,
            CLOSURE_LENGTH_M,
        )
        return self._requests(
            graph,
            (0, num_finished),
            (node, node + 1),
            known_ways=self._selection.ways_from(tie),
            ways_from_submap=False,
        )

    def in_submap(self, graph: PoseGraph, submap: int) -> Requests:
        """Return which nodes to seek in a submap: those near enough."""
        return self._requests(
            graph,
            (submap, submap + 1),
            (0, graph.num_nodes),
            known_ways=self._selection.ways_from(submap),
            ways_from_submap=True,
        )

    def _requests(
        self,
        graph: PoseGraph,
        submaps: tuple[int, int],
        nodes: tuple[int, int],
        *,
        known_ways: FloatArray,
        ways_from_submap: bool,
    ) -> Requests:
        """Return the searches for those of the pairs by which there is something to be gained."""
        config = self._config
        num_pairs = (submaps[1] - submaps[0]) * (nodes[1] - nodes[0])
        pairs = np.empty((num_pairs, 3), dtype=np.int64)
        lengths, poses = np.empty(num_pairs), np.empty((num_pairs, 3))
        num_due = due_pairs(
            *submaps,
            *nodes,
            graph.submap_poses,
            graph.node_poses,
            config.max_constraint_distance,
            self._is_sought.view,
            self._travelled.view,
            self._node_submaps.view,
            self._submap_travelled.view,
            self._ties,
            CLOSURE_LENGTH_M,
            known_ways,
            ways_from_submap,
            config.bound_length,
            config.every_nth_node,
            config.every_nth_bound_node,
            pairs,
            lengths,
            poses,
        )
        lengths = lengths[:num_due]
        taken = [
            i
            for i, ((submap, _, node_submap), length) in enumerate(
                zip(pairs[:num_due].tolist(), lengths.tolist(), strict=True)
            )
            if self._selection.take(submap, node_submap, length)
        ]
        columns = pairs[taken].astype(np.int32)
        windows = self._selection.windows(lengths[taken])
        return Requests(columns[:, 0], columns[:, 1], columns[:, 2], poses[taken], *windows)
