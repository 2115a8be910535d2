# SPDX-License-Identifier: Apache-2.0
"""The search for the relative pose of parts of a map that nothing connects, and their joining.

Composite scans of one part are searched in all submaps of the others, at all angles. What is found
makes placements (``placing``). The best one is tried in a copy of the graph: adjusted, matched
again where the parts overlap, and examined there. Parts are joined if the scans of each agree with
the submaps of the other. A wrong join is worse than none.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from functools import partial

import numpy as np

from cartoloop.arrays import FloatArray, IntArray
from cartoloop.config import ConstraintSearchConfig
from cartoloop.global_slam.claims import Claims
from cartoloop.global_slam.closure_matches import Requests
from cartoloop.global_slam.closure_search import FinishedSubmap
from cartoloop.global_slam.closures import Closures
from cartoloop.global_slam.composite_scans import CompositeScans
from cartoloop.global_slam.constraint_search import ConstraintSearch
from cartoloop.global_slam.following import (
    MIN_SCORE,
    MIN_SCORE_RATIO,
    WINDOW_M,
    WINDOW_RAD,
    Expected,
    followed_places,
)
from cartoloop.global_slam.join_evidence import (
    GeometryCheck,
    JoinAttempt,
    OnePose,
)
from cartoloop.global_slam.join_matches import JoinMatches, JoinTask
from cartoloop.global_slam.join_records import (
    join_searches_record,
    recorded_join_searches,
)
from cartoloop.global_slam.judging import Judging
from cartoloop.global_slam.placing import placement, why_not_believed
from cartoloop.global_slam.pose_graph import PoseGraph
from cartoloop.global_slam.rivals import reason, reopen
from cartoloop.global_slam.sessions import NodeSubmaps, SessionRanges
from cartoloop.global_slam.wide_search import find_scans
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
    follows : whether places are followed by now: what agrees is believed with stricter limits.
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
        self._submaps = submaps
        self._search = search
        self._scans = scans
        self._sessions = sessions
        self._waiting: dict[int, list[int]] = {}
        self._running: list[JoinTask] = []
        self._searched: set[tuple[int, int]] = set()
        self._matches = JoinMatches(config, closures, submaps, scans, sessions)
        self._judging = Judging(config, self._matches)
        self._num_searches = 0
        self._num_judged = 0
        self._has_news = False
        self._followed: set[tuple[int, int, int, int]] = set()
        self.follows = False
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

    def request(
        self, scan: int, graph: PoseGraph, left_out: Collection[tuple[int, int]] = ()
    ) -> None:
        """Request the search of a composite scan in all submaps of the other parts.

        Parameters
        ----------
        left_out : pairs of parts that are not searched.
        """
        node = int(self._scans.nodes[scan])
        if len(self._scans.points[scan]) < self._config.min_num_points:
            return
        own = int(self._sessions.of_nodes(graph.num_nodes)[node])
        parts = self._sessions.of_submaps(len(self._submaps))
        for submap in np.flatnonzero(parts != own).tolist():
            if self.room <= 0:
                return
            other = int(parts[submap])
            if (min(own, other), max(own, other)) in left_out:
                continue
            is_new = (scan, submap) not in self._searched and self._submaps[submap].grid.size
            if is_new and self._is_in_reach(submap, node, own, graph):
                self._searched.add((scan, submap))
                self._waiting.setdefault(submap, []).append(scan)
                self._num_searches += 1
                self._attempt(own, int(parts[submap])).num_searches += 1

    def request_round(self, number: int, graph: PoseGraph) -> bool:
        """Request the searches of a round; return whether there are any.

        The composite scans of all parts are spread over :data:`NUM_ROUNDS` rounds, so that the
        first ones lie all over the path: most parts are joined after a few. Two long parts
        are not searched further where no two scans agree by then.
        """
        before = self._num_searches
        left_out = self._unlikely(graph) if number >= FIRST_LIKELY_ROUND else frozenset()
        for scan in range(len(self._scans)):
            if _round_of(scan) <= number:
                self.request(scan, graph, left_out)
        return self._num_searches > before

    def _unlikely(self, graph: PoseGraph) -> frozenset[tuple[int, int]]:
        """Return the pairs of long parts where no two scans agree on a place so far."""
        unlikely = set()
        claims = self._matches.claims(graph)
        for pair, attempt in self.attempts.items():
            found = placement(claims.get(pair, ()), (), self._config.join, self._config.wide_search)
            is_likely = found is not None and len(found.claims) > 1
            attempt.is_cut_short = not is_likely and not self._is_short(pair, graph)
            if attempt.is_cut_short:
                unlikely.add(pair)
        return frozenset(unlikely)

    def follow(self, graph: PoseGraph) -> bool:
        """Request searches near where the likeliest places put the scans of parts left apart.

        Returns whether there are any. Places that were refused are followed, too, and are examined
        again if there is anything to be searched: a part that is held at one end fits at the other
        one only when scans there hold it as well.
        """
        near: dict[tuple[int, int], list[Expected]] = {}
        times: dict[tuple[int, int], int] = {}
        for pair, claims in sorted(self._matches.all_claims(graph).items()):
            if not self._is_short(pair, graph):
                continue
            for pose in followed_places(claims, self._config.wide_search):
                is_new = False
                for each in self._matches.expected_scans(pair, pose, graph):
                    x, y, _ = each.tf_submap_scan.tolist()
                    key = (each.scan, each.submap, round(x / WINDOW_M), round(y / WINDOW_M))
                    if key not in self._followed:
                        self._followed.add(key)
                        is_new = True
                        time = times[key[:2]] = times.get(key[:2], -1) + 1
                        near.setdefault((each.submap, time), []).append(each)
                if is_new:
                    reopen(self._attempt(*pair), pose, claims, self._config.wide_search)
        # A scan near two places of a submap is in two tasks.
        for (submap, _), expected in near.items():
            scans = np.array([each.scan for each in expected])
            count = len(scans)
            requests = self._requests(submap, scans, graph)._replace(
                tf_submap_node=np.array([each.tf_submap_scan for each in expected]),
                linear_window=np.full(count, WINDOW_M),
                angular_window=np.full(count, WINDOW_RAD),
            )
            self._add_task(submap, scans, requests, (MIN_SCORE, MIN_SCORE_RATIO))
        self.follows = self.follows or bool(near)
        return bool(near)

    def _is_short(self, pair: tuple[int, int], graph: PoseGraph) -> bool:
        """Return whether one of two parts is so short that few of its scans can be distinct."""
        parts = self._sessions.of_nodes(graph.num_nodes)[self._scans.nodes]
        return min(int(np.count_nonzero(parts == part)) for part in pair) <= MAX_FOLLOWED_SCANS

    def start(self, graph: PoseGraph) -> None:
        """Pass what was requested to the threads; returns immediately."""
        least = (self._config.join.min_score, self._config.join.min_score_ratio)
        for submap, wanted in self._waiting.items():
            scans = np.array(wanted, dtype=np.int64)
            self._add_task(submap, scans, self._requests(submap, scans, graph), least)
        self._waiting = {}
        if not self._recorded.is_replaying:
            self._launch()

    def _add_task(
        self, submap: int, scans: IntArray, requests: Requests, least: tuple[float, float]
    ) -> None:
        """Note a search that is to be started."""
        task = partial(
            find_scans,
            config=self._config.wide_search,
            scans=scans,
            rows=np.full(len(scans), -1, dtype=np.int32),
            points=self._scans.points.take(scans),
            requests=requests,
            least=least,
        )
        self._running.append(JoinTask(task, self._submaps[submap], scans=scans, requests=requests))

    def collect(self, graph: PoseGraph, *, wait: bool) -> list[float]:
        """Note what the searches found; return the time that each of them took [s]."""
        durations: list[float] = []
        if (recorded := self._recorded.replay(Kind.JOIN_SEARCHED)) is not None:
            searches = recorded_join_searches(recorded)
            for each in searches:
                self._has_news |= self._matches.note(each, graph)
        else:
            self._launch()
            searches = []
            for place, task in enumerate(self._running):
                if task.future is not None and (wait or task.future.done()):
                    outcome, duration = task.future.result()
                    searches.append(self._matches.new_pairs(place, task, outcome))
                    self._has_news |= self._matches.note(searches[-1], graph)
                    durations.append(duration)
            if self._recorded.is_recording and (searches or self._recorded.is_replayable):
                self._recorded.record(Kind.JOIN_SEARCHED, join_searches_record(searches))
        taken = frozenset(each.place for each in searches)
        self._running = [task for i, task in enumerate(self._running) if i not in taken]
        return durations

    def best(self, graph: PoseGraph) -> JoinAttempt | None:
        """Return the attempt that can be believed with the most evidence; None without any."""
        if not (self._has_news or self._num_judged < self._num_searches):
            return None
        self._num_judged = self._num_searches
        believed: list[tuple[int, float, JoinAttempt]] = []
        all_claims = self._matches.claims(graph)
        every_match = self._short_pairs_matches(graph) if self.follows else {}
        for pair in sorted(self.attempts):
            attempt = self._attempt(*pair)
            mine = (all_claims.get(pair, ()), every_match.get(pair, ()))
            why_not = self._judging.why_not(attempt, *mine, graph, follows=self.follows)
            if why_not or attempt.found is None:
                attempt.why_not = reason(why_not, attempt)
            else:
                believed.append((-attempt.strictness, attempt.found.evidence, attempt))
        # Evidence of scans that are distinct and of others cannot be compared.
        best = max(believed, key=lambda each: each[:2], default=None)
        if best is None:
            self._has_news = False
            return None
        return best[2]

    def _short_pairs_matches(self, graph: PoseGraph) -> dict[tuple[int, int], Claims]:
        """Return all matches between the parts whose places are followed."""
        matches = self._matches.all_claims(graph)
        return {pair: matches[pair] for pair in matches if self._is_short(pair, graph)}

    def leave_undecided(self, attempt: JoinAttempt, check: GeometryCheck) -> None:
        """Note that the geometry allows a placement, but that another place fits, too."""
        assert attempt.found is not None
        join, wide = self._config.join, self._config.wide_search
        attempt.check, attempt.why_not = check, why_not_believed(attempt.found, join, wide)
        attempt.undecided.append(attempt.examined(check))

    def joined(self, attempt: JoinAttempt) -> None:
        """Note that two parts are one from now on."""
        attempt.why_not = ""
        self._sessions.join(attempt.other, attempt.one)
        self._has_news = True
        # A part that has grown and was adjusted may fit where it did not.
        for each in self.attempts.values():
            if attempt.one in (each.one, each.other):
                each.refused.clear()
                each.undecided.clear()
        self.attempts = {
            pair: other for pair, other in self.attempts.items() if attempt.other not in pair
        }
        assert attempt.found is not None
        for claim in attempt.found.claims:
            self._matches.drop(claim.candidate)

    def drop_within_parts(self, graph: PoseGraph) -> list[int]:
        """Forget the matches between what is one part by now; return their rows."""
        return self._matches.drop_within_parts(graph)

    def refuse(self, attempt: JoinAttempt, check: GeometryCheck) -> None:
        """Note that the geometry contradicts the placement of an attempt."""
        assert attempt.found is not None
        attempt.check, attempt.why_not = check, check.fault
        attempt.refused.append(attempt.examined(check))

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


def _round_of(scan: int) -> int:
    """Return in which round a composite scan is searched."""
    return _ROUND_OF_PLACE[scan % len(_ROUND_OF_PLACE)]


_ROUND_OF_PLACE = (0, 3, 2, 3, 1, 3, 2, 3)

NUM_ROUNDS = 4
"""Rounds in which the composite scans are searched."""

FIRST_LIKELY_ROUND = 2
"""From this round on long parts are searched only if two scans agree: a quarter was searched."""

MAX_FOLLOWED_SCANS = 40
"""Places are followed where one of the parts has no more composite scans: 160 m of path. Of longer
parts, enough scans score high at all angles if the parts overlap; following takes minutes there."""

MAX_FOLLOWING = 4
"""Times that the places of parts left apart are followed: each join may show others."""
