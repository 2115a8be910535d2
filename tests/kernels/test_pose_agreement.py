# SPDX-License-Identifier: Apache-2.0
"""Which poses lie alike in two frames, against relative poses of one pair after the other."""

from __future__ import annotations

import math

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from cartoloop.kernels.pose_agreement import lie_alike
from cartoloop.sensor.pose import Pose, compose, relative, wrap_angle

LIMITS = (0.5, 0.02, math.radians(4.0), math.radians(0.3))


def naive_alike(one, other, max_error, error_growth, max_turn, turn_growth):
    """Compare relative poses in both frames, seen from either pose of a pair."""
    count = len(one)
    alike = np.ones((count, count), dtype=bool)
    for i in range(count):
        for j in range(count):
            in_one, in_other = (relative(Pose(*all_[i]), Pose(*all_[j])) for all_ in (one, other))
            between = math.hypot(in_other.x, in_other.y)
            error = math.hypot(in_one.x - in_other.x, in_one.y - in_other.y)
            turn = abs(wrap_angle(in_one.theta - in_other.theta))
            fits = error <= max_error + error_growth * between
            alike[i, j] &= fits and turn <= max_turn + turn_growth * between
            alike[j, i] &= alike[i, j]
    return alike


def some_poses(rng, count):
    """Poses in two frames: a few places of the one in the other, and errors near the limits."""
    places = [Pose(*rng.uniform((-40, -40, -7), (40, 40, 7))) for _ in range(3)]
    other = rng.uniform((-30.0, -30.0, -math.pi), (30.0, 30.0, math.pi), (count, 3))
    one = np.array([compose(places[rng.integers(0, 3)], Pose(*each)) for each in other.tolist()])
    return one.reshape(-1, 3) + rng.normal(0.0, (0.3, 0.3, 0.03), (count, 3)), other


@settings(deadline=None, max_examples=100)
@given(seed=st.integers(0, 2**32 - 1), count=st.integers(0, 12))
def test_pairs_that_lie_alike_are_found(seed, count):
    one, other = some_poses(np.random.default_rng(seed), count)

    alike = lie_alike(one, other, *LIMITS)

    assert np.array_equal(alike, naive_alike(one.tolist(), other.tolist(), *LIMITS))


def test_headings_are_compared_around_the_circle():
    one = np.array([[0.0, 0.0, 3.1], [1.0, 0.0, -3.1]])
    other = np.array([[0.0, 0.0, 0.0], [math.cos(3.1), -math.sin(3.1), 0.08]])

    assert lie_alike(one, other, *LIMITS).all()
    other[1, 2] = -0.08
    assert not lie_alike(one, other, *LIMITS)[0, 1]
