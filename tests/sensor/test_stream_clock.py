# SPDX-License-Identifier: Apache-2.0
"""Times of a stream: plausible stamps, and times of arrival otherwise."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cartoloop.sensor.stream_clock import SensorTimes, StreamClock


def times(stamps, arrivals):
    clock = StreamClock()
    return [clock.time_of(*pair) for pair in zip(stamps, arrivals, strict=True)], clock


def test_sound_stamps_are_the_times():
    stamps = [1e9 + 0.1 * k for k in range(100)]
    found, clock = times(stamps, [5.0 + 0.1 * k + 0.03 * (k % 3) for k in range(100)])

    assert found == stamps
    assert clock.num_set == clock.num_missing == 0


def test_missing_stamps_are_arrivals():
    found, clock = times([math.nan] * 3, [5.0, 5.1, 5.3])

    assert found == pytest.approx([5.0, 5.1, 5.3])
    assert clock.num_missing == 3


def test_a_clock_that_is_set_does_not_move_the_times():
    stamps = [100.0, 100.1, 5000.2, 5000.3, 100.4]
    found, clock = times(stamps, [0.0, 0.1, 0.2, 0.3, 0.4])

    assert found == pytest.approx([100.0, 100.1, 100.2, 100.3, 100.4])
    assert clock.num_set == 1


def test_pauses_are_kept_and_stalls_removed():
    paused, clock = times([1.0, 1.1, 61.1], [0.0, 0.1, 60.1])
    stalled, same = times([1.0, 1.1, 1.2, 1.3], [0.0, 0.1, 30.0, 30.0])

    assert paused == [1.0, 1.1, 61.1]
    assert stalled == [1.0, 1.1, 1.2, 1.3]
    assert clock.num_set == same.num_set == 0


def test_sensors_with_another_clock_are_synchronized():
    stamps = [1e9, 10.0, 1e9 + 0.1, 10.1, 1e9 + 0.2]
    found, clock = times(stamps, [0.0, 0.05, 0.1, 0.15, 0.2])

    assert found == pytest.approx([1e9, 1e9 + 0.05, 1e9 + 0.1, 1e9 + 0.15, 1e9 + 0.2])
    assert clock.num_set == 1


@given(
    st.lists(
        st.tuples(st.floats(allow_nan=True, width=32), st.floats(0.0, 20.0)),
        min_size=1,
        max_size=50,
    )
)
def test_times_are_finite_and_never_far_back(steps):
    clock = StreamClock()
    arrival, front = 1e9, -math.inf
    for stamp, step in steps:
        arrival += step
        time = clock.time_of(stamp, arrival)
        assert math.isfinite(time)
        assert time >= front - 1.0 - 1e-6 * abs(front)
        front = max(front, time)


def test_repeated_and_backward_scans_follow_their_arrival():
    scans = SensorTimes()
    found = [
        scans.increasing(time, arrival)
        for time, arrival in [(1.0, 0.0), (1.1, 0.1), (1.1, 0.15), (1.05, 0.2), (1.4, 0.4)]
    ]

    assert found == pytest.approx([1.0, 1.1, 1.15, 1.2, 1.4])
    assert scans.repaired == {"repeated": 1, "backwards": 1}


@given(st.lists(st.tuples(st.floats(0.0, 10.0), st.floats(0.0, 0.5)), min_size=2, max_size=50))
def test_times_of_scans_always_increase(steps):
    scans = SensorTimes()
    arrival, before = 0.0, -math.inf
    for time, step in steps:
        arrival += step
        now = scans.increasing(time, arrival)
        assert now > before
        before = now
