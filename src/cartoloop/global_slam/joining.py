# SPDX-License-Identifier: Apache-2.0
"""The search for the relative pose of parts of a map that nothing connects, and their joining.

Composite scans of one part are searched in all submaps of the others, at all angles. What is found
makes placements (``placing``). The best one is tried in a copy of the graph: adjusted, matched
again where the parts overlap, and examined there. Parts are joined if the scans of each agree with
the submaps of the other. A wrong join is worse than none.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial

import numpy as np

from cartoloop.arrays import FloatArray, IntArray
from cartoloop.config import ConstraintSearchConfig
from cartoloop.global_slam.closure_matches import Requests
from cartoloop.global_slam.closure_search import FinishedSubmap
from cartoloop.global_slam.closures import Closures
from cartoloop.global_slam.composite_scans import CompositeScans
from cartoloop.global_slam.constraint_search import ConstraintSearch
from cartoloop.global_slam.graph_records import WideOutcome
from cartoloop.global_slam.hypotheses import Candidate, best_place
from cartoloop.global_slam.join_evidence import GeometryCheck, JoinAttempt, OnePose
from cartoloop.global_slam.join_records import (
    NO_REQUESTS,
    JoinSearch,
    join_searches_record,
    recorded_join_searches,
)
from cartoloop.global_slam.placing import Claim, placement, why_not_believed
from cartoloop.global_slam.pose_graph import PoseGraph
from cartoloop.global_slam.sessions import NodeSubmaps, SessionRanges
from cartoloop.global_slam.wide_search import SearchTask, find_scans
from cartoloop.journal.frames import Kind
from cartoloop.journal.outcomes import NO_OUTCOMES, RecordedOutcomes
from cartoloop.sensor.pose import compose_all, relative_all


class Joining:
    """Searches composite scans in the submaps of other parts, and decides which parts to join.

    Parameters
    ----------
    config : parameters.
    closures : the record; matches are noted in it.
    submaps : the finished submaps by their index; the owner adds to it.
    search : runs the searches in its background threads.
    scans : the composite scans; the owner adds to them.
    sessions : their parts.
    outcomes : of a run with a journal; those of earlier steps are replayed, new ones are recorded.

    Attributes
    ----------
    attempts : by pair of parts, the lower number first.
    """

    def __init__(
        self,
        config: ConstraintSearchConfig,
        closures: Closures,
        submaps: Sequence[FinishedSubmap],
        search: ConstraintSearch,
        scans: CompositeScans,
        sessions: SessionRanges,
        outcomes: RecordedOutcomes = NO_OUTCOMES,
    ) -> None:
        self._recorded = outcomes
        self._config = config
        self._closures = closures
        self._submaps = submaps
        self._search = search
        self._scans = scans
        self._sessions = sessions
        self._waiting: dict[int, list[int]] = {}
        self._running: list[SearchTask] = []
        self._searched: set[tuple[int, int]] = set()
        self._candidates: dict[int, list[Candidate]] = {}
        self._num_searches = 0
        self._num_judged = 0
        self._has_news = False
        self.known: OnePose | None = None
        self.attempts: dict[tuple[int, int], JoinAttempt] = {}

    @property
    def is_needed(self) -> bool:
        """Whether there are parts that nothing connects."""
        return len(set(self._sessions.parts)) > 1

    @property
    def room(self) -> int:
        """Number of searches that may still be made."""
        return self._config.join.max_searches - self._num_searches

    def request(self, scan: int, graph: PoseGraph) -> None:
        """Request the search of a composite scan in all submaps of the other parts."""
        node = int(self._scans.nodes[scan])
        if len(self._scans.points[scan]) < self._config.min_num_points:
            return
        own = int(self._sessions.of_nodes(graph.num_nodes)[node])
        parts = self._sessions.of_submaps(len(self._submaps))
        for submap in np.flatnonzero(parts != own).tolist():
            if self.room <= 0:
                return
            is_new = (scan, submap) not in self._searched and self._submaps[submap].grid.size
            if is_new and self._is_in_reach(submap, node, own, graph):
                self._searched.add((scan, submap))
                self._waiting.setdefault(submap, []).append(scan)
                self._num_searches += 1
                self._attempt(own, int(parts[submap])).num_searches += 1

    def request_round(self, number: int, graph: PoseGraph) -> bool:
        """Request the searches of a round; return whether there are any.

        The composite scans of all parts are spread over :data:`NUM_ROUNDS` rounds, so that the
        first ones lie all over the path: most parts are joined after a few.
        """
        before = self._num_searches
        for scan in range(len(self._scans)):
            if _round_of(scan) <= number:
                self.request(scan, graph)
        return self._num_searches > before

    def start(self, graph: PoseGraph) -> None:
        """Pass what was requested to the threads; returns immediately."""
        for submap, wanted in self._waiting.items():
            scans = np.array(wanted, dtype=np.int64)
            task = partial(
                find_scans,
                config=self._config.wide_search,
                scans=scans,
                rows=np.full(len(scans), -1, dtype=np.int32),
                points=self._scans.points.take(scans),
                requests=self._requests(submap, scans, graph),
                least=(self._config.join.min_score, self._config.join.min_score_ratio),
            )
            self._running.append(SearchTask(task, self._submaps[submap]))
        self._waiting = {}
        if not self._recorded.is_replaying:
            self._launch()

    def collect(self, graph: PoseGraph, *, wait: bool) -> list[float]:
        """Note what the searches found; return the time that each of them took [s]."""
        durations: list[float] = []
        if (recorded := self._recorded.replay(Kind.JOIN_SEARCHED)) is not None:
            searches = recorded_join_searches(recorded)
            for each in searches:
                self._note(each, graph)
        else:
            self._launch()
            searches = []
            for place, task in enumerate(self._running):
                if task.future is not None and (wait or task.future.done()):
                    outcome, duration = task.future.result()
                    searches.append(self._new_pairs(place, outcome, graph))
                    self._note(searches[-1], graph)
                    durations.append(duration)
            if self._recorded.is_recording and (searches or self._recorded.is_replayable):
                self._recorded.record(Kind.JOIN_SEARCHED, join_searches_record(searches))
        taken = frozenset(each.place for each in searches)
        self._running = [task for i, task in enumerate(self._running) if i not in taken]
        return durations

    def best(self, graph: PoseGraph) -> JoinAttempt | None:
        """Return the attempt with the most evidence that can be believed; None without any."""
        if not (self._has_news or self._num_judged < self._num_searches):
            return None
        self._num_judged = self._num_searches
        best: JoinAttempt | None = None
        all_claims = self._claims(graph)
        for pair in sorted(self.attempts):
            claims = all_claims.get(pair, [])
            attempt = self._attempt(*pair)
            join, wide = self._config.join, self._config.wide_search
            attempt.found = placement(claims, attempt.refused, join, wide)
            why_not = why_not_believed(attempt.found, join, wide)
            if why_not or attempt.found is None:
                attempt.why_not = _with_refused(why_not, attempt)
            elif (
                best is None or best.found is None or (attempt.found.evidence > best.found.evidence)
            ):
                best = attempt
        if best is None:
            self._has_news = False
        return best

    def joined(self, attempt: JoinAttempt) -> None:
        """Note that two parts are one from now on."""
        attempt.why_not = ""
        self._sessions.join(attempt.other, attempt.one)
        self._has_news = True
        self.attempts = {
            pair: other for pair, other in self.attempts.items() if attempt.other not in pair
        }
        assert attempt.found is not None
        for claim in attempt.found.claims:
            self._drop(claim.candidate)

    def refuse(self, attempt: JoinAttempt, check: GeometryCheck) -> None:
        """Note that the geometry contradicts the placement of an attempt."""
        assert attempt.found is not None
        attempt.check, attempt.why_not = check, check.fault
        attempt.refused.append(attempt.found.tf_one_other)

    def _drop(self, candidate: Candidate) -> None:
        left = [each for each in self._candidates[candidate.scan] if each.row != candidate.row]
        self._candidates[candidate.scan] = left

    def _attempt(self, part: int, other: int) -> JoinAttempt:
        pair = (min(part, other), max(part, other))
        return self.attempts.setdefault(pair, JoinAttempt(*pair))

    def _expected(self, submap: int, nodes: IntArray, graph: PoseGraph) -> FloatArray:
        """Return where nodes of the part whose pose is known are in a submap, shape (n, 3)."""
        assert self.known is not None
        tf_main_node = compose_all(np.array(self.known.tf_main_part), graph.node_poses[nodes])
        return relative_all(graph.submap_poses[submap], tf_main_node)

    def _is_in_reach(self, submap: int, node: int, part: int, graph: PoseGraph) -> bool:
        """Return whether a node may be in a submap, by what is known of its part."""
        if self.known is None or self.known.part != part:
            return True
        ((x, y, _),) = self._expected(submap, np.array([node]), graph).tolist()
        box, reach = self._submaps[submap].grid, self._config.join.known_pose_window
        width, height = box.shape[1] * box.resolution, box.shape[0] * box.resolution
        is_inside: bool = (
            -reach <= x - box.origin_x <= width + reach
            and -reach <= y - box.origin_y <= height + reach
        )
        return is_inside

    def _requests(self, submap: int, scans: IntArray, graph: PoseGraph) -> Requests:
        """Return the searches of composite scans in one submap: anywhere, or where it is known."""
        nodes = self._scans.nodes[scans]
        grid = self._submaps[submap].grid
        half = 0.5 * grid.resolution * np.array((grid.shape[1], grid.shape[0]))
        centre = (grid.origin_x + half[0], grid.origin_y + half[1], 0.0)
        expected = np.tile(np.array(centre), (len(scans), 1))
        linear = np.full(len(scans), float(half.max()))
        angular = np.full(len(scans), math.pi)
        own = NodeSubmaps.of(graph).first[nodes]
        if self.known is not None:
            is_known = self._sessions.of_nodes(graph.num_nodes)[nodes] == self.known.part
            expected[is_known] = self._expected(submap, nodes[is_known], graph)
            linear[is_known] = self._config.join.known_pose_window
            angular[is_known] = math.radians(self._config.join.known_pose_window_deg)
        return Requests(
            np.full(len(scans), submap, dtype=np.int32),
            nodes.astype(np.int32),
            own.astype(np.int32),
            expected,
            linear,
            angular,
        )

    def _launch(self) -> None:
        """Start the searches that were not, since their outcomes might have been recorded."""
        for each in self._running:
            if each.future is None:
                each.future = self._search.run(each.find, each.submap)

    def _new_pairs(self, place: int, outcome: WideOutcome, graph: PoseGraph) -> JoinSearch:
        """Return the matches of a search, without pairs that were requested otherwise since."""
        if not outcome.candidates:
            return JoinSearch(place, outcome.min_score, [], NO_REQUESTS)
        submap = outcome.candidates[0].submap
        scans = np.array([each.scan for each in outcome.candidates], dtype=np.int64)
        requests = self._requests(submap, scans, graph)
        fresh = np.flatnonzero(~self._closures.has_rows(requests.submap, requests.node))
        candidates = [outcome.candidates[i] for i in fresh.tolist()]
        return JoinSearch(place, outcome.min_score, candidates, requests.take(fresh))

    def _note(self, search: JoinSearch, graph: PoseGraph) -> None:
        """Note the matches of a search: only they get a row in the record."""
        if not search.candidates:
            return
        rows = self._closures.request(search.requests, graph.num_nodes)
        self._closures.note_searched(rows, search.min_score)
        self._closures.note_hypotheses(rows)
        for row, candidate in zip(rows.tolist(), search.candidates, strict=True):
            self._candidates.setdefault(candidate.scan, []).append(candidate._replace(row=row))
            self._has_news = True

    def _claims(self, graph: PoseGraph) -> dict[tuple[int, int], list[Claim]]:
        """Return the hypotheses about each pair of parts."""
        node_parts = self._sessions.of_nodes(graph.num_nodes)
        submap_parts = self._sessions.of_submaps(graph.num_submaps)
        claims: dict[tuple[int, int], list[Claim]] = {}
        for scan in sorted(self._candidates):
            node = int(self._scans.nodes[scan])
            own = int(node_parts[node])
            for part in sorted({int(submap_parts[each.submap]) for each in self._candidates[scan]}):
                if part == own:
                    continue
                candidates = [
                    each for each in self._candidates[scan] if submap_parts[each.submap] == part
                ]
                claim = self._claim(candidates, graph, graph.node_poses[node], is_one=own < part)
                if claim is not None:
                    claims.setdefault((min(own, part), max(own, part)), []).append(claim)
        return claims

    def _claim(
        self,
        candidates: Sequence[Candidate],
        graph: PoseGraph,
        tf_own_scan: FloatArray,
        *,
        is_one: bool,
    ) -> Claim | None:
        """Return the claim that one composite scan makes about another part; None if unclear."""
        wide, join = self._config.wide_search, self._config.join
        poses = np.array([each.tf_submap_scan for each in candidates])
        submaps = np.array([each.submap for each in candidates])
        placed = compose_all(graph.submap_poses[submaps], poses)
        best, other_score = best_place(candidates, placed, wide)
        evidence = candidates[best].score - other_score
        if evidence < join.min_margin:
            return None
        one, other = (tf_own_scan, placed[best]) if is_one else (placed[best], tf_own_scan)
        return Claim(candidates[best], one.copy(), other.copy(), evidence)


def _with_refused(why_not: str, attempt: JoinAttempt) -> str:
    """Return why parts are not joined: because of what the geometry contradicted, if anything."""
    if attempt.refused and attempt.check is not None:
        return attempt.check.fault
    return why_not


def _round_of(scan: int) -> int:
    """Return in which round a composite scan is searched."""
    return _ROUND_OF_PLACE[scan % len(_ROUND_OF_PLACE)]


_ROUND_OF_PLACE = (0, 3, 2, 3, 1, 3, 2, 3)

NUM_ROUNDS = 4
"""Rounds in which the composite scans are searched."""
