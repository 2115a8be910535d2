# SPDX-License-Identifier: Apache-2.0
"""Global SLAM (section V): nodes and submaps into the pose graph, loop closures, adjustment."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np

from cartoloop.config import GlobalSlamConfig
from cartoloop.global_slam import refinement
from cartoloop.global_slam.closure_requests import ClosureRequests
from cartoloop.global_slam.constraint_search import ConstraintSearch
from cartoloop.global_slam.graph_adjustment import AdjustmentRun
from cartoloop.global_slam.graph_building import GraphBuilder
from cartoloop.global_slam.join_evidence import CheckGeometry, OnePose
from cartoloop.global_slam.loading import load
from cartoloop.global_slam.loop_closing import LoopClosing
from cartoloop.global_slam.pair_selection import PairSelection
from cartoloop.global_slam.part_joins import PartJoins
from cartoloop.global_slam.parts_left import join_parts_left
from cartoloop.global_slam.repair import FindContradictions, Repair, Repaired, add_closures
from cartoloop.global_slam.restoring import restore
from cartoloop.global_slam.session_ends import SessionEnds
from cartoloop.global_slam.sessions import MappedSessions
from cartoloop.global_slam.wide_search import WideSearch, record_requests
from cartoloop.journal.outcomes import NO_OUTCOMES, RecordedOutcomes
from cartoloop.runtime.stage_timer import StageTimer
from cartoloop.sensor.pose import IDENTITY, Pose
from cartoloop.sensor.scan_points import ScanPoints
from cartoloop.submaps.finished_grid import FinishedGrid
from cartoloop.submaps.node import Node
from cartoloop.submaps.submap import Submap


class GlobalSlam:
    """Keeps the pose graph and the record of closures, closes loops and adjusts.

    Parameters
    ----------
    config : its parameters.
    timer : takes its times.
    outcomes : of a run with a journal; those of earlier steps are replayed, new ones are recorded.
    wait_for_searches : whether an adjustment waits for the searches that were started before it,
        so that the result is always the same. Otherwise what is found joins when it is found, and
        requests beyond ``max_live_backlog`` are dropped.
    mapped : maps that mapping goes on from. Each is in a frame of its own; `begin_session` follows,
        if there is something to be mapped.
    check_geometry : examines parts before they are joined; without it, nothing is joined.

    Attributes
    ----------
    graph : pose graph; its loop closures refer to rows of `closures`.
    closures : the record of all pairs that were requested or matched.
    search : the background search.
    sessions : where each session begins, and the connected part that it belongs to.
    joins : finds the relative poses of parts that nothing connects.
    num_put_off : searches that were started and not done when the graph was adjusted.
    repaired : what made visits agree that contradicted each other; None: nothing.
    """

    def __init__(
        self,
        config: GlobalSlamConfig,
        timer: StageTimer,
        outcomes: RecordedOutcomes = NO_OUTCOMES,
        *,
        wait_for_searches: bool = True,
        mapped: Sequence[MappedSessions] = (),
        check_geometry: CheckGeometry | None = None,
    ) -> None:
        self._recorded = outcomes
        self._config = config
        self._timer = timer
        self._waits_while_mapping = wait_for_searches
        self.graph, self.closures, self.sessions = load(mapped)
        weight = config.pose_adjustment.intra_submap_weight
        self._builder = GraphBuilder(self.graph, weight, timer, outcomes)
        self._finished = self._builder.finished
        self.search = ConstraintSearch(
            config.constraint_search,
            self.closures,
            self._finished,
            self._builder.node_points,
            config.num_threads,
            max_backlog=None if wait_for_searches else config.max_live_backlog,
            outcomes=outcomes,
        )
        self.num_put_off = 0
        self.repaired: Repaired | None = None
        self._pairs = PairSelection(config.constraint_search)
        self._closing = LoopClosing(
            config,
            self.graph,
            self.closures,
            self.sessions,
            self._builder,
            self._pairs,
            timer,
            outcomes,
        )
        self._wide = WideSearch(
            config.constraint_search, self.closures, self._finished, self.search, outcomes
        )
        self.joins = PartJoins(
            config,
            self.closures,
            self._finished,
            self.search,
            self._wide.scans,
            self.sessions,
            check_geometry,
            outcomes,
        )
        self._request = ClosureRequests(
            self.graph,
            self._finished,
            self._pairs,
            self._wide,
            self.search,
            self.closures,
            timer,
            outcomes,
        )
        self._ends = SessionEnds(config, self._finished, self.sessions, check_geometry)
        if mapped:
            self._builder.submap_nodes = restore(
                mapped,
                self.graph,
                self.closures,
                self.sessions,
                self._pairs,
                self._wide,
                self._builder.node_points,
                self._finished,
            )
        else:
            self.begin_session()

    @property
    def adjustments(self) -> Sequence[AdjustmentRun]:
        """The runs of pose adjustment so far."""
        return self._closing.runs

    @property
    def tf_map_local(self) -> Pose:
        """Pose of the local frame in the map since the last adjustment."""
        return self._closing.tf_map_local

    @property
    def node_points(self) -> ScanPoints:
        """The returns of each node so far [m], tracking frame; read only."""
        return self._builder.node_points.view

    def summary(self) -> dict[str, Any]:
        """Return what the report says of closures, joins and repairs."""
        repaired = {} if self.repaired is None else self.repaired.summary()
        return self.closures.summary() | self.joins.summary() | repaired

    @property
    def num_loop_closures(self) -> int:
        """Number of loop closures in the graph."""
        return self.graph.num_loop_closures

    def begin_session(self, tf_map_local: Pose | None = None) -> None:
        """Begin the next session, not connected to the others.

        Parameters
        ----------
        tf_map_local : where its local frame is in the main part, if that is about known.
        """
        part = self.sessions.begin(self.graph.num_nodes, self.graph.num_submaps)
        self._pairs.begin_session()
        self._wide.begin_session()
        self._closing.tf_map_local = IDENTITY
        if tf_map_local is not None:
            self.joins.joining.known = OnePose(part, tf_map_local)

    def add_node(self, node: Node) -> None:
        """Add a scan that was inserted; request searches for it; adjust when due."""
        self._builder.add_node(node, self.tf_map_local)
        self._pairs.add_node(node)
        finished = None if node.finished is None else self._builder.finish(node.finished)
        every = self._config.optimize_every_n_nodes
        if every == 0:
            return
        waits = self._waits_while_mapping
        scan = self._wide.add_node(node, self.node_points)
        if self._pairs.was_lost:
            # Both searches want pairs across the gap: the wide one comes first.
            self._request.wide(scan)
            self._request.of_node(node.index)
        else:
            self._request.of_node(node.index)
            self._request.wide(scan)
        if scan is not None and self.joins.is_needed:
            self.joins.joining.request(scan, self.graph)
        if finished is not None:
            self._request.in_submap(finished)
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
            self.joins.joining.start(self.graph)

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
            self._request.in_submap(self._builder.finish(submap))
        self.search.start()
        self._wide.start()
        iterations = self._config.pose_adjustment.max_num_final_iterations
        announce("closing the last loops")
        self._close_loops(iterations, wait=True)
        join_parts_left(
            self.joins, self.graph, lambda: self._close_loops(iterations, wait=True), announce
        )
        self._search_until_nothing_new(iterations)
        if self._hold_ends(iterations):
            self._search_until_nothing_new(iterations)
        passes = self._config.constraint_search.final_passes
        for number in range(1, passes + 1):
            announce(f"matching again, {number} of {passes}")
            self._match_again()
            self._closing.settle(iterations)
        announce("last adjustment")
        self._closing.remove_contradicted(iterations, weigh_chain=True)

    def repair(self, find: FindContradictions) -> bool:
        """Make visits agree that contradict each other in the finished map; return whether any do.

        Parameters
        ----------
        find : examines the map with other poses.
        """
        if self._config.optimize_every_n_nodes == 0:
            return False
        with self._timer.measure("repair"):
            repair = Repair(self._config, self._finished, self.node_points, self.search)
            repaired = repair.run(self.graph, find)
        if repaired is None:
            return False
        self.repaired = repaired
        iterations = self._config.pose_adjustment.max_num_final_iterations
        self.graph.node_poses[:] = repaired.graph.node_poses
        self.graph.submap_poses[:] = repaired.graph.submap_poses
        for _ in range(self._config.constraint_search.final_passes):
            self._match_again()
            added = repaired.without_matched(self.graph)
            add_closures(self.graph, added, self.closures.note_repaired(added))
            self._closing.settle(iterations)
        self._closing.remove_contradicted(iterations, weigh_chain=False)
        return True

    def finished_grids(self) -> dict[int, FinishedGrid]:
        """Return the grids of the finished submaps by their index."""
        return {submap.index: submap.grid for submap in self._finished}

    def close(self) -> None:
        """End the background threads."""
        self.search.close()

    def _search_until_nothing_new(self, max_num_iterations: int) -> None:
        """Search all that is due, and adjust, until that finds no more closures."""
        wide = self._config.constraint_search.wide_search
        for _ in range(wide.max_final_rounds):
            before = self.graph.num_loop_closures
            self._request.again()
            for scan in range(self._wide.num_scans):
                self._request.wide(scan)
            # What was requested when the last closures joined waits, too.
            if not (self.search.num_waiting or self._wide.num_waiting):
                break
            self.search.start()
            self._wide.release()
            self._wide.start()
            self._close_loops(max_num_iterations, wait=True)
            if self.graph.num_loop_closures == before:
                break

    def _hold_ends(self, max_num_iterations: int) -> bool:
        """Add the closures of ends of sessions in corridors, and adjust; return whether any is."""
        before = self.graph.num_loop_closures
        for held in self._ends.closures(self.graph, self._pairs, self.node_points):
            is_new = ~self.closures.has_rows(held.requests.submap, held.requests.node)
            requests, found, min_score = held.take(np.flatnonzero(is_new))
            rows = record_requests(self._recorded, self.closures, requests, self.graph.num_nodes)
            self.closures.note_searched(rows, min_score)
            self._closing.believe(found._replace(row=rows), max_num_iterations)
        return self.graph.num_loop_closures > before

    def _close_loops(self, max_num_iterations: int, *, wait: bool) -> None:
        """Take in the loop closures that searches found, and adjust all poses."""
        self._take_in_closures(wait=wait)
        self.num_put_off += self.search.num_running
        self._closing.adjust(max_num_iterations)
        self._believe_hypotheses(max_num_iterations, wait=wait)

    def _believe_hypotheses(self, max_num_iterations: int, *, wait: bool) -> None:
        """Take in the sets of hypotheses that agree, adjust, and request what is due then."""
        with self._timer.measure("wait for searches"):
            durations = self._wide.collect(wait=wait)
        for duration in durations:
            self._timer.record("search", duration)
        is_new = False
        while (found := self._wide.decide(self._pairs, self.graph)) is not None:
            self._closing.believe(found, max_num_iterations)
            is_new = True
        if is_new:
            self._request.again()
        if self.joins.is_needed:
            self._join_parts(max_num_iterations, wait=wait)

    def _join_parts(self, max_num_iterations: int, *, wait: bool) -> None:
        """Join the parts whose relative pose is known by now, adjust, and request what is due."""
        with self._timer.measure("wait for searches"):
            durations = self.joins.joining.collect(self.graph, wait=wait)
        for duration in durations:
            self._timer.record("search", duration)
        with self._timer.measure("join parts"):
            while (join := self.joins.next(self.graph, self.node_points)) is not None:
                self._closing.join(join, max_num_iterations)
                self._request.again()
                if not self.joins.is_needed:
                    break
            self._wide.search_again(self.joins.joining.drop_within_parts(self.graph))

    def _take_in_closures(self, *, wait: bool) -> None:
        """Add the loop closures that were found to the record and to the graph."""
        num_timed = len(self.search.durations)
        with self._timer.measure("wait for searches"):
            found = self.search.collect(wait=wait)
        for duration in self.search.durations[num_timed:]:
            self._timer.record("search", duration)
        if len(found.row):
            self._closing.add(found, are_trusted=False)

    def _match_again(self) -> None:
        """Replace the loop closures by matches from the adjusted poses."""
        last_pass = refinement.LastPass(
            self._config.constraint_search,
            self.graph,
            self._finished,
            self._builder.submap_nodes,
            self.node_points,
            self.sessions,
        )
        with self._timer.measure("match again"):
            last_pass.run(self.closures, self.search)
