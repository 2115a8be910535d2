# SPDX-License-Identifier: Apache-2.0
"""Pause, play and speed."""

from __future__ import annotations

import threading
import time

from cartoloop.viewer.playback import Playback


def pace(playback, times, is_stopped=lambda: False):
    start = time.perf_counter()
    for recorded in times:
        playback.wait_for(recorded, is_stopped, lambda: None)
    return time.perf_counter() - start


def test_as_fast_as_possible_waits_for_nothing():
    assert pace(Playback(), range(1000)) < 0.1


def test_the_recording_is_played_at_the_speed_wanted():
    took = pace(Playback(10.0), [0.0, 1.0, 2.0, 3.0])

    assert 0.29 < took < 1.0


def test_what_was_missed_is_not_made_up_for_in_a_rush():
    playback = Playback(1.0)
    pace(playback, [0.0])
    playback._begun = (time.perf_counter() - 50.0, 0.0)  # mapping took 50 s for the first scan

    assert pace(playback, [0.1]) < 0.05
    assert 0.25 < pace(playback, [0.4]) < 1.0


def test_a_pause_lasts_until_play_and_is_not_made_up_for():
    playback = Playback(10.0)
    playback.pause()
    threading.Timer(0.3, playback.play).start()

    took = pace(playback, [0.0, 1.0, 2.0])

    assert 0.48 < took < 2.0
    assert 0.29 < playback.paused_s < 1.0


def test_waiting_in_vain_ends_soon():
    playback = Playback()
    playback.pause()
    start = time.perf_counter()

    assert pace(playback, [0.0], lambda: time.perf_counter() - start > 0.2) < 1.0


def test_something_can_be_done_meanwhile():
    playback, calls = Playback(), []
    playback.pause()
    threading.Timer(0.35, playback.play).start()

    playback.wait_for(0.0, lambda: False, lambda: calls.append(1))

    assert len(calls) >= 3
