# SPDX-License-Identifier: Apache-2.0
"""Claims as columns are the claims one by one."""

from __future__ import annotations

import math

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from cartoloop.config import WideSearchConfig
from cartoloop.global_slam.claims import SAME_PLACE, Claim, Claims
from cartoloop.global_slam.hypotheses import Candidate
from cartoloop.sensor.pose import Pose, compose, wrap_angle

WIDE = WideSearchConfig()


def some_claims(rng, count):
    """Claims about a place and, as often, near the limits of what is the same place."""
    claims, place = [], Pose(*rng.uniform(-9.0, 9.0, 3))
    for row in range(count):
        tf_other_scan = Pose(*rng.uniform((-20.0, -20.0, -4.0), (20.0, 20.0, 4.0)))
        limits = (SAME_PLACE * WIDE.place_distance, 0.0, math.radians(WIDE.place_angle_deg))
        off = Pose(*(rng.uniform(0.5, 1.2) * rng.integers(0, 2, 3) * limits))
        tf_one_scan = compose(compose(place, tf_other_scan), off)
        candidate = Candidate(row, row, 0, np.zeros(3), 0.7, 0.6)
        claims.append(Claim(candidate, np.array(tf_one_scan), np.array(tf_other_scan), 0.1 * row))
    return claims, place


def is_at(claim, place):
    """Whether a claim places its scan where a placement does."""
    x, y, theta = compose(place, Pose(*claim.tf_other_scan.tolist()))
    apart = math.dist((x, y), claim.tf_one_scan[:2])
    turn = abs(wrap_angle(theta - float(claim.tf_one_scan[2])))
    return apart <= SAME_PLACE * WIDE.place_distance and turn <= math.radians(WIDE.place_angle_deg)


@settings(deadline=None)
@given(seed=st.integers(0, 2**32 - 1), count=st.integers(0, 20))
def test_claims_at_a_place_are_found(seed, count):
    claims, place = some_claims(np.random.default_rng(seed), count)

    at_place = Claims.of(claims).are_at(place, WIDE)

    assert at_place.tolist() == [is_at(claim, place) for claim in claims]


def test_claims_are_taken_by_row():
    claims, _ = some_claims(np.random.default_rng(3), 6)
    columns = Claims.of(claims)
    assert Claims.of(columns) is columns

    for taken in (columns.take(np.array([1, 3, 5])), columns[1::2]):
        assert len(taken) == 3
        for one, row in zip(taken, (1, 3, 5), strict=True):
            assert one.candidate is claims[row].candidate
            assert one.tf_one_scan.tolist() == claims[row].tf_one_scan.tolist()
            assert one.tf_one_other == claims[row].tf_one_other
            assert one.evidence == claims[row].evidence
