# SPDX-License-Identifier: Apache-2.0
"""Pause, play and speed, with a clock that waiting alone advances."""

from __future__ import annotations

from contextlib import nullcontext

import pytest

from cartoloop.viewer.playback import Playback


class Clock:
    """Time [s], and what is done at a time while the mapping thread waits."""

    def __init__(self):
        self.now = 0.0
        self.due = []

    def wait(self, timeout):
        self.now += max(timeout, 1e-9)  # rounding must not let time stand still
        for time, action in [entry for entry in self.due if entry[0] <= self.now]:
            self.due.remove((time, action))
            action()


class Changed(nullcontext):
    """A condition variable of one thread."""

    def __init__(self, clock):
        super().__init__()
        self.wait = clock.wait

    def notify_all(self):
        pass


@pytest.fixture
def clock(monkeypatch):
    clock = Clock()
    monkeypatch.setattr("cartoloop.viewer.playback.perf_counter", lambda: clock.now)
    monkeypatch.setattr("cartoloop.viewer.playback.Condition", lambda: Changed(clock))
    return clock


def pace(clock, playback, times, is_stopped=lambda: False, meanwhile=lambda: None):
    """Return how long it takes to wait for events at these times of the recording [s]."""
    start = clock.now
    for recorded in times:
        playback.wait_for(recorded, is_stopped, meanwhile)
    return clock.now - start


def test_as_fast_as_possible_waits_for_nothing(clock):
    assert pace(clock, Playback(), range(1000)) == 0.0


def test_recording_is_played_at_the_chosen_speed(clock):
    assert pace(clock, Playback(10.0), [0.0, 1.0, 2.0, 3.0]) == pytest.approx(0.3)


def test_missed_time_is_not_made_up_for(clock):
    playback = Playback(1.0)
    pace(clock, playback, [0.0])
    clock.now += 50.0  # mapping took 50 s for the first scan

    assert pace(clock, playback, [0.1]) == 0.0
    assert pace(clock, playback, [0.4]) == pytest.approx(0.3)


def test_pause_lasts_until_play_and_is_not_made_up_for(clock):
    playback = Playback(10.0)
    playback.pause()
    clock.due.append((0.3, playback.play))

    assert pace(clock, playback, [0.0, 1.0, 2.0]) == pytest.approx(0.5)
    assert playback.paused_s == pytest.approx(0.3)


def test_waiting_ends_soon_after_a_stop(clock):
    playback = Playback()
    playback.pause()

    assert pace(clock, playback, [0.0], lambda: clock.now > 0.2) == pytest.approx(0.3)


def test_callback_runs_while_waiting(clock):
    playback, calls = Playback(), []
    playback.pause()
    clock.due.append((0.35, playback.play))

    pace(clock, playback, [0.0], meanwhile=lambda: calls.append(1))

    assert len(calls) >= 3
