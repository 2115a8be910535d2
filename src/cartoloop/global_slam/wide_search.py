# SPDX-License-Identifier: Apache-2.0
"""The search for loop closures where the drift is large: composite scans in all submaps in reach.

The window follows from the drift along the shortest path between the two, without an upper limit.
What is found is a hypothesis (``hypotheses``); sets of hypotheses that agree become closures, which
the pose adjustment trusts: a robust loss would keep a few of them from moving a long chain.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Future
from dataclasses import dataclass
from functools import partial
from time import perf_counter

import numpy as np

from cartoloop.arrays import IntArray, RowArray
from cartoloop.config import ConstraintSearchConfig, WideSearchConfig
from cartoloop.global_slam.closure_matches import Requests, SearchMatches
from cartoloop.global_slam.closure_search import FinishedSubmap, refine_all
from cartoloop.global_slam.closures import Closures
from cartoloop.global_slam.composite_scans import CompositeScans
from cartoloop.global_slam.constraint_search import ConstraintSearch
from cartoloop.global_slam.graph_records import (
    WideOutcome,
    recorded_wide_outcomes,
    requests_record,
    wide_record,
)
from cartoloop.global_slam.hypotheses import Candidate, Hypothesis, best_place, consistent_set
from cartoloop.global_slam.pair_selection import PairSelection
from cartoloop.global_slam.pose_graph import PoseGraph
from cartoloop.journal.frames import Kind
from cartoloop.journal.outcomes import NO_OUTCOMES, RecordedOutcomes
from cartoloop.scan_matching.branch_and_bound import UNLIMITED, RunnerUp
from cartoloop.scan_matching.least_squares import match_informations
from cartoloop.sensor.pose import Pose, compose_all, wrap_angles
from cartoloop.sensor.scan_points import ScanPoints
from cartoloop.submaps.node import Node, is_lost

MAX_EXPANDED = 30_000
"""Nodes of its tree that the search of a composite scan may expand. Dense recordings need fewer,
some scans of sparse ones more. Where a scan fits nearly as well everywhere, the search would take
minutes, and no place would be distinct."""


@dataclass(slots=True, eq=False)
class SearchTask:
    """The search of composite scans in one submap.

    Attributes
    ----------
    find : returns what it comes to, and how long it took [s].
    submap : where to search.
    future : of the result; None: not started.
    """

    find: Callable[[FinishedSubmap], tuple[WideOutcome, float]]
    submap: FinishedSubmap
    future: Future[tuple[WideOutcome, float]] | None = None


class WideSearch:
    """Searches composite scans, and decides what of it is believed.

    Parameters
    ----------
    config : parameters.
    closures : the record; requests and what became of them are noted in it.
    submaps : the finished submaps by their index; the owner adds to it.
    search : runs the searches in its background threads.
    outcomes : of a run with a journal; those of earlier steps are replayed, new ones are recorded.
    """

    def __init__(
        self,
        config: ConstraintSearchConfig,
        closures: Closures,
        submaps: Sequence[FinishedSubmap],
        search: ConstraintSearch,
        outcomes: RecordedOutcomes = NO_OUTCOMES,
    ) -> None:
        self._recorded = outcomes
        self._all = config
        self._config = config.wide_search
        self._closures = closures
        self._submaps = submaps
        self._search = search
        self._scans = CompositeScans(self._config)
        self._waiting: list[tuple[int, int, int]] = []
        self._released: list[tuple[int, int, int]] = []
        self._running: list[SearchTask] = []
        self._candidates: dict[int, list[Candidate]] = {}
        self._of_other_parts: set[int] = set()
        self._has_news = False

    @property
    def num_scans(self) -> int:
        """Number of composite scans so far."""
        return len(self._scans)

    @property
    def num_waiting(self) -> int:
        """Number of searches that were requested and not started."""
        return len(self._waiting) + len(self._released)

    @property
    def scans(self) -> CompositeScans:
        """The composite scans so far."""
        return self._scans

    def begin_session(self) -> None:
        """Note that the next node is the first of another session."""
        self._scans.begin_session()

    def add_node(self, node: Node, node_points: ScanPoints) -> int | None:
        """Note the next node; return the number of the composite scan that it completes, if any."""
        was_lost = is_lost(node.information)
        return self._scans.add_node(node.tf_local_tracking, node_points, was_lost=was_lost)

    def restore_node(
        self, tf_local_node: Pose, node_points: ScanPoints, *, was_lost: bool = False
    ) -> None:
        """Note a node of an earlier session."""
        self._scans.add_node(tf_local_node, node_points, was_lost=was_lost)

    def request(self, scan: int, pairs: PairSelection, graph: PoseGraph) -> None:
        """Request the search of a composite scan in the submaps where the drift may place it."""
        node = int(self._scans.nodes[scan])
        if len(self._scans.points[scan]) < self._all.min_num_points:
            return
        found = pairs.wide_pairs(graph, node, self._submaps)
        if len(found.submap) == 0:
            return
        own = np.flatnonzero(self._closures.node == node)
        row_of = dict(zip(self._closures.submap[own].tolist(), own.tolist(), strict=True))
        rows = np.array([row_of.get(submap, -1) for submap in found.submap.tolist()])
        again = np.flatnonzero([row in self._of_other_parts for row in rows.tolist()])
        if len(again):
            self._of_other_parts.difference_update(rows[again].tolist())
            self._closures.request_again(rows[again], found.take(again))
        new = np.flatnonzero(rows < 0)
        if len(new):
            rows[new] = record_requests(
                self._recorded, self._closures, found.take(new), graph.num_nodes
            )
        for i in np.concatenate((new, again)).tolist():
            self._waiting.append((int(found.submap[i]), scan, int(rows[i])))

    def search_again(self, rows: Iterable[int]) -> None:
        """Let pairs that were searched as of two parts be requested: by now the parts are one.

        They were searched at all angles, where most places look like others. In the window that the
        drift allows, the true one may be distinct.
        """
        self._of_other_parts.update(rows)

    def release(self) -> None:
        """Let the next `start` pass what was requested so far to the threads."""
        self._released += self._waiting
        self._waiting = []

    def start(self) -> None:
        """Pass what was released to the threads, one task for each submap; returns immediately.

        The fewer the calls, the less often grids are computed for a few scans.
        """
        tasks: dict[int, list[tuple[int, int]]] = {}
        for submap, scan, row in self._released:
            tasks.setdefault(submap, []).append((scan, row))
        self._released = []
        for submap, wanted in tasks.items():
            scans, rows = np.array(wanted).T
            requests = self._closures.requests(rows)
            points = self._scans.points.take(scans)
            task = partial(
                find_scans,
                config=self._config,
                scans=scans,
                rows=rows,
                points=points,
                requests=requests,
                least=(self._config.min_score, self._config.min_score_ratio),
                max_expanded=MAX_EXPANDED,
            )
            self._running.append(SearchTask(task, self._submaps[submap]))
        if not self._recorded.is_replaying:
            self._launch()

    def collect(self, *, wait: bool) -> list[float]:
        """Note what the searches found; return the time that each of them took [s].

        Parameters
        ----------
        wait : for all that were started; otherwise unfinished ones are left for the next call.
        """
        durations: list[float] = []
        if (recorded := self._recorded.replay(Kind.WIDE_SEARCHED)) is not None:
            places, outcomes = recorded_wide_outcomes(recorded)
        else:
            self._launch()
            places, outcomes = [], []
            for place, task in enumerate(self._running):
                if task.future is not None and (wait or task.future.done()):
                    outcome, duration = task.future.result()
                    places.append(place)
                    outcomes.append(outcome)
                    durations.append(duration)
            if self._recorded.is_recording and (outcomes or self._recorded.is_replayable):
                self._recorded.record(Kind.WIDE_SEARCHED, wide_record(places, outcomes))
        taken = frozenset(places)
        self._running = [task for i, task in enumerate(self._running) if i not in taken]
        for outcome in outcomes:
            self._note(outcome)
        return durations

    def _launch(self) -> None:
        """Start the searches that were not, since their outcomes might have been recorded."""
        for each in self._running:
            if each.future is None:
                each.future = self._search.run(each.find, each.submap)

    def decide(self, pairs: PairSelection, graph: PoseGraph) -> SearchMatches | None:
        """Return closures of the best set of hypotheses that agree, None if there is none.

        Hypotheses about what the graph knows well by now are dropped.
        """
        if not self._has_news:
            return None
        chosen = consistent_set(self._hypotheses(pairs, graph), self._config)
        if chosen is None:
            self._has_news = False
            return None
        for each in chosen:
            self._candidates.pop(each.candidate.scan)
        candidates = [each.candidate for each in chosen]
        return refined(candidates, self._scans.points, self._submaps, self._all)

    def _hypotheses(self, pairs: PairSelection, graph: PoseGraph) -> list[Hypothesis]:
        """Return the composite scans whose place is distinct, in the order of the path."""
        config, scans = self._config, self._scans
        travelled, tf_local_scan = scans.travelled, scans.tf_local_scan
        distinct = []
        for scan in sorted(self._candidates):
            candidates = self._candidates[scan]
            poses = np.array([each.tf_submap_scan for each in candidates])
            submaps = np.array([each.submap for each in candidates])
            tf_map_scan = compose_all(graph.submap_poses[submaps], poses)
            best, other_score = best_place(candidates, tf_map_scan, config)
            chosen = candidates[best]
            node = int(scans.nodes[scan])
            if pairs.path_length(graph, chosen.submap, node) < config.min_path_length:
                del self._candidates[scan]
                continue
            evidence = chosen.score - other_score
            if evidence >= config.min_margin:
                distinct.append(
                    Hypothesis(
                        chosen, tf_map_scan[best], tf_local_scan[scan], travelled[scan], evidence
                    )
                )
        return distinct

    def _note(self, outcome: WideOutcome) -> None:
        self._closures.note_searched(outcome.rows, outcome.min_score)
        for candidate in outcome.candidates:
            self._candidates.setdefault(candidate.scan, []).append(candidate)
            self._has_news = True
        matched = np.array([candidate.row for candidate in outcome.candidates], dtype=np.int32)
        self._closures.note_hypotheses(matched)


def find_scans(
    submap: FinishedSubmap,
    config: WideSearchConfig,
    scans: IntArray,
    rows: RowArray,
    points: ScanPoints,
    requests: Requests,
    least: tuple[float, float],
    max_expanded: int = UNLIMITED,
) -> tuple[WideOutcome, float]:
    """Return where composite scans fit in one submap, and how long that took [s].

    Parameters
    ----------
    submap : to be searched.
    config : what counts as another place.
    scans, rows : numbers of the scans, and their rows in the record.
    points : the returns of these scans.
    requests : the windows.
    least : lowest score, and lowest share of the score of the submap's own scans; the lower counts.
    max_expanded : number of nodes of its tree that the search of a scan may expand.
    """
    start = perf_counter()
    min_score = min(least[0], least[1] * submap.own_score)
    if submap.is_sparse:
        min_score = max(min_score, config.min_score)  # in wider walls all places score higher
    found = submap.matcher.match_all(
        points,
        requests.tf_submap_node,
        linear_windows=requests.linear_window,
        angular_windows=requests.angular_window,
        min_score=min_score,
        groups=np.arange(len(scans)),
        max_of_group=1,
        runner_up=RunnerUp(
            config.place_distance, math.radians(config.place_angle_deg), RUNNER_UP_MARGIN
        ),
        max_expanded=max_expanded,
    )
    candidates = [
        Candidate(
            int(rows[i]),
            int(scans[i]),
            submap.index,
            np.array(match.tf_submap_scan),
            match.score,
            max(match.runner_up, min_score),
        )
        for i, match in enumerate(found.matches)
        if match is not None
    ]
    return WideOutcome(rows, min_score, candidates), perf_counter() - start


def refined(
    candidates: Sequence[Candidate],
    scans: ScanPoints,
    submaps: Sequence[FinishedSubmap],
    config: ConstraintSearchConfig,
) -> SearchMatches:
    """Return the closures of candidates that are believed.

    Parameters
    ----------
    scans : the returns of all composite scans.
    submaps : by their index.
    """
    return _together([_refined(each, scans, submaps, config) for each in candidates])


def _refined(
    candidate: Candidate,
    scans: ScanPoints,
    submaps: Sequence[FinishedSubmap],
    config: ConstraintSearchConfig,
) -> SearchMatches:
    scan = scans.take(np.array([candidate.scan]))
    start = candidate.tf_submap_scan[np.newaxis]
    fine = refine_all(submaps[candidate.submap].smooth_map, scan, start, config, math.inf)
    poses = fine.tf_submap_scan.copy()
    poses[:, 2] = wrap_angles(poses[:, 2])
    moved = fine.tf_submap_scan - start
    return SearchMatches(
        row=np.array([candidate.row], dtype=np.int32),
        tf_submap_node=poses,
        information=match_informations(fine.information, fine.residual),
        residual=fine.residual,
        score=np.array([candidate.score]),
        runner_up=np.array([candidate.other_score]),
        moved_m=np.hypot(moved[:, 0], moved[:, 1]),
        moved_rad=np.abs(wrap_angles(moved[:, 2])),
    )


def record_requests(
    outcomes: RecordedOutcomes, closures: Closures, requests: Requests, num_nodes: int
) -> RowArray:
    """Add requests to the record of closures and to the journal; return their rows."""
    if outcomes.replay(Kind.REQUESTS) is None and outcomes.is_recording:
        outcomes.record(Kind.REQUESTS, requests_record(requests, num_nodes))
    return closures.request(requests, num_nodes)


def _together(matches: Sequence[SearchMatches]) -> SearchMatches:
    return SearchMatches._make(map(np.concatenate, zip(*matches, strict=True)))


RUNNER_UP_MARGIN = 0.1
"""A runner-up worse by more is of no interest: the match is distinct."""
