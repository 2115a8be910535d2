# SPDX-License-Identifier: Apache-2.0
"""What is known of the relative pose of two parts: the search, the placement, the geometry."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from enum import IntEnum
from typing import NamedTuple

import numpy as np

from cartoloop.arrays import BoolArray, FloatArray, IntArray
from cartoloop.config import JoinConfig
from cartoloop.global_slam.closure_matches import Requests, SearchMatches
from cartoloop.global_slam.closure_search import FinishedSubmap
from cartoloop.global_slam.placing import Placement
from cartoloop.global_slam.pose_graph import PoseGraph
from cartoloop.sensor.pose import Pose
from cartoloop.sensor.scan_points import ScanPoints


class GeometryCheck(NamedTuple):
    """How well two parts agree where they overlap.

    Attributes
    ----------
    length : path of either that lies in the other [m].
    contradicted : of it, the path whose scans contradict the other part [m].
    on_wall, on_floor : returns that lie on walls and on floor of the other part.
    fault : why they cannot be joined, as a clause; "" if they can.
    usual_limit : share of returns on floor that is allowed because of that within the parts; 0
        where it was not asked for.
    """

    length: float
    contradicted: float
    on_wall: int
    on_floor: int
    fault: str
    usual_limit: float = 0.0

    @property
    def floor_share(self) -> float:
        """Share of the compared returns that lie on floor of the other part."""
        return self.on_floor / max(self.on_wall + self.on_floor, 1)

    def scans_agree(self, join: JoinConfig) -> bool:
        """Return whether the scans alone do not forbid the join, whatever walls say."""
        return (
            self.contradicted <= join.max_contradicted_share * self.length
            and self.floor_share <= max(join.max_floor_share, self.usual_limit)
        )


class Strictness(IntEnum):
    """How strictly a placement is examined: the less supports it, the more strictly.

    `COUNTS_ONLY` counts returns on walls and floor, for places that are compared with each other,
    and judges nothing: neither length nor contradictions are known. `NO_OTHER_PLACE` is for scans
    that agree on one place, and hardly any on another; `OTHER_PLACES` where more of them do.
    """

    COUNTS_ONLY = -1
    NO_OTHER_PLACE = 0
    OTHER_PLACES = 1
    FEW_SCORE_HIGH = 2
    FEW_DISTINCT = 3


@dataclass(frozen=True, slots=True)
class TwoParts:
    """Two parts of a graph, which are compared or placed in each other.

    Attributes
    ----------
    graph : with both of them, and maybe others.
    submaps : the first ones of the graph, finished.
    node_points : the returns of all nodes.
    of_nodes, of_submaps : int64, 0 and 1 for the nodes and submaps of the two; others are left out.
    """

    graph: PoseGraph
    submaps: Sequence[FinishedSubmap]
    node_points: ScanPoints
    of_nodes: IntArray
    of_submaps: IntArray

    def nodes_of(self, part: int) -> BoolArray:
        """Return which nodes are of part 0 or 1, shape (num_nodes,)."""
        is_of: BoolArray = self.of_nodes == part
        return is_of

    def submaps_of(self, part: int) -> IntArray:
        """Return the finished submaps of part 0 or 1, ascending."""
        return np.flatnonzero(self.of_submaps[: len(self.submaps)] == part)


class Nearby(NamedTuple):
    """Matches of nodes of one part in submaps of another, near where a placement puts them.

    Attributes
    ----------
    requests : the windows, of n pairs.
    matches : n; without rows in the record of closures, -1, until the parts are joined.
    min_score : float64, shape (n,), the threshold of each; NaN where it is not known.
    """

    requests: Requests
    matches: SearchMatches
    min_score: FloatArray

    def take(self, which: IntArray) -> Nearby:
        """Return some of them, by index."""
        return Nearby(
            self.requests.take(which),
            SearchMatches._make(column[which] for column in self.matches),
            self.min_score[which],
        )


CheckGeometry = Callable[[TwoParts, Strictness], GeometryCheck]
"""Examines two parts where they were placed, and how strictly."""


class Examined(NamedTuple):
    """A placement whose geometry was examined.

    Attributes
    ----------
    tf_one_other : where it placed the other part.
    evidence : of the scans that agreed on it.
    check : what was found.
    strictness : with which.
    """

    tf_one_other: Pose
    evidence: float
    check: GeometryCheck
    strictness: Strictness


class OnePose(NamedTuple):
    """Where a part is known to be.

    Attributes
    ----------
    part : it.
    tf_main_part : its frame in that of the main part.
    """

    part: int
    tf_main_part: Pose


@dataclass
class JoinAttempt:
    """What is known of two parts.

    Attributes
    ----------
    one, other : the parts.
    found : the best placement so far.
    check : of its geometry, if it was tried.
    why_not : why they are not joined, "" if they are.
    is_ambiguous : whether another place fits as well as the best one.
    strictness : with which the best placement is examined.
    refused : placements that the geometry contradicts.
    undecided : those that it allows, where another place fits, too.
    num_searches : pairs of composite scan and submap searched.
    is_cut_short : whether only a sample of the scans was searched, since no two of it agree.
    """

    one: int
    other: int
    found: Placement | None = None
    check: GeometryCheck | None = None
    why_not: str = "not searched"
    is_ambiguous: bool = False
    strictness: Strictness = Strictness.NO_OTHER_PLACE
    refused: list[Examined] = field(default_factory=list)
    undecided: list[Examined] = field(default_factory=list)
    num_searches: int = 0
    is_cut_short: bool = False

    @property
    def explanation(self) -> str:
        """Why they are not joined, and whether all was searched; "" if they are."""
        if self.is_cut_short and self.why_not:
            return f"{self.why_not}; a quarter of the scans was searched, and no two of them agree"
        return self.why_not

    def examined(self, check: GeometryCheck) -> Examined:
        """Return the best placement with what its examination found."""
        assert self.found is not None
        return Examined(self.found.tf_one_other, self.found.evidence, check, self.strictness)
