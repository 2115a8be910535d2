# SPDX-License-Identifier: Apache-2.0
"""Global SLAM (section V): nodes and submaps into the pose graph, loop closures, adjustment."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from time import perf_counter

import numpy as np
from numpy.typing import NDArray

from cartoloop.config import GlobalSlamConfig
from cartoloop.global_slam import refinement
from cartoloop.global_slam.constraint_search import ConstraintSearch
from cartoloop.global_slam.finished_submap import FinishedSubmap, mean_score
from cartoloop.global_slam.loop_closure import (
    FOUND,
    NO_CLOSURES,
    Closures,
    IntArray,
    add_closures,
    closures_in,
)
from cartoloop.global_slam.node_points import NodePoints
from cartoloop.global_slam.pose_adjustment import (
    AdjustmentOptions,
    PoseAdjuster,
    constraint_residuals,
)
from cartoloop.global_slam.pose_graph import (
    TRUE_ROTATION_RAD,
    TRUE_TRANSLATION_M,
    ConstraintKind,
    PoseGraph,
)
from cartoloop.global_slam.search_requests import SearchRequests
from cartoloop.growing_array import GrowingArray
from cartoloop.sensor.pose import IDENTITY, Pose, compose, inverse, relative
from cartoloop.sensor.scan_points import ScanPoints
from cartoloop.stage_timer import StageTimer
from cartoloop.submaps.finished_grid import FinishedGrid
from cartoloop.submaps.node import Node
from cartoloop.submaps.submap import Submap

SEARCHES_A_PERIOD = 2
"""So often, from one adjustment to the next, searches are started. Those started right after an
adjustment are done long before the next one, which need not wait for them then."""

SEARCHES_A_LIVE_PERIOD = 9
"""The same where nobody waits for searches; what they found joins the graph as often."""


@dataclass(frozen=True, slots=True)
class AdjustmentRun:
    """One run of pose adjustment.

    Attributes
    ----------
    nodes, submaps, constraints : size of the graph.
    iterations : linear systems solved.
    ms : time that it took [ms].
    """

    nodes: int
    submaps: int
    constraints: int
    iterations: int
    ms: float


MAX_BACKLOG = 10_000
"""Where nobody waits for searches, no more than this are ever behind: some seconds' work."""


