# SPDX-License-Identifier: Apache-2.0
"""Global SLAM (section V): nodes and submaps into the pose graph, loop closures, adjustment."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from time import perf_counter

import numpy as np
from numpy.typing import NDArray

from cartoloop.config import GlobalSlamConfig
from cartoloop.global_slam import refinement
from cartoloop.global_slam.closure_matches import Requests, SearchMatches
from cartoloop.global_slam.closure_search import FinishedSubmap, mean_score
from cartoloop.global_slam.closures import Closures
from cartoloop.global_slam.constraint_search import ConstraintSearch
from cartoloop.global_slam.pair_selection import PairSelection
from cartoloop.global_slam.pose_adjustment import (
    AdjustmentOptions,
    PoseAdjuster,
    constraint_residuals,
)
from cartoloop.global_slam.pose_graph import (
    TRUE_ROTATION_RAD,
    TRUE_TRANSLATION_M,
    ClosureConstraints,
    ConstraintKind,
    PoseGraph,
)
from cartoloop.global_slam.wide_search import WideSearch
from cartoloop.runtime.stage_timer import StageTimer
from cartoloop.sensor.pose import IDENTITY, Pose, compose, inverse, relative
from cartoloop.sensor.scan_points import NodePoints, ScanPoints
from cartoloop.submaps.finished_grid import FinishedGrid
from cartoloop.submaps.node import Node
from cartoloop.submaps.submap import Submap


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


class GlobalSlam:
    """Keeps the pose graph and the record of closures, closes loops and adjusts.

    Parameters
    ----------
    config : its parameters.
    timer : takes its times.
    wait_for_searches : whether an adjustment waits for the searches that were started before it,
        so that the result is always the same. Otherwise what is found joins when it is found, and
        requests beyond ``max_live_backlog`` are dropped.

    Attributes
    ----------
    graph : pose graph; its loop closures refer to rows of `closures`.
    closures : the record of all pairs that were requested or matched.
    search : the background search.
    adjustments : runs of pose adjustment so far.
    num_put_off : searches that were started and not done when the graph was adjusted.
    """

    def __init__(
        self, config: GlobalSlamConfig, timer: StageTimer, *, wait_for_searches: bool = True
    ) -> None:
        self._config = config
        self._timer = timer
        self._waits_while_mapping = wait_for_searches
        self.graph = PoseGraph()
        self.closures = Closures()
        self._adjuster = PoseAdjuster(self.graph)
        self._adjusted_revision = self.graph.revision
        self._finished: list[FinishedSubmap] = []
        self._node_points = NodePoints()
        self.search = ConstraintSearch(
            config.constraint_search,
            self.closures,
            self._finished,
            self._node_points,
            config.num_threads,
            max_backlog=None if wait_for_searches else config.max_live_backlog,
        )
        self.num_put_off = 0
        self.adjustments: list[AdjustmentRun] = []
        self._pairs = PairSelection(config.constraint_search)
        self._wide = WideSearch(
            config.constraint_search, self.closures, self._finished, self.search
        )
        self._submap_nodes: list[set[int]] = []
        self._tf_local_last_submap = IDENTITY
        self._tf_map_local = IDENTITY

    @property
    def tf_map_local(self) -> Pose:
        """Pose of the local frame in the map since the last adjustment."""
        return self._tf_map_local

    @property
    def node_points(self) -> ScanPoints:
        """The returns of each node so far [m], tracking frame; read only."""
        return self._node_points.view

    @property
    def num_loop_closures(self) -> int:
        """Number of loop closures in the graph."""
        return self.graph.num_loop_closures

    def add_node(self, node: Node) -> None:
        """Add a scan that was inserted; request searches for it; adjust when due."""
        self._add_to_graph(node)
        finished = None if node.finished is None else self._finish(node.finished)
        every = self._config.optimize_every_n_nodes
        if every == 0:
            return
        waits = self._waits_while_mapping
        self._request_node(node.index)
        self._request_wide(self._wide.add_node(node, self.node_points))
        if finished is not None:
            self._request_nodes_in(finished)
        if self.graph.num_nodes % every == 0:
            self._close_loops(self._config.pose_adjustment.max_num_iterations, wait=waits)
        config = self._config
        searches = config.searches_per_adjustment if waits else config.live_searches_per_adjustment
        period = max(every // searches, 1)
        if self.graph.num_nodes % period == 0:
            if not waits:
                self._take_in_closures(wait=False)
            self.search.start(may_defer=waits)
            self._wide.release()
            # Offline, it is early enough to start once before the adjustment that needs them.
            if not waits or self.graph.num_nodes % every + period >= every:
                self._wide.start()

    def finish(
        self, unfinished: Iterable[Submap], note: Callable[[str], None] | None = None
    ) -> None:
        """Close the last loops, then match all pairs again from adjusted poses and adjust again.

        Parameters
        ----------
        unfinished : the submaps that are still active; no more scans will come.
        note : called with the name of the next step, whenever poses may have changed.
        """
        announce = note or (lambda _: None)
        if self._config.optimize_every_n_nodes == 0 or self.graph.num_nodes == 0:
            return
        for submap in unfinished:
            self._request_nodes_in(self._finish(submap))
        self.search.start()
        self._wide.start()
        iterations = self._config.pose_adjustment.max_num_final_iterations
        announce("closing the last loops")
        self._close_loops(iterations, wait=True)
        self._search_until_nothing_new(iterations)
        passes = self._config.constraint_search.final_passes
        for number in range(1, passes + 1):
            announce(f"matching again, {number} of {passes}")
            with self._timer.measure("match again"):
                self._match_again()
            with self._timer.measure("adjust"):
                self._adjust(iterations)
        announce("last adjustment")
        with self._timer.measure("adjust"):
            self._remove_contradicted(iterations)

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
        self._pairs.add_node(node)
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

    def _request_node(self, node: int) -> None:
        """Request searches for a node in the finished submaps nearby."""
        with self._timer.measure("select pairs"):
            self._submit(self._pairs.of_node(self.graph, node, len(self._finished)))

    def _request_nodes_in(self, submap: FinishedSubmap) -> None:
        """Request searches in a submap that has just been finished, for the nodes nearby."""
        with self._timer.measure("select pairs"):
            self._submit(self._pairs.in_submap(self.graph, submap.index))

    def _request_wide(self, scan: int | None) -> None:
        """Request searches for a composite scan wherever the drift may have placed it."""
        if scan is not None:
            with self._timer.measure("select pairs"):
                self._wide.request(scan, self._pairs, self.graph)

    def _request_again(self) -> None:
        """Request searches for the pairs that are due by now and were not before."""
        with self._timer.measure("select pairs"):
            self._submit(self._pairs.again(self.graph, len(self._finished), self.closures))

    def _search_until_nothing_new(self, max_num_iterations: int) -> None:
        """Search all that is due, and adjust, until that finds no more closures."""
        wide = self._config.constraint_search.wide_search
        for _ in range(wide.max_final_rounds):
            before = self.graph.num_loop_closures
            num_requested = len(self.closures)
            self._request_again()
            for scan in range(self._wide.num_scans):
                self._request_wide(scan)
            if len(self.closures) == num_requested:
                break
            self.search.start()
            self._wide.release()
            self._wide.start()
            self._close_loops(max_num_iterations, wait=True)
            if self.graph.num_loop_closures == before:
                break

    def _submit(self, requests: Requests) -> None:
        if len(requests.submap):
            self.search.submit(self.closures.request(requests, self.graph.num_nodes))

    def _close_loops(self, max_num_iterations: int, *, wait: bool) -> None:
        """Take in the loop closures that searches found, and adjust all poses."""
        self._take_in_closures(wait=wait)
        self.num_put_off += self.search.num_running
        with self._timer.measure("adjust"):
            self._adjust(max_num_iterations)
        self._believe_hypotheses(max_num_iterations, wait=wait)

    def _believe_hypotheses(self, max_num_iterations: int, *, wait: bool) -> None:
        """Take in the sets of hypotheses that agree, adjust, and request what is due then."""
        with self._timer.measure("wait for searches"):
            durations = self._wide.collect(wait=wait)
        for duration in durations:
            self._timer.record("search", duration)
        is_new = False
        while (found := self._wide.decide(self._pairs, self.graph)) is not None:
            self._add_closures(found, are_trusted=True)
            with self._timer.measure("adjust"):
                self._adjust(max_num_iterations)
            is_new = True
        if is_new:
            self._request_again()

    def _take_in_closures(self, *, wait: bool) -> None:
        """Add the loop closures that were found to the record and to the graph."""
        num_timed = len(self.search.durations)
        with self._timer.measure("wait for searches"):
            found = self.search.collect(wait=wait)
        for duration in self.search.durations[num_timed:]:
            self._timer.record("search", duration)
        if len(found.row):
            self._add_closures(found, are_trusted=False)

    def _add_closures(self, found: SearchMatches, *, are_trusted: bool) -> None:
        """Add loop closures to the record and to the graph."""
        submaps, nodes = self.closures.submap[found.row], self.closures.node[found.row]
        self.closures.add_found(found, self.graph.num_nodes)
        self._pairs.note_found(submaps, nodes)
        self.graph.add_loop_closures(
            ClosureConstraints(found.row, submaps, nodes, found.tf_submap_node, found.information),
            are_trusted=are_trusted,
        )

    def _adjust(self, max_num_iterations: int) -> None:
        config = self._config.pose_adjustment
        options = AdjustmentOptions(
            loss=config.loss,
            loss_scale=config.loss_scale,
            max_iterations=max_num_iterations,
            relative_tolerance=config.tolerance,
        )
        start = perf_counter()
        if self._adjusted_revision != self.graph.revision:
            self._adjuster = PoseAdjuster(self.graph)
            self._adjusted_revision = self.graph.revision
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
        closures, is_violated = self._violated_closures()
        self._distrust_strained(closures)
        holds = ~is_violated | self.graph.is_trusted[closures]
        self._pairs.note_adjusted(self.graph, closures[holds])

    def _distrust_strained(self, closures: NDArray[np.int64]) -> None:
        """Leave trusted closures that the rest of the graph contradicts to the robust loss.

        Two hypotheses that agreed may be false all the same. Later closures show that.
        """
        trusted = closures[self.graph.is_trusted[closures]]
        if len(trusted) == 0:
            return
        wide = self._config.constraint_search.wide_search
        translation_error, rotation_error = constraint_residuals(self.graph, trusted)
        is_strained = (translation_error > wide.max_strain) | (
            rotation_error > math.radians(wide.max_strain_deg)
        )
        if is_strained.any():
            self.graph.is_trusted[trusted[is_strained]] = False
            # The adjuster assumes that constraints stay as they are.
            self._adjuster = PoseAdjuster(self.graph)

    def _violated_closures(self) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
        """Return the constraints that are loop closures, and which of them must be false."""
        closures = np.flatnonzero(self.graph.kinds == ConstraintKind.LOOP_CLOSURE)
        translation_error, rotation_error = constraint_residuals(self.graph, closures)
        return closures, (
            (translation_error > TRUE_TRANSLATION_M) | (rotation_error > TRUE_ROTATION_RAD)
        )

    def _remove_contradicted(self, max_num_iterations: int) -> None:
        """Remove the loop closures that the other constraints contradict, and adjust again."""
        closures, is_violated = self._violated_closures()
        if is_violated.any():
            is_false = np.zeros(self.graph.num_constraints, dtype=bool)
            is_false[closures[is_violated]] = True
            self.closures.note_contradicted(self.graph.closure_rows[is_false])
            self.graph.remove(is_false)
            self._adjust(max_num_iterations)

    def _match_again(self) -> None:
        """Replace the loop closures by matches from the adjusted poses."""
        last_pass = refinement.LastPass(
            self._config.constraint_search,
            self.graph,
            self._finished,
            self._submap_nodes,
            self.node_points,
        )
        last_pass.run(self.closures, self.search)
