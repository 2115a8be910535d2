# SPDX-License-Identifier: Apache-2.0
"""Readings of the odometry, packed, and what is left of them when the others are forgotten."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from cartoloop.config import Config
from cartoloop.local_slam import odometry_calibration, odometry_readings
from cartoloop.local_slam.odometry_readings import OdometryReadings, are_measured
from cartoloop.local_slam.odometry_track import OdometryTrack
from cartoloop.local_slam.pose_extrapolator import PoseExtrapolator
from cartoloop.sensor.pose import Pose, wrap_angle

HEADINGS = st.floats(-7.0, 7.0) | st.sampled_from([0.0, math.pi, -math.pi, math.tau])


def readings_of(headings):
    readings = OdometryReadings()
    for number, heading in enumerate(headings):
        readings.append(0.1 * number, Pose(float(number), -1.0, heading))
    return readings


@example([-0.0, -0.0])
@given(st.lists(HEADINGS, max_size=30))
def test_headings_continue_as_numpy_unwraps_them(headings):
    times, poses = readings_of(headings).rows()
    assert poses.shape == (len(headings), 3)
    assert times.tolist() == [0.1 * number for number in range(len(headings))]
    assert poses[:, 2].tobytes() == np.unwrap(np.array(headings)).tobytes()


def test_a_dropped_reading_leaves_no_turn():
    readings = readings_of([3.0, -3.0])
    readings.pop()
    readings.append(0.2, Pose(7.0, 8.0, 3.1))
    assert len(readings) == 2
    assert readings.rows()[1][:, 2].tolist() == [3.0, 3.1]
    assert readings.pose(-1) == readings.pose(1) == Pose(7.0, 8.0, 3.1)
    assert readings.pose(-2) == Pose(0.0, -1.0, 3.0)


def test_what_is_around_needed_times_is_kept_and_one_beyond():
    readings = OdometryReadings()
    for time in range(100):
        readings.append(float(time), Pose(0.0, 0.0, 0.0))
    readings.forget(np.array([20.5, 23.0, 60.0]), 2.0)
    expected = [*range(18, 26), *range(58, 63), *range(89, 100)]
    assert list(readings.times) == expected
    readings.forget(np.zeros(0), 2.0)
    assert list(readings.times) == list(range(89, 100))


def drive(rng, count):
    """A drive of readings that turn all around, jump, stand still, repeat, and are replaced."""
    time, x, heading, found = 0.0, 0.0, 0.0, []
    for _ in range(count):
        time += float(rng.choice((0.0, 0.05, 0.1, 0.1, 0.1, 0.3)))
        if rng.random() < 0.8:
            x, heading = x + rng.uniform(0.0, 0.1), heading + rng.uniform(0.0, 0.3)
        if rng.random() < 0.01:
            x, heading = rng.uniform(-90.0, 90.0), rng.uniform(-3.0, 3.0)
        found.append((time, Pose(x, 0.5 * x, wrap_angle(heading))))
    return found


@settings(deadline=None, max_examples=20)
@given(seed=st.integers(0, 9999))
def test_around_needed_times_forgetting_changes_no_bit(seed):
    rng = np.random.default_rng(seed)
    whole, short = OdometryTrack(), OdometryTrack()
    needed, reach = [], 4.0
    for number, (time, pose) in enumerate(drive(rng, 1500)):
        whole.add(time, pose)
        short.add(time, pose)
        if rng.random() < 0.01:
            needed.append(time)
        if number % 200 == 199:
            short.forget(np.array(needed), reach)
            del needed[:-5]
    assert len(short.arrays()[0]) < len(whole.arrays()[0])
    assert (len(short), short.num_jumps, short.num_late, short.has_moved) == (
        len(whole), whole.num_jumps, whole.num_late, whole.has_moved
    )  # fmt: skip
    asked = np.array(needed)[:, None] + rng.uniform(-reach, reach, (len(needed), 20))
    asked = np.clip(np.append(asked.ravel(), time), whole.arrays()[0][0], None)
    for column in (0, 1, 2):
        found = [
            np.interp(asked, track.arrays()[0], track.arrays()[1][:, column])
            for track in (whole, short)
        ]
        assert found[0].tobytes() == found[1].tobytes()
    for one, other in zip(asked.tolist(), rng.permutation(asked).tolist(), strict=True):
        assert short.at(one) == whole.at(one)
        assert short.reported_at(one) == whole.reported_at(one)
        assert short.jumps_between(one, other) == whole.jumps_between(one, other)


@pytest.mark.parametrize(("has_scans", "most"), [(True, 25_000), (False, 500)])
def test_a_robot_that_is_on_for_days_keeps_minutes_of_odometry(monkeypatch, has_scans, most):
    """With scans, two thousand of them and what is around; else the latest seconds."""
    monkeypatch.setattr(odometry_readings, "FEW", 200)
    monkeypatch.setattr(odometry_calibration, "VEER_WINDOW", 100)
    extrapolator = PoseExtrapolator(Config().local_slam)
    longest = 0
    for number in range(60_000):
        time, pose = 0.1 * number, Pose(1e-3 * number, 0.0, 0.0)
        extrapolator.add_odometry(time, pose)
        if has_scans and number % 5 == 0:
            extrapolator.add_pose(time, pose)
        if extrapolator.odometry.is_long:
            extrapolator.odometry.forget([])
        longest = max(longest, len(extrapolator.odometry._track._readings))
    assert len(extrapolator.odometry._track) == 60_000
    assert 200 <= longest < most


@pytest.mark.parametrize(
    ("period", "gap", "is_known"), [(0.1, 2.5, True), (0.1, 4.0, False), (5.0, 20.0, True)]
)
def test_between_readings_far_apart_nothing_is_known(period, gap, is_known):
    before = period * np.arange(10.0)
    readings = np.concatenate((before, before[-1] + gap + before))
    times = np.array(
        (-0.1, 0.0, before[-2], before[-1] + 0.5 * gap, readings[-1], readings[-1] + 0.1)
    )
    found = are_measured(times, readings)
    assert found.tolist() == [False, True, True, is_known, True, False]