class GlobalSlam:
    """Keeps the pose graph, closes loops and adjusts.

    Parameters
    ----------
    config : its parameters.
    timer : takes its times.
    wait_for_searches : whether an adjustment waits for the searches that were started before it,
        so that the result is always the same. Otherwise what is found joins when it is, and
        searches that would be too far behind are dropped and counted.

    Attributes
    ----------
    found_after : of each of `found`, how many nodes were added between asking for it and its
        joining.
    num_put_off : searches that were started and not done when the graph was adjusted.
    rejected : the loop closures that were taken out of the graph in the end.
    """

    def __init__(
        self, config: GlobalSlamConfig, timer: StageTimer, *, wait_for_searches: bool = True
    ) -> None:
        self._config = config
        self._timer = timer
        self._waits = wait_for_searches
        self.graph = PoseGraph()
        self._adjuster = PoseAdjuster(self.graph)
        self._finished: list[FinishedSubmap] = []
        self._node_points = NodePoints()
        self.search = ConstraintSearch(
            config.constraint_search,
            self._finished,
            self._node_points,
            config.num_threads,
            max_backlog=None if wait_for_searches else MAX_BACKLOG,
        )
        self._found = GrowingArray((), FOUND)
        self.found_after: list[int] = []
        self.num_put_off = 0
        self.adjustments: list[AdjustmentRun] = []
        self.rejected = NO_CLOSURES
        self._requests = SearchRequests(config.constraint_search)
        self._submap_nodes: list[set[int]] = []
        self._tf_local_last_submap = IDENTITY
        self._tf_map_local = IDENTITY

    @property
    def tf_map_local(self) -> Pose:
        """Where the local frame lies in the map since the last adjustment."""
        return self._tf_map_local

    @property
    def found(self) -> Closures:
        """The loop closures so far, in the order in which they joined the graph; read only."""
        return self._found.view

    @property
    def node_points(self) -> ScanPoints:
        """The returns of each node so far [m], tracking frame; to be read only."""
        return self._node_points.view

    @property
    def num_loop_closures(self) -> int:
        """How many loop closures the graph holds."""
        return self.graph.num_loop_closures

    def add_node(self, node: Node) -> None:
        """Add a scan that was inserted; seek it where it may close a loop; adjust when due."""
        self._add_to_graph(node)
        finished = None if node.finished is None else self._finish(node.finished)
        every = self._config.optimize_every_n_nodes
        if every == 0:
            return
        self._seek_node(node.index)
        if finished is not None:
            self._seek_in(finished)
        if self.graph.num_nodes % every == 0:
            self.adjust(self._config.pose_adjustment.max_num_iterations)
        often = SEARCHES_A_PERIOD if self._waits else SEARCHES_A_LIVE_PERIOD
        if self.graph.num_nodes % max(every // often, 1) == 0:
            if not self._waits:
                self._take_in_closures()
            self.search.start(put_off=self._waits)

    def adjust(self, max_num_iterations: int) -> None:
        """Take in the loop closures whose searches were started, and adjust all poses."""
        self._take_in_closures()
        self.num_put_off += self.search.num_running
        with self._timer.measure("adjust"):
            self._adjust(max_num_iterations)

    def finish(
        self, unfinished: Iterable[Submap], note: Callable[[str], None] | None = None
    ) -> None:
        """Close the last loops, then match all anew from the optimised poses and adjust once more.

        Parameters
        ----------
        unfinished : the submaps that are still active; no more scans will come.
        note : called with what comes next, in words, whenever poses may have changed.
        """
        tell = note or (lambda _: None)
        if self._config.optimize_every_n_nodes == 0 or self.graph.num_nodes == 0:
            return
        self._waits = True
        for submap in unfinished:
            self._seek_in(self._finish(submap))
        self.search.start()
        iterations = self._config.pose_adjustment.max_num_final_iterations
        tell("closing the last loops")
        self.adjust(iterations)
        passes = self._config.constraint_search.final_passes
        for number in range(1, passes + 1):
            tell(f"matching again, {number} of {passes}")
            with self._timer.measure("match again"):
                self._match_again()
            with self._timer.measure("adjust"):
                self._adjust(iterations)
        tell("last adjustment")
        with self._timer.measure("adjust"):
            self._reject_false_closures(iterations)

    def finished_grids(self) -> dict[int, FinishedGrid]:
        """Return the grids of the finished submaps by their index."""
        return {submap.index: submap.grid for submap in self._finished}

    def close(self) -> None:
        """End the background threads."""
        self.search.close()

    def _add_to_graph(self, node: Node) -> None:
        graph = self.graph
        pose = node.tf_local_tracking
        graph.add_node(compose(self._tf_map_local, pose))
        self._requests.add_node(node)
        self._node_points.append(node.points)
        for submap in node.submaps:
            if submap.index == graph.num_submaps:
                graph.add_submap(compose(self._tf_map_local, submap.tf_local_submap))
                self._tf_local_last_submap = submap.tf_local_submap
                self._submap_nodes.append(set())
                if submap.index == 0:
                    graph.fix_submap(0)
            self._submap_nodes[submap.index].add(node.index)
        information = self._config.pose_adjustment.intra_submap_weight * node.information
        graph.add_constraints(
            ConstraintKind.INTRA_SUBMAP,
            [submap.index for submap in node.submaps],
            [node.index for _ in node.submaps],
            [relative(submap.tf_local_submap, pose) for submap in node.submaps],
            [information for _ in node.submaps],
        )

    def _finish(self, submap: Submap) -> FinishedSubmap:
        with self._timer.measure("finish submap"):
            grid = submap.grid.finish()
            own = np.flatnonzero(
                (self.graph.index_a == submap.index)
                & (self.graph.kinds == ConstraintKind.INTRA_SUBMAP)
            )
            points = self.node_points.take(self.graph.index_b[own])
            own_score = mean_score(grid, points, self.graph.relative_poses[own])
            finished = FinishedSubmap(submap.index, grid, own_score)
        self._finished.append(finished)
        return finished

    def _seek_node(self, node: int) -> None:
        """Seek a node in all finished submaps near enough."""
        with self._timer.measure("select pairs"):
            self.search.submit(self._requests.of_node(self.graph, node, len(self._finished)))

    def _seek_in(self, submap: FinishedSubmap) -> None:
        """Seek all nodes near enough in a submap that has just been finished."""
        with self._timer.measure("select pairs"):
            self.search.submit(self._requests.in_submap(self.graph, submap.index))

    def _take_in_closures(self) -> None:
        """Add the loop closures that were found to the graph."""
        num_timed = len(self.search.durations)
        with self._timer.measure("wait for searches"):
            closures = self.search.collect(wait=self._waits)
        for duration in self.search.durations[num_timed:]:
            self._timer.record("search", duration)
        self._found.extend(closures)
        self._requests.note_found(closures)
        since = self.graph.num_nodes - closures["request"]["num_nodes"]
        self.found_after += since.tolist()
        add_closures(self.graph, closures)

    def _adjust(self, max_num_iterations: int) -> None:
        config = self._config.pose_adjustment
        options = AdjustmentOptions(
            loss=config.loss,
            loss_scale=config.loss_scale,
            max_iterations=max_num_iterations,
            relative_tolerance=config.tolerance,
        )
        start = perf_counter()
        if self._adjuster.graph is not self.graph:
            self._adjuster = PoseAdjuster(self.graph)
        done = self._adjuster.adjust(options)
        self.adjustments.append(
            AdjustmentRun(
                nodes=self.graph.num_nodes,
                submaps=self.graph.num_submaps,
                constraints=len(self.graph.kinds),
                iterations=done.iterations,
                ms=1e3 * (perf_counter() - start),
            )
        )
        newest = Pose(*self.graph.submap_poses[-1].tolist())
        self._tf_map_local = compose(newest, inverse(self._tf_local_last_submap))
        closures, is_violated = self._closures()
        self._requests.note_adjusted(self.graph, closures[~is_violated])

    def _closures(self) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
        """Return the loop closures, and which are violated by so much that they must be false."""
        closures = np.flatnonzero(self.graph.kinds == ConstraintKind.LOOP_CLOSURE)
        translation_error, rotation_error = constraint_residuals(self.graph, closures)
        return closures, (
            (translation_error > TRUE_TRANSLATION_M) | (rotation_error > TRUE_ROTATION_RAD)
        )

    def _reject_false_closures(self, max_num_iterations: int) -> None:
        """Drop the loop closures that the rest contradicts, and adjust without them."""
        closures, is_violated = self._closures()
        if is_violated.any():
            is_false = np.zeros(self.graph.num_constraints, dtype=bool)
            is_false[closures[is_violated]] = True
            self.rejected = closures_in(self.graph, is_false)
            self.graph = self.graph.without(is_false)
            self._adjust(max_num_iterations)

    def _match_again(self) -> None:
        """Replace the loop closures by matches from where the nodes stand now."""
        config, graph = self._config.constraint_search, self.graph

        def overlapping(index: int) -> IntArray:
            return refinement.overlapping_nodes(
                self._finished[index],
                graph.submap_poses[index],
                graph.node_poses,
                self._submap_nodes[index],
                config.final_every_nth_node,
            )

        def match_submap(index: int) -> Closures:
            submap, pose = self._finished[index], graph.submap_poses[index]
            found = refinement.match_again(
                submap, pose, nodes[index], graph.node_poses, self.node_points, config
            )
            submap.release()
            return found

        numbers = range(len(self._finished))
        nodes = refinement.in_nearest_submaps(
            list(self.search.map(overlapping, numbers)),
            graph.submap_poses,
            graph.node_poses,
            config.final_max_submaps_of_node,
        )
        matched = graph.without(graph.kinds == ConstraintKind.LOOP_CLOSURE)
        for closures in self.search.map(match_submap, numbers):
            add_closures(matched, closures)
        self.graph = matched  # only now: whoever stops the run meanwhile keeps what was found
