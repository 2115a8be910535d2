# SPDX-License-Identifier: Apache-2.0
"""How often odometry is read, and whether old readings are sent again in between."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cartoloop.local_slam.reading_period import MAX_PERIODS, ReadingPeriod
from cartoloop.sensor.pose import IDENTITY, Pose


def messages(duration, interval, period, begin=0.0):
    """Return messages of a robot that drives; the wheels are read once in each period."""
    read = [begin + k * interval for k in range(round(duration / interval))]
    return [(time, Pose(0.4 * ((time - begin + 1e-9) // period), 0.0, 0.0)) for time in read]


def period_of(readings):
    period = ReadingPeriod()
    for time, pose in readings:
        period.add(time, pose)
    return period


@given(interval=st.floats(0.01, 0.2), period=st.floats(0.5, 1.2))
def test_readings_that_are_sent_again_are_held(interval, period):
    found = period_of(messages(30.0, interval, period))
    assert found.are_held
    assert found.longest_s == pytest.approx(MAX_PERIODS * period, abs=1.1 * MAX_PERIODS * interval)


@given(st.floats(0.01, 1.2))
def test_readings_that_are_all_new_are_not_held(interval):
    found = period_of(messages(40.0 * interval, interval, interval))
    assert not found.are_held
    assert found.longest_s == pytest.approx(MAX_PERIODS * interval)


def test_a_robot_at_rest_holds_no_readings():
    at_rest = [(0.2 * k, IDENTITY) for k in range(200)]
    assert not period_of(at_rest).are_held
    moving = messages(30.0, 0.2, 0.2, begin=40.0)
    assert not period_of(at_rest + moving).are_held


def test_a_rest_does_not_end_that_readings_are_held():
    moving = messages(30.0, 0.2, 1.0)
    last = moving[-1][1]
    at_rest = [(30.0 + 0.2 * k, last) for k in range(200)]
    found = period_of(moving + at_rest)
    assert found.are_held
    assert found.longest_s == pytest.approx(MAX_PERIODS)


def test_short_periods_are_not_held():
    assert not period_of(messages(30.0, 0.05, 0.1)).are_held


def test_some_repeated_readings_are_not_held():
    hanging = [
        (time, Pose(0.0, 0.0, 0.0) if int(time) % 5 == 0 else pose)
        for time, pose in messages(60.0, 0.2, 0.2)
    ]
    assert not period_of(hanging).are_held


def test_readings_that_are_not_later_change_nothing():
    readings = messages(30.0, 0.2, 1.0)
    doubled = [reading for time, pose in readings for reading in ((time, pose), (time, IDENTITY))]
    assert period_of(doubled).longest_s == period_of(readings).longest_s
