# SPDX-License-Identifier: Apache-2.0
"""Which sets of matches place one part of a map in another."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cartoloop.config import JoinConfig, WideSearchConfig
from cartoloop.global_slam.claims import Claim, Claims
from cartoloop.global_slam.hypotheses import Candidate, heaviest_clique
from cartoloop.global_slam.placing import (
    MAX_SET,
    evidence_of,
    is_ambiguous,
    placement,
    why_not_believed,
)
from cartoloop.sensor.pose import Pose, compose

MODULE = "cartoloop.global_slam.placing"
JOIN, WIDE = JoinConfig(), WideSearchConfig()


def claim(row, tf_one_other, tf_other_scan, evidence=0.1):
    candidate = Candidate(row, row, 0, np.zeros(3), 0.7, 0.7 - evidence)
    tf_one_scan = compose(Pose(*tf_one_other), Pose(*tf_other_scan))
    return Claim(candidate, np.array(tf_one_scan), np.array(tf_other_scan), evidence)


def along(tf_one_other, count=5, first=0, evidence=0.1):
    """Return claims of scans along a straight path that all place it there."""
    return [
        claim(first + i, tf_one_other, (4.0 * i, 0.3 * i, 0.1 * i), evidence) for i in range(count)
    ]


def believed(claims, refused=()):
    found = placement(claims, refused, JOIN, WIDE)
    return found, why_not_believed(found, JOIN, WIDE)


def test_claims_that_agree_place_the_part():
    found, why_not = believed(along((3.0, -2.0, 1.0)))
    assert why_not == ""
    assert found.tf_one_other == pytest.approx((3.0, -2.0, 1.0))
    assert len(found.claims) == 5
    assert found.rival == 0.0


@settings(deadline=None)
@given(
    st.floats(-100.0, 100.0), st.floats(-100.0, 100.0), st.floats(-math.pi, math.pi),
)  # fmt: skip
def test_place_and_heading_of_a_part_do_not_matter(x, y, theta):
    found, why_not = believed(along((x, y, theta)))
    assert why_not == ""
    assert len(found.claims) == 5
    assert found.tf_one_other[:2] == pytest.approx((x, y), abs=1e-6)


def test_claims_elsewhere_are_left_out():
    stray = claim(9, (30.0, 5.0, -2.0), (2.0, 0.0, 0.0))
    found, why_not = believed([*along((3.0, -2.0, 1.0)), stray])
    assert why_not == ""
    assert stray not in found.claims
    assert found.rival == pytest.approx(0.1)


def test_two_places_that_fit_are_not_believed():
    claims = [*along((3.0, -2.0, 1.0)), *along((40.0, 0.0, 0.0), first=10)]
    _, why_not = believed(claims)
    assert "two places fit" in why_not


def test_few_claims_are_not_believed():
    _, why_not = believed(along((3.0, -2.0, 1.0), count=2, evidence=0.3))
    assert "at most 2 scans agree" in why_not


def test_claims_at_one_place_are_not_believed():
    claims = [claim(i, (1.0, 2.0, 0.0), (0.1 * i, 0.0, 0.0)) for i in range(5)]
    _, why_not = believed(claims)
    assert "lie within" in why_not


def test_nothing_is_believed_without_claims():
    found, why_not = believed([])
    assert found is None
    assert "no scan" in why_not


def test_refused_placement_is_not_proposed_again():
    first, second = (3.0, -2.0, 1.0), (40.0, 0.0, 0.0)
    claims = [*along(first, count=3, evidence=0.05), *along(second, first=10)]
    found, why_not = believed(claims, refused=[Pose(*first)])
    assert why_not == ""
    assert found.tf_one_other == pytest.approx(second)


def test_refused_placement_counts_against_others():
    # Where the best place was refused the building repeats itself: the next one may be wrong too.
    first, second = (3.0, -2.0, 1.0), (40.0, 0.0, 0.0)
    claims = [*along(first), *along(second, count=4, first=10)]
    found, why_not = believed(claims, refused=[Pose(*first)])
    assert found.tf_one_other == pytest.approx(second)
    assert "two places fit" in why_not


def test_bent_parts_still_agree():
    claims = [
        claim(i, (3.0, -2.0, 0.002 * i), (4.0 * i, 0.3 * i, 0.1 * i)) for i in range(8)
    ]  # the part turns by 0.1 degrees from scan to scan
    found, why_not = believed(claims)
    assert why_not == ""
    assert len(found.claims) == 8


@settings(deadline=None)
@given(st.lists(st.tuples(*[st.floats(-20.0, 20.0)] * 4), min_size=1, max_size=8))
def test_agreement_is_symmetric_and_with_itself(places):
    claims = [claim(i, (x, y, 0.0), (a, b, 0.0)) for i, (x, y, a, b) in enumerate(places)]
    agrees = Claims.of(claims).agreement(WIDE)
    assert np.array_equal(agrees, agrees.T)
    assert agrees.diagonal().all()


def test_evidence_of_a_place_is_of_what_agrees_there():
    first = (3.0, -2.0, 1.0)
    claims = [*along(first, count=4), *along((40.0, 0.0, 0.0), first=10)]
    assert evidence_of(claims, Pose(*first), WIDE) == pytest.approx(0.4)
    assert evidence_of(claims, Pose(-40.0, 0.0, 0.0), WIDE) == 0.0


def test_refused_places_count_less_where_the_geometry_is_strict():
    first, second = (3.0, -2.0, 1.0), (40.0, 0.0, 0.0)
    claims = [*along(first), *along(second, count=4, first=10)]
    found = placement(claims, [Pose(*first)], JOIN, WIDE, refused_weight=0.25)
    assert found.tf_one_other == pytest.approx(second)
    assert found.rival == pytest.approx(0.25 * 0.5)
    assert not is_ambiguous(found, JOIN)
    assert why_not_believed(found, JOIN, WIDE) == ""


def test_places_that_were_not_refused_count_in_full():
    claims = [*along((3.0, -2.0, 1.0)), *along((40.0, 0.0, 0.0), count=4, first=10)]
    found = placement(claims, [], JOIN, WIDE, refused_weight=0.25)
    assert found.rival == pytest.approx(0.4)
    assert is_ambiguous(found, JOIN)


def test_claims_are_compared_with_each_other_once(monkeypatch):
    compared, agreement = [], Claims.agreement

    def counted(claims, wide):
        compared.append(len(claims))
        return agreement(claims, wide)

    monkeypatch.setattr(Claims, "agreement", counted)
    claims = along((1.0, 2.0, 0.5)) + along((30.0, 2.0, 0.5), count=3, first=5)

    found = placement(claims, [Pose(60.0, 0.0, 0.0)], JOIN, WIDE)

    assert (found.evidence, found.rival) == (pytest.approx(0.5), pytest.approx(0.3))
    assert compared == [8]


def test_a_set_of_claims_is_searched_once(monkeypatch):
    searched = []

    def counted(agrees, weights):
        searched.append(len(weights))
        return heaviest_clique(agrees, weights)

    monkeypatch.setattr(f"{MODULE}.heaviest_clique", counted)
    claims = along((1.0, 2.0, 0.5), count=60, evidence=0.1)

    found = placement(claims, [], JOIN, WIDE)

    assert len(found.claims) == MAX_SET
    assert searched == [MAX_SET]
