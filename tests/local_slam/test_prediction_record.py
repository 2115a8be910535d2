# SPDX-License-Identifier: Apache-2.0
"""Odometry that predicts the scans worse than constant velocity does is left out."""

from __future__ import annotations

import numpy as np
import pytest

from cartoloop.local_slam.prediction_record import DOUBTFUL, MAX_SCORE, MEMORY_S, PredictionRecord
from cartoloop.sensor.pose import Pose

STEP = Pose(0.1, 0.0, 0.02)
STAND = Pose(0.0, 0.0, 0.0)
LEAP = Pose(0.3, 0.0, 0.06)
"""The motion of three steps at once."""
STEADY = [STEP] * 120
LEAPING = [STAND, STAND, LEAP] * 40


def judged(matched, reported, expected, earlier=0.0):
    """Return the record after these steps, and at which its judgement changed."""
    record, changes = PredictionRecord(earlier), []
    for k, step in enumerate(zip(matched, reported, expected, strict=True)):
        was_useful = record.is_useful
        record.add(0.2 * k, *step)
        if record.is_useful != was_useful:
            changes.append(k)
    return record, changes


def test_odometry_that_stands_and_leaps_is_of_no_use():
    record, changes = judged(STEADY, LEAPING, STEADY)
    assert not record.is_useful
    assert len(changes) == 1
    assert changes[0] < 30
    assert record.since == 0.0


def test_it_is_useful_where_the_robot_itself_moves_so():
    record, changes = judged(LEAPING, LEAPING, STEADY)
    assert record.is_useful
    assert not changes


def test_it_is_useful_again_once_it_predicts():
    """However long it was of no use."""
    turning = [Pose(0.1, 0.0, 0.1 * (-1) ** k) for k in range(60)]
    for repeats in (1, 5):
        worse = len(STEADY) * repeats
        record, changes = judged(
            STEADY * repeats + turning,
            LEAPING * repeats + turning,
            STEADY * repeats + [STEP] * len(turning),
        )
        assert record.is_useful
        assert len(changes) == 2
        assert worse < changes[1] <= worse + 1.5 * MAX_SCORE


def test_odometry_with_a_bad_record_must_earn_its_use():
    turning = [Pose(0.1, 0.0, 0.1 * (-1) ** k) for k in range(60)]
    record, changes = judged(turning, turning, [STEP] * len(turning), earlier=DOUBTFUL)
    assert record.is_useful
    assert len(changes) == 1
    assert changes[0] > 5
    assert record.largest >= DOUBTFUL
    assert not judged(STEADY, LEAPING, STEADY, earlier=DOUBTFUL)[1]


@pytest.mark.parametrize("sigma", [0.004, 0.03])
def test_small_errors_of_the_odometry_do_not_matter(sigma):
    """At constant speed, constant velocity is better by less than the scans correct."""
    rng = np.random.default_rng(3)
    noisy = [Pose(0.1 + dx, dy, 0.02) for dx, dy in rng.normal(0.0, sigma, (400, 2))]
    moving = [STEP] * 400
    assert not judged(moving, noisy, moving)[1]


@pytest.mark.parametrize("shift", [STAND, Pose(0.01, 0.0, 0.01)])
def test_a_robot_at_rest_says_nothing(shift):
    assert not judged([shift] * 300, [STAND] * 300, [shift] * 300)[1]


@pytest.mark.parametrize("earlier", [0.0, DOUBTFUL])
def test_steps_that_are_forgotten_leave_no_trace(earlier):
    record, _ = judged(STEADY, LEAPING, STEADY, earlier)
    for k in range(20):
        record.add(30.0 + 0.2 * k, STEP, STAND if k % 2 else LEAP, STEP)
    record.forget(since=30.0)
    expected, _ = judged(STEADY, LEAPING, STEADY, earlier)
    assert (record.is_useful, record.since, record.largest) == (
        expected.is_useful,
        expected.since,
        expected.largest,
    )


def test_only_recent_steps_can_be_forgotten():
    record, _ = judged(STEADY[:60], LEAPING[:60], STEADY[:60])
    assert not record.is_useful
    record.add(0.2 * 60 + 2 * MEMORY_S, STEP, STEP, STEP)
    record.forget(since=0.0)
    assert not record.is_useful
