# SPDX-License-Identifier: Apache-2.0
"""Where two places of a part fit, the other one is examined, and one of them must stand out."""

from __future__ import annotations

import numpy as np
import pytest

from cartoloop.config import JoinConfig, WideSearchConfig
from cartoloop.global_slam.claims import Claim
from cartoloop.global_slam.hypotheses import Candidate
from cartoloop.global_slam.join_evidence import Examined, GeometryCheck, JoinAttempt, Strictness
from cartoloop.global_slam.placing import placement
from cartoloop.global_slam.rivals import (
    RETRY_EVIDENCE,
    closed_places,
    examined_already,
    reason,
    refused_place_weighs,
    reopen,
    rival_to_examine,
    stands_out,
)
from cartoloop.sensor.pose import Pose, compose

JOIN, WIDE = JoinConfig(), WideSearchConfig()
PLAIN = Strictness.NO_OTHER_PLACE
HERE, THERE = Pose(3.0, -2.0, 1.0), Pose(40.0, 0.0, 0.0)


def along(place, count, first=0, evidence=0.1):
    """Return claims of scans along a straight path that all place the part there."""
    claims = []
    for row in range(first, first + count):
        tf_other_scan = Pose(4.0 * (row - first), 0.0, 0.0)
        candidate = Candidate(row, row, 0, np.zeros(3), 0.7, 0.7 - evidence)
        tf_one_scan = compose(place, tf_other_scan)
        claims.append(Claim(candidate, np.array(tf_one_scan), np.array(tf_other_scan), evidence))
    return claims


CLAIMS = [*along(HERE, 7), *along(THERE, 4, first=10)]


def examined(place, evidence, floor_share=0.04, returns=2000, fault="", strictness=PLAIN):
    on_floor = round(floor_share * returns)
    return Examined(
        place, evidence, GeometryCheck(50.0, 0.0, returns - on_floor, on_floor, fault), strictness
    )


def attempt(*undecided, refused=()):
    found = placement(CLAIMS, (), JOIN, WIDE)
    return JoinAttempt(0, 1, found, undecided=list(undecided), refused=list(refused))


def test_best_place_is_examined_first():
    assert examined_already(attempt(), WIDE) is None
    assert examined_already(attempt(examined(THERE, 0.4)), WIDE) is None
    known = examined(HERE, 0.7)
    assert examined_already(attempt(known), WIDE) is known


def test_place_is_examined_again_with_more_evidence():
    assert examined_already(attempt(examined(HERE, 0.69 / RETRY_EVIDENCE)), WIDE) is None


def test_other_place_is_examined_then():
    rival = rival_to_examine(attempt(examined(HERE, 0.7)), CLAIMS, [], JOIN, WIDE)
    assert rival.tf_one_other == pytest.approx(THERE)


@pytest.mark.parametrize("count", [1, 2])
def test_places_with_little_evidence_are_no_rivals(count):
    claims = [*along(HERE, 7), *along(THERE, count, first=10)]
    assert rival_to_examine(attempt(examined(HERE, 0.7)), claims, [], JOIN, WIDE) is None


def test_places_that_were_examined_are_not_again():
    both = attempt(examined(HERE, 0.7), examined(THERE, 0.4))
    assert rival_to_examine(both, CLAIMS, [], JOIN, WIDE) is None
    assert rival_to_examine(attempt(examined(HERE, 0.7)), CLAIMS, [THERE], JOIN, WIDE) is None


@pytest.mark.parametrize(
    ("here", "there", "returns", "is_right"),
    [(0.04, 0.07, 2000, True), (0.04, 0.05, 2000, False), (0.07, 0.04, 2000, False),
     (0.04, 0.07, 500, False)],
)  # fmt: skip
def test_place_stands_out_by_returns_on_floor(here, there, returns, is_right):
    best = examined(HERE, 0.6, here, returns)
    known = attempt(best, examined(THERE, 0.4, there, returns))
    assert stands_out(best, known, WIDE) is is_right


def test_place_without_a_rival_stands_out():
    best = examined(HERE, 0.7)
    assert stands_out(best, attempt(best), WIDE)


@pytest.mark.parametrize(("place", "weighs"), [(HERE, True), (THERE, False)])
def test_refused_places_weigh_by_their_evidence(place, weighs):
    refused = attempt(refused=[examined(place, 0.6, fault="a wall")])
    found = placement(CLAIMS, [place], JOIN, WIDE)
    refused.found = found if weighs else refused.found
    assert refused_place_weighs(refused, CLAIMS, JOIN, WIDE) is weighs


def test_places_that_scans_contradict_do_not_weigh():
    refused = attempt(refused=[examined(HERE, 0.6, floor_share=0.3, fault="30% on floor")])
    refused.found = placement(CLAIMS, [HERE], JOIN, WIDE)
    assert not refused_place_weighs(refused, CLAIMS, JOIN, WIDE)


@pytest.mark.parametrize(("usual_limit", "weighs"), [(0.0, False), (0.1, False), (0.12, True)])
def test_as_much_floor_as_within_the_parts_is_allowed(usual_limit, weighs):
    place = examined(HERE, 0.6, floor_share=0.11, fault="a wall")
    place = place._replace(check=place.check._replace(usual_limit=usual_limit))
    refused = attempt(refused=[place])
    refused.found = placement(CLAIMS, [HERE], JOIN, WIDE)
    assert refused_place_weighs(refused, CLAIMS, JOIN, WIDE) is weighs


def test_refused_places_are_open_again_if_searched():
    refused = [examined(HERE, 0.6, fault="a wall"), examined(THERE, 0.4, fault="a wall")]
    both = attempt(refused=refused)
    reopen(both, HERE, CLAIMS, WIDE)
    assert [each.tf_one_other for each in both.refused] == [THERE]


def test_refused_places_are_open_again_with_more_evidence():
    refused = [examined(HERE, 0.6, fault="a wall"), examined(THERE, 0.1, fault="a wall")]
    assert closed_places(attempt(refused=refused), CLAIMS, WIDE) == [HERE]


def test_what_was_refused_more_strictly_is_open():
    refused = [examined(HERE, 0.7, fault="a wall", strictness=Strictness.FEW_DISTINCT)]
    known = attempt(refused=refused)
    assert closed_places(known, CLAIMS, WIDE) == []
    known.strictness = Strictness.FEW_DISTINCT
    assert closed_places(known, CLAIMS, WIDE) == [HERE]


def test_each_refusal_has_a_reason():
    allowed, refused = examined(HERE, 0.7), examined(THERE, 0.4, fault="a wall")
    known = attempt(refused=[refused])
    known.check = refused.check
    assert reason("two places fit", known) == "a wall"
    known.check = allowed.check
    assert reason("two places fit", known) == "two places fit"
    assert reason("", attempt()) == ""
