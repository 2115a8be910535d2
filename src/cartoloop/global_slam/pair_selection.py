# SPDX-License-Identifier: Apache-2.0
"""Which pairs of node and finished submap are searched, and with which window.

The window does not have to be 7 m where the graph knows the relative pose to half a metre. How well
it is known follows from the shortest path from the one to the other, along the robot's path and
across the loop closures found so far: the error of dead reckoning grows in proportion to it. From a
node it leads first to the submap that it was inserted into, or along the path to the nearest node
that closed a loop: its anchor.

Here pairs are limited by distance, number and path length, and between two submaps by the searches
and closures so far (``pair_counts``). That limit of closures counts once more within one task of
the search (``closure_search``), where closures are found that have not joined the graph yet.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cartoloop.arrays import FloatArray, IntArray, RowArray
from cartoloop.config import ConstraintSearchConfig
from cartoloop.global_slam.closure_matches import Requests
from cartoloop.global_slam.closure_search import FinishedSubmap
from cartoloop.global_slam.closures import Closures
from cartoloop.global_slam.lost_gaps import LostGaps
from cartoloop.global_slam.pair_counts import PairCounts
from cartoloop.global_slam.pair_verdict import PairVerdict, why_not
from cartoloop.global_slam.pose_graph import PoseGraph
from cartoloop.global_slam.search_windows import windows
from cartoloop.global_slam.submap_paths import UNCONNECTED_M, SubmapPaths
from cartoloop.global_slam.wide_windows import bounding_boxes, wide_reach
from cartoloop.growing_array import GrowingArray
from cartoloop.kernels.due_pairs import (
    NodePlace,
    PairRule,
    Paths,
    nearest_anchor,
    pairs_of_node,
    pairs_of_submap,
)
from cartoloop.submaps.node import Node, is_lost
from cartoloop.submaps.submap import SPARSE_STEP_M

_NOTHING: FloatArray = np.empty(0)


class PairSelection:
    """Chooses the pairs to search, given nodes and the loop closures so far."""

    def __init__(self, config: ConstraintSearchConfig) -> None:
        self._config = config
        self._rule = PairRule(
            config.max_constraint_distance,
            config.wide_search.min_path_length,
            config.well_constrained_length,
            config.every_nth_node,
            config.every_nth_well_constrained_node,
        )
        self._node_submaps = GrowingArray((2,), np.int64)
        self._travelled = GrowingArray((), np.float64)
        self._submap_travelled = GrowingArray((), np.float64)
        self._is_searchable = GrowingArray((), np.bool_)
        self._last_position = (0.0, 0.0)
        self._begins_session = False
        self._closures = np.empty((2, 0), dtype=np.int64)
        self._counts = PairCounts(config)
        self._submap_paths = self._wide_paths = SubmapPaths(config)
        self._gaps = LostGaps()
        self._boxes: FloatArray = np.empty((0, 4))

    @property
    def was_lost(self) -> bool:
        """Whether the robot was lost in a gap of the recording."""
        return bool(self._gaps)

    def begin_session(self) -> None:
        """Note that the next node is the first of another session: no path leads to it."""
        self._begins_session = True

    def add_node(self, node: Node) -> None:
        """Note a node, and the submap that begins with it."""
        self.add(
            node.tf_local_tracking[:2],
            len(node.points),
            (node.submaps[0].index, node.submaps[-1].index),
            was_lost=is_lost(node.information),
        )

    def add(
        self,
        position: tuple[float, ...],
        num_points: int,
        submaps: tuple[int, int],
        *,
        was_lost: bool = False,
    ) -> None:
        """Note a node.

        Parameters
        ----------
        position : of the robot, local frame [m].
        num_points : number of its returns.
        submaps : the first and the last that it was inserted into.
        was_lost : whether nothing says how far it is from the node before.
        """
        step = math.dist(position, self._last_position)
        if step > SPARSE_STEP_M:
            step *= self._config.sparse_drift
        if was_lost:
            self._gaps.add()
        if self._begins_session:
            step, self._begins_session = UNCONNECTED_M, False
        travelled = self._travelled.view[-1] + step if len(self._travelled) else 0.0
        self._last_position = (position[0], position[1])
        self._travelled.append(travelled)
        self._is_searchable.append(num_points >= self._config.min_num_points)
        self._node_submaps.append(submaps)
        while submaps[1] >= len(self._submap_travelled):
            self._submap_travelled.append(travelled)
            self._gaps.add_submap()

    def note_found(self, submaps: NDArray[np.integer], nodes: NDArray[np.integer]) -> None:
        """Note loop closures that searches found."""
        self._counts.note_found(submaps, self._node_submaps.view[nodes, 0])

    def note_requested(self, closures: Closures) -> None:
        """Note the requests and found closures of a record."""
        self.note_found(closures.found.submap, closures.found.node)
        submaps = closures.submap[: closures.num_requested]
        self._counts.note_searched(submaps, closures.node_submap, closures.linear_window)

    def note_adjusted(self, graph: PoseGraph, closures: IntArray) -> None:
        """Note which constraints of the graph are loop closures that hold, shape (k,)."""
        nodes, submaps = graph.index_b[closures], graph.index_a[closures]
        both, begun = self._node_submaps.view[nodes], self._submap_travelled.view
        self._submap_paths = self._wide_paths = self._connected(begun, submaps, nodes, both[:, 0])
        if self._gaps:
            own = self._gaps.own_submaps(both)
            is_proof = graph.is_trusted[closures] | ~self._gaps.are_across(submaps, own)
            self._wide_paths = self._connected(
                self._wide_travelled, submaps[is_proof], nodes[is_proof], own[is_proof]
            )
        order = np.argsort(nodes, kind="stable")
        self._closures = np.array((nodes[order], submaps[order]))

    def _connected(
        self, travelled: FloatArray, submaps: IntArray, nodes: IntArray, own: IntArray
    ) -> SubmapPaths:
        """Return the paths between submaps that closures connect.

        Parameters
        ----------
        travelled : path length when each submap was begun [m].
        submaps, nodes, own : of the closures; of the submaps of each node, the one that counts.
        """
        inside = self._travelled.view[nodes] - self._submap_travelled.view[own]
        return SubmapPaths(self._config, travelled, np.column_stack((submaps, own)), inside)

    def of_node(self, graph: PoseGraph, node: int, num_finished: int) -> Requests:
        """Return the requests for a node in the finished submaps, which are the first."""
        if num_finished == 0 or not self._is_searchable.view[node]:
            return NO_REQUESTS
        place = self._place(graph, node)
        submaps = np.empty(num_finished, dtype=np.int32)
        lengths, poses = np.empty(num_finished), np.empty((num_finished, 3))
        num_due = pairs_of_node(
            place[:],
            num_finished,
            graph.submap_poses,
            self._submap_travelled.view,
            self._submap_paths.lengths_from(place.anchor),
            self._rule[:],
            submaps,
            lengths,
            poses,
        )
        if num_due == 0:
            return NO_REQUESTS
        nodes = np.full(num_due, node, dtype=np.int32)
        return self._requests(submaps[:num_due], nodes, lengths[:num_due], poses)

    def in_submap(self, graph: PoseGraph, submap: int) -> Requests:
        """Return the requests for all nodes in one submap."""
        return self._requests(*self._due_in(graph, submap))

    def again(self, graph: PoseGraph, num_finished: int, closures: Closures) -> Requests:
        """Return the requests for all pairs that are due by now and have no row in the record."""
        if num_finished == 0:
            return NO_REQUESTS
        due = [self._due_in(graph, submap) for submap in range(num_finished)]
        submaps, nodes, lengths, poses = map(np.concatenate, zip(*due, strict=True))
        new = ~closures.has_rows(submaps, nodes)
        return self._requests(submaps[new], nodes[new], lengths[new], poses[new])

    def _due_in(
        self, graph: PoseGraph, submap: int
    ) -> tuple[RowArray, RowArray, FloatArray, FloatArray]:
        """Return submap, node, path length and tf_submap_node of the pairs due in one submap."""
        count = graph.num_nodes
        nodes = np.empty(count, dtype=np.int32)
        lengths, poses = np.empty(count), np.empty((count, 3))
        num_due = pairs_of_submap(
            submap,
            graph.submap_poses[submap],
            graph.node_poses,
            self._is_searchable.view,
            self._paths,
            self._submap_paths.lengths_from(submap),
            self._rule,
            nodes,
            lengths,
            poses,
        )
        submaps = np.full(num_due, submap, dtype=np.int32)
        return submaps, nodes[:num_due], lengths[:num_due], poses[:num_due]

    def verdict(self, graph: PoseGraph, submap: int, node: int) -> PairVerdict:
        """Return whether a pair would be requested now, or why not."""
        place = self._place(graph, node)
        x, y, _ = graph.submap_poses[submap].tolist()
        distance = math.dist((place.x, place.y), (x, y))
        length = _path_length(submap, place, self._submap_travelled.view, self._submap_paths)
        reason = why_not(
            self._config,
            self._counts,
            place,
            submap,
            distance,
            length,
            has_few_points=not self._is_searchable.view[node],
        )
        return PairVerdict(reason, distance, length)

    def path_length(self, graph: PoseGraph, submap: int, node: int) -> float:
        """Return the length of the shortest known path between submap and node [m].

        A gap in which the robot was lost is a long one.
        """
        place, begun = self._wide_place(graph, node), self._wide_travelled
        return _path_length(submap, place, begun, self._wide_paths)

    def wide_pairs(
        self,
        graph: PoseGraph,
        node: int,
        submaps: Sequence[FinishedSubmap],
        min_path_length: float | None = None,
    ) -> Requests:
        """Return the requests for a composite scan, wherever the drift may place it.

        Parameters
        ----------
        node : whose frame the composite scan has.
        submaps : all that are finished, the first ones of the graph.
        min_path_length : to the submaps [m]; None: that of wide searches.
        """
        known = min(len(self._wide_paths), len(submaps))
        if known == 0:
            return NO_REQUESTS
        place = self._wide_place(graph, node)
        reach = wide_reach(
            self._config,
            self._wide_paths,
            place,
            graph.submap_poses[: len(self._wide_paths)],
            self._wide_travelled,
            self._boxes_of(submaps[:known]),
            min_path_length,
        )
        due = reach.due
        return Requests(
            due.astype(np.int32),
            np.full(len(due), node, dtype=np.int32),
            np.full(len(due), place.first_submap, dtype=np.int32),
            reach.tf_submap_node,
            reach.linear_window,
            reach.angular_window,
        )

    def _boxes_of(self, submaps: Sequence[FinishedSubmap]) -> FloatArray:
        """Return the bounding boxes of the first finished submaps, which never change."""
        if len(self._boxes) < len(submaps):
            self._boxes = bounding_boxes(submaps)
        return self._boxes[: len(submaps)]

    @property
    def _paths(self) -> Paths:
        return Paths(
            self._travelled.view,
            self._node_submaps.view,
            self._submap_travelled.view,
            self._closures,
            self._config.closure_path_length,
        )

    def _place(self, graph: PoseGraph, node: int) -> NodePlace:
        anchor, length = nearest_anchor(node, *self._paths)
        x, y, theta = graph.node_poses[node].tolist()
        travelled = float(self._travelled.view[node])
        first, last = self._node_submaps.view[node].tolist()
        return NodePlace(node, x, y, theta, travelled, first, last, anchor, length)

    @property
    def _wide_travelled(self) -> FloatArray:
        """Path length when each submap was begun, as wide searches take it, shape (m,) [m]."""
        travelled: FloatArray = self._submap_travelled.view + self._gaps.before_submap
        return travelled

    def _wide_place(self, graph: PoseGraph, node: int) -> NodePlace:
        """Return a node's place as wide searches take it."""
        place = self._place(graph, node)
        return self._gaps.lengthened(place, self._submap_travelled.view)

    def _requests(
        self, submaps: RowArray, nodes: RowArray, lengths: FloatArray, poses: FloatArray
    ) -> Requests:
        """Return the requests for those of the pairs that the counts allow."""
        if len(submaps) == 0:
            return NO_REQUESTS
        node_submaps = self._node_submaps.view[nodes, 0]
        taken = self._counts.take(submaps, node_submaps, lengths)
        if len(taken) == 0:
            return NO_REQUESTS
        requests = Requests(
            submaps,
            nodes,
            node_submaps.astype(np.int32),
            poses[: len(submaps)],
            *windows(self._config, lengths),
        )
        return requests if len(taken) == len(submaps) else requests.take(taken)


_NO_ROWS = np.zeros(0, np.int32)
NO_REQUESTS = Requests(_NO_ROWS, _NO_ROWS, _NO_ROWS, np.zeros((0, 3)), _NOTHING, _NOTHING)


def _path_length(submap: int, place: NodePlace, begun: FloatArray, paths: SubmapPaths) -> float:
    """Return the length of the shortest known path between submap and node [m].

    Parameters
    ----------
    begun : path length of the robot when each submap was begun, shape (m,) [m].
    paths : between the submaps.
    """
    length = abs(place.travelled - float(begun[submap]))
    known = paths.lengths_from(place.anchor)
    if submap < len(known):
        length = min(length, float(known[submap]) + place.anchor_length)
    return length
