# SPDX-License-Identifier: Apache-2.0
"""The matches of composite scans in submaps of other parts, and what they claim about parts."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from cartoloop.arrays import IntArray
from cartoloop.config import ConstraintSearchConfig
from cartoloop.global_slam.claims import Claims
from cartoloop.global_slam.closure_matches import Requests
from cartoloop.global_slam.closure_search import FinishedSubmap
from cartoloop.global_slam.closures import Closures
from cartoloop.global_slam.composite_scans import CompositeScans
from cartoloop.global_slam.following import Expected, SeenAreas, expected_scans, is_same_pose
from cartoloop.global_slam.graph_records import WideOutcome
from cartoloop.global_slam.hypotheses import Candidate, best_place
from cartoloop.global_slam.join_records import NO_REQUESTS, JoinSearch
from cartoloop.global_slam.pose_graph import PoseGraph
from cartoloop.global_slam.sessions import SessionRanges
from cartoloop.global_slam.wide_search import SearchTask
from cartoloop.sensor.pose import Pose, compose_all


@dataclass(slots=True, eq=False)
class JoinTask(SearchTask):
    """The search of composite scans in one submap of another part.

    Attributes
    ----------
    scans : their numbers.
    requests : the window of each.
    """

    scans: IntArray = field(default_factory=lambda: np.zeros(0, np.int64))
    requests: Requests = NO_REQUESTS


class JoinMatches:
    """Keeps the matches between parts.

    Parameters
    ----------
    config, closures, submaps, scans, sessions : as of `joining.Joining`.

    Attributes
    ----------
    of_scan : the matches of each composite scan.
    """

    def __init__(
        self,
        config: ConstraintSearchConfig,
        closures: Closures,
        submaps: Sequence[FinishedSubmap],
        scans: CompositeScans,
        sessions: SessionRanges,
    ) -> None:
        self._config = config
        self._closures = closures
        self._submaps = submaps
        self._scans = scans
        self._sessions = sessions
        self._areas = SeenAreas(submaps)
        self.of_scan: dict[int, list[Candidate]] = {}

    def new_pairs(self, place: int, task: JoinTask, outcome: WideOutcome) -> JoinSearch:
        """Return the matches of a search, without pairs that were requested otherwise since."""
        if not outcome.candidates:
            return JoinSearch(place, outcome.min_score, [], NO_REQUESTS)
        rows = {scan: row for row, scan in enumerate(task.scans.tolist())}
        requests = task.requests.take(np.array([rows[each.scan] for each in outcome.candidates]))
        has_row = self._closures.has_rows(requests.submap, requests.node).tolist()
        kept = [
            i
            for i, each in enumerate(outcome.candidates)
            if not has_row[i] or self._known(each) is not None
        ]
        candidates = [outcome.candidates[i] for i in kept]
        return JoinSearch(
            place, outcome.min_score, candidates, requests.take(np.array(kept, dtype=np.int64))
        )

    def _known(self, candidate: Candidate) -> Candidate | None:
        """Return an earlier match of the same scan in the same submap, if there is one."""
        for each in self.of_scan.get(candidate.scan, []):
            if each.submap == candidate.submap:
                return each
        return None

    def note(self, search: JoinSearch, graph: PoseGraph) -> bool:
        """Note the matches of a search, if any: only they get a row in the record."""
        if not search.candidates:
            return False
        known = [self._known(each) for each in search.candidates]
        fresh = np.flatnonzero([each is None for each in known])
        new_rows = self._closures.request(search.requests.take(fresh), graph.num_nodes)
        self._closures.note_searched(new_rows, search.min_score)
        self._closures.note_hypotheses(new_rows)
        for row, i in zip(new_rows.tolist(), fresh.tolist(), strict=True):
            candidate = search.candidates[i]._replace(row=row)
            self.of_scan.setdefault(candidate.scan, []).append(candidate)
        for candidate, earlier in zip(search.candidates, known, strict=True):
            if earlier is not None:
                self._note_again(candidate._replace(row=earlier.row), earlier)
        return True

    def _note_again(self, candidate: Candidate, earlier: Candidate) -> None:
        """Note a match of a pair that has one, with a lower threshold near one place.

        Where the earlier search found no other place above its threshold, that threshold says
        nothing any more; where it did, that counts.
        """
        others = self.of_scan[candidate.scan]
        wide = self._config.wide_search
        if not is_same_pose(earlier.tf_submap_scan, candidate.tf_submap_scan, wide):
            others.append(candidate)
            return
        threshold = self._closures.min_score[earlier.row]
        had_rival = earlier.other_score > threshold + 1e-9
        other_score = max(candidate.other_score, earlier.other_score if had_rival else 0.0)
        others[others.index(earlier)] = earlier._replace(other_score=other_score)

    def expected_scans(
        self, pair: tuple[int, int], tf_one_other: Pose, graph: PoseGraph
    ) -> list[Expected]:
        """Return the scans of two parts that a place puts where the other one has seen."""
        nodes = self._scans.nodes
        node_parts = self._sessions.of_nodes(graph.num_nodes)[nodes]
        numbers = np.flatnonzero(np.isin(node_parts, pair))
        parts = self._sessions.of_submaps(len(self._submaps))
        codes = np.where(parts == pair[0], 0, np.where(parts == pair[1], 1, -1))
        codes[[not each.grid.size for each in self._submaps]] = -1
        scans = (numbers, graph.node_poses[nodes[numbers]], self._scans.points)
        scan_parts = (node_parts[numbers] == pair[1]).astype(np.int64)
        return expected_scans(
            tf_one_other, scans, scan_parts, (codes, graph.submap_poses), self._areas
        )

    def claims(self, graph: PoseGraph) -> dict[tuple[int, int], Claims]:
        """Return the hypotheses about each pair of parts: of each scan the best, if distinct."""
        distinct: dict[tuple[int, int], list[tuple[Candidate, float]]] = {}
        for pair, candidates in self._of_pairs(graph):
            poses = np.array([each.tf_submap_scan for each in candidates])
            submaps = np.array([each.submap for each in candidates])
            placed = compose_all(graph.submap_poses[submaps], poses)
            best, other_score = best_place(candidates, placed, self._config.wide_search)
            evidence = candidates[best].score - other_score
            if evidence >= self._config.join.min_margin:
                distinct.setdefault(pair, []).append((candidates[best], evidence))
        return {pair: self._claims(some, pair, graph) for pair, some in distinct.items()}

    def all_claims(self, graph: PoseGraph) -> dict[tuple[int, int], Claims]:
        """Return all matches between each pair of parts, also those that are not the best."""
        matches: dict[tuple[int, int], list[tuple[Candidate, float]]] = {}
        for pair, candidates in self._of_pairs(graph):
            matches.setdefault(pair, []).extend(
                (each, each.score - each.other_score) for each in candidates
            )
        return {pair: self._claims(some, pair, graph) for pair, some in matches.items()}

    def _of_pairs(self, graph: PoseGraph) -> Iterator[tuple[tuple[int, int], list[Candidate]]]:
        """Yield the matches of each composite scan in each other part, and the pair of parts."""
        scan_parts = self._sessions.of_nodes(graph.num_nodes)[self._scans.nodes].tolist()
        submap_parts = self._sessions.of_submaps(graph.num_submaps).tolist()
        for scan in sorted(self.of_scan):
            own = scan_parts[scan]
            by_part: dict[int, list[Candidate]] = {}
            for each in self.of_scan[scan]:
                by_part.setdefault(submap_parts[each.submap], []).append(each)
            for part in sorted(by_part):
                if part != own:
                    yield (min(own, part), max(own, part)), by_part[part]

    def _claims(
        self,
        matches: Sequence[tuple[Candidate, float]],
        pair: tuple[int, int],
        graph: PoseGraph,
    ) -> Claims:
        """Return matches, each with its evidence, as claims about two parts."""
        candidates = [candidate for candidate, _ in matches]
        nodes = self._scans.nodes[np.array([each.scan for each in candidates])]
        submaps = np.array([each.submap for each in candidates])
        own = graph.node_poses[nodes]
        placed = compose_all(
            graph.submap_poses[submaps], np.array([each.tf_submap_scan for each in candidates])
        )
        is_one = (self._sessions.of_nodes(graph.num_nodes)[nodes] == pair[0])[:, np.newaxis]
        return Claims(
            candidates,
            np.where(is_one, own, placed),
            np.where(is_one, placed, own),
            np.array([evidence for _, evidence in matches]),
        )

    def drop_within_parts(self, graph: PoseGraph) -> list[int]:
        """Forget the matches between what is one part by now; return their rows."""
        node_parts = self._sessions.of_nodes(graph.num_nodes)[self._scans.nodes]
        submap_parts = self._sessions.of_submaps(graph.num_submaps)
        dropped = []
        for scan, candidates in self.of_scan.items():
            is_within = [submap_parts[each.submap] == node_parts[scan] for each in candidates]
            pairs = list(zip(candidates, is_within, strict=True))
            dropped += [each.row for each, within in pairs if within]
            self.of_scan[scan] = [each for each, within in pairs if not within]
        return dropped

    def drop(self, candidate: Candidate) -> None:
        """Forget a match that became a closure."""
        left = [each for each in self.of_scan[candidate.scan] if each.row != candidate.row]
        self.of_scan[candidate.scan] = left
