# SPDX-License-Identifier: Apache-2.0
"""Joins parts of the graph that nothing connects: which, where, and with what evidence."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from hashlib import sha256
from typing import Any, NamedTuple

import numpy as np

from cartoloop.config import GlobalSlamConfig
from cartoloop.global_slam.closure_matches import SearchMatches
from cartoloop.global_slam.closure_search import FinishedSubmap
from cartoloop.global_slam.closures import Closures
from cartoloop.global_slam.composite_scans import CompositeScans
from cartoloop.global_slam.constraint_search import ConstraintSearch
from cartoloop.global_slam.join_evidence import (
    CheckGeometry,
    GeometryCheck,
    JoinAttempt,
    Nearby,
    Strictness,
    TwoParts,
)
from cartoloop.global_slam.join_records import (
    NO_NEARBY,
    JoinDecision,
    join_decision_record,
    recorded_join_decision,
    with_rows,
)
from cartoloop.global_slam.joining import Joining
from cartoloop.global_slam.pose_graph import PoseGraph
from cartoloop.global_slam.sessions import SessionRanges
from cartoloop.global_slam.tentative_join import place_part, tentative_joins
from cartoloop.global_slam.wide_search import refined
from cartoloop.journal.frames import Kind
from cartoloop.journal.outcomes import NO_OUTCOMES, RecordedOutcomes
from cartoloop.sensor.pose import Pose
from cartoloop.sensor.scan_points import ScanPoints


class Join(NamedTuple):
    """Two parts that are joined.

    Attributes
    ----------
    attempt : the evidence.
    found : the closures that hold the parts together.
    nearby : closures of nodes that were searched nearby, which may be false.
    """

    attempt: JoinAttempt
    found: SearchMatches
    nearby: SearchMatches


@dataclass(frozen=True, slots=True)
class JoinRecord:
    """What is known of the relative pose of two groups of sessions, for the report.

    Attributes
    ----------
    one, other : numbers of their sessions.
    joined : whether they are one part now.
    attempt : the evidence, and why not.
    """

    one: tuple[int, ...]
    other: tuple[int, ...]
    joined: bool
    attempt: JoinAttempt

    def to_dict(self) -> dict[str, Any]:
        """Return it as values of JSON."""
        content: dict[str, Any] = {
            "sessions": [list(self.one), list(self.other)],
            "joined": self.joined,
            "why_not": self.attempt.explanation,
            "searches": self.attempt.num_searches,
        }
        if (found := self.attempt.found) is not None:
            content |= {
                "agreeing_scans": len(found.claims),
                "evidence": round(found.evidence, 4),
                "rival_evidence": round(found.rival, 4),
                "extent_m": round(found.extent, 3),
            }
        if (check := self.attempt.check) is not None:
            content |= {
                "overlap_m": round(check.length, 3),
                "contradicted_m": round(check.contradicted, 3),
                "returns_on_walls": check.on_wall,
                "returns_on_floor": check.on_floor,
            }
        return content


class PartJoins:
    """Decides which parts are joined, and places them.

    Parameters
    ----------
    config : parameters.
    closures, submaps, search, scans, sessions : as of `Joining`.
    check : examines the geometry; without it nothing is joined.
    outcomes : of a run with a journal; those of earlier steps are replayed, new ones are recorded.

    Attributes
    ----------
    joining : the search.
    done : the joins so far.
    """

    def __init__(
        self,
        config: GlobalSlamConfig,
        closures: Closures,
        submaps: Sequence[FinishedSubmap],
        search: ConstraintSearch,
        scans: CompositeScans,
        sessions: SessionRanges,
        check: CheckGeometry | None,
        outcomes: RecordedOutcomes = NO_OUTCOMES,
    ) -> None:
        self._recorded = outcomes
        self._config = config
        self._closures = closures
        self._submaps = submaps
        self._scans = scans
        self._sessions = sessions
        self._check = check
        self.joining = Joining(
            config.constraint_search, closures, submaps, search, scans, sessions, outcomes
        )
        self.done: list[JoinRecord] = []
        self._known: dict[_Evidence, tuple[GeometryCheck, Nearby]] = {}
        self._known_graph: tuple[int, int, bytes] | None = None

    @property
    def is_needed(self) -> bool:
        """Whether there are parts that nothing connects, and joins can be examined."""
        return self._check is not None and self.joining.is_needed

    def next(self, graph: PoseGraph, node_points: ScanPoints) -> Join | None:
        """Place the next part that can be joined to another, in place; None if there is none.

        Its closures have to be added.
        """
        while (attempt := self.joining.best(graph)) is not None:
            assert attempt.found is not None and self._check is not None
            candidates = [claim.candidate for claim in attempt.found.claims]
            search = self._config.constraint_search
            found = refined(candidates, self._scans.points, self._submaps, search)
            parts = self._two_parts(attempt, graph, node_points)
            check, nearby = self._examined(attempt, found, parts)
            if check.fault:
                self.joining.refuse(attempt, check)
                continue
            if attempt.is_ambiguous:
                self.joining.leave_undecided(attempt, check)
                continue
            attempt.check = check
            self.done.append(self._record(attempt, joined=True))
            place_part(parts, attempt.found.tf_one_other)
            self.joining.joined(attempt)
            return Join(attempt, found, with_rows(nearby, self._closures, graph.num_nodes))
        return None

    def _examined(
        self, attempt: JoinAttempt, found: SearchMatches, parts: TwoParts
    ) -> tuple[GeometryCheck, Nearby]:
        """Return how well two parts agree where they are placed, with these closures between them.

        And the matches that were searched for that. The parts are not placed yet, and stay as they
        are.
        """
        if (recorded := self._recorded.replay(Kind.JOIN_DECIDED)) is not None:
            decision = recorded_join_decision(recorded)
            return decision.check, decision.nearby
        assert attempt.found is not None and self._check is not None
        placed = attempt.found.tf_one_other
        known, evidence = self._known_examinations(parts), _evidence_of(attempt)
        if evidence not in known:
            known[evidence] = self._examine(attempt, found, parts)
        check, nearby = known[evidence]
        if self._recorded.is_recording:
            decision = JoinDecision(
                attempt.one,
                attempt.other,
                placed,
                check,
                found,
                nearby,
                is_joined=not check.fault and not attempt.is_ambiguous,
            )
            self._recorded.record(Kind.JOIN_DECIDED, join_decision_record(decision))
        return check, nearby

    def _examine(
        self, attempt: JoinAttempt, found: SearchMatches, parts: TwoParts
    ) -> tuple[GeometryCheck, Nearby]:
        """Return how well two parts agree in the best of the shapes that a join gives them."""
        assert attempt.found is not None and self._check is not None
        candidates = [claim.candidate for claim in attempt.found.claims]
        of_submap = np.array([each.submap for each in candidates], dtype=np.int64)
        of_node = self._scans.nodes[np.array([each.scan for each in candidates])]
        closures = (found, of_submap, of_node)
        for joined, searched in tentative_joins(
            self._config, parts, attempt.found.tf_one_other, closures
        ):
            check = self._check(joined, attempt.strictness)
            if not check.fault:
                return check, searched
        return check, NO_NEARBY

    def _known_examinations(self, parts: TwoParts) -> dict[_Evidence, tuple[GeometryCheck, Nearby]]:
        """Return what examinations of the graph as it is have found.

        Places that were refused are examined again after more was searched there. Where nothing
        was found, neither the evidence nor the graph differ, and what was found before stands.
        """
        graph, digest = parts.graph, sha256()
        for poses in (graph.node_poses, graph.submap_poses):
            digest.update(poses.tobytes())
        state = graph.num_constraints, graph.revision, digest.digest()
        if state != self._known_graph:
            self._known, self._known_graph = {}, state
        return self._known

    def summary(self) -> dict[str, list[dict[str, Any]]]:
        """Return what was joined, and what was not and why, for the report; empty if nothing."""
        left = [self._record(attempt, joined=False) for attempt in self.joining.attempts.values()]
        records = [record.to_dict() for record in (*self.done, *left)]
        return {"joins": records} if records else {}

    def _record(self, attempt: JoinAttempt, *, joined: bool) -> JoinRecord:
        return JoinRecord(
            self._sessions.in_part(attempt.one),
            self._sessions.in_part(attempt.other),
            joined,
            attempt,
        )

    def _two_parts(
        self, attempt: JoinAttempt, graph: PoseGraph, node_points: ScanPoints
    ) -> TwoParts:
        """Return the two parts of an attempt."""
        codes = []
        for parts in (
            self._sessions.of_nodes(graph.num_nodes),
            self._sessions.of_submaps(graph.num_submaps),
        ):
            code = np.full(len(parts), -1)
            code[parts == attempt.one], code[parts == attempt.other] = 0, 1
            codes.append(code)
        return TwoParts(graph, self._submaps, node_points, *codes)


_Evidence = tuple[int, int, Strictness, Pose, tuple[tuple[int, int, bytes], ...]]
"""By which an examination is known: the parts, how strictly, where, and by which matches."""


def _evidence_of(attempt: JoinAttempt) -> _Evidence:
    """Return by what the best placement of an attempt is supported."""
    assert attempt.found is not None
    matches = [claim.candidate for claim in attempt.found.claims]
    return (
        attempt.one,
        attempt.other,
        attempt.strictness,
        attempt.found.tf_one_other,
        tuple((each.scan, each.submap, each.tf_submap_scan.tobytes()) for each in matches),
    )
