# SPDX-License-Identifier: Apache-2.0
"""Which placement of two parts is examined next, and how strictly."""

from __future__ import annotations

from collections.abc import Sequence

from cartoloop.config import ConstraintSearchConfig
from cartoloop.global_slam.claims import Claim
from cartoloop.global_slam.following import why_not_supported
from cartoloop.global_slam.join_evidence import JoinAttempt, Strictness
from cartoloop.global_slam.join_matches import JoinMatches
from cartoloop.global_slam.placing import is_ambiguous, placement, why_not_believed
from cartoloop.global_slam.pose_graph import PoseGraph
from cartoloop.global_slam.rivals import (
    closed_places,
    examined_already,
    refused_place_weighs,
    rival_to_examine,
    stands_out,
)


class Judging:
    """Chooses the placement of two parts whose geometry is examined.

    Parameters
    ----------
    config : parameters.
    matches : of composite scans between parts.
    """

    def __init__(self, config: ConstraintSearchConfig, matches: JoinMatches) -> None:
        self._config = config
        self._matches = matches

    def why_not(
        self,
        attempt: JoinAttempt,
        claims: Sequence[Claim],
        every_match: Sequence[Claim],
        graph: PoseGraph,
        *,
        follows: bool,
    ) -> str:
        """Find the best placement of two parts; return why it is not to be examined, or "".

        A place is examined least strictly if hardly any scan agrees on another one. In corridors
        few scans are distinct. So, after places were followed, those on which scans agree that are
        not are examined as if another place fitted, too; what was refused counts in full there.

        Parameters
        ----------
        attempt : its placement and strictness are changed.
        claims, every_match : about the two parts: of scans that are distinct, and of all.
        follows : whether places were followed.
        """
        attempt.strictness = Strictness.FEW_SCORE_HIGH if follows else Strictness.OTHER_PLACES
        why_not = self._judge(attempt, claims, graph)
        if not follows:
            found = attempt.found
            if found is not None and found.rival <= LITTLE_SHARE * found.evidence:
                attempt.strictness = Strictness.NO_OTHER_PLACE
            return why_not
        if not why_not:
            return ""
        found, is_ambiguous = attempt.found, attempt.is_ambiguous
        attempt.strictness = Strictness.FEW_DISTINCT
        if not self._judge(attempt, every_match, graph):
            return ""
        attempt.found, attempt.is_ambiguous = found, is_ambiguous
        return why_not

    def _judge(self, attempt: JoinAttempt, claims: Sequence[Claim], graph: PoseGraph) -> str:
        """Find the best placement by some claims; return why it is not to be examined, or "".

        Where two places that were followed fit, both are examined, the better one first: if the
        geometry contradicts one, the other one remains; if neither, the better one if far more
        returns lie on floor at the other one. Else the parts stay apart. Where few scans are
        distinct, that too few fit of those that should is asked last: the geometry contradicts most
        of such places, and the next one may be right.
        """
        join, wide = self._config.join, self._config.wide_search
        closed = closed_places(attempt, claims, wide)
        follows = attempt.strictness >= Strictness.FEW_SCORE_HIGH
        weight = STRICT_REFUSED_WEIGHT if follows else 1.0
        attempt.found = found = placement(claims, closed, join, wide, weight)
        attempt.is_ambiguous = False
        why_not = why_not_believed(found, join, wide)
        if not follows or found is None:
            return why_not
        must_stand_out = attempt.strictness == Strictness.FEW_DISTINCT
        if must_stand_out or (why_not and is_ambiguous(found, join)):
            attempt.is_ambiguous = True
            if why_not_believed(found._replace(rival=0.0), join, wide) or (
                must_stand_out and refused_place_weighs(attempt, claims, join, wide)
            ):
                return why_not or "as many scans agree on a place that was refused"
            if (examined := examined_already(attempt, wide)) is not None:
                rival = rival_to_examine(attempt, claims, closed, join, wide)
                if rival is None and not stands_out(examined, attempt, wide):
                    return why_not or "another place fits as well"
                attempt.found, attempt.is_ambiguous = rival or found, rival is not None
            if attempt.is_ambiguous and (must_stand_out or examined is not None):
                return ""
        elif why_not:
            return why_not
        expected = self._matches.expected_scans(
            (attempt.one, attempt.other), found.tf_one_other, graph
        )
        return why_not_supported(found, expected, self._matches.of_scan, join.min_margin, wide)


LITTLE_SHARE = 0.1
"""A place is examined least strictly where another one has at most this share of its evidence. It
was more in 3 of 43 pairs of sessions of one building, up to 0.34. Where rings of corridors of the
same size lay on each other, it was 0.2 or more in all."""

STRICT_REFUSED_WEIGHT = 0.25
"""Share of the evidence of places that were refused that counts against those that are followed:
the geometry of these is examined strictly."""
