# SPDX-License-Identifier: Apache-2.0
"""The display of progress."""

from __future__ import annotations

import io

import pytest

from cartoloop.cli import progress as module
from cartoloop.cli.progress import format_duration, progress


class Clock:
    def __init__(self):
        self.now = 1000.0

    def __call__(self):
        return self.now


@pytest.fixture
def clock(monkeypatch):
    clock = Clock()
    monkeypatch.setattr(module, "perf_counter", clock)
    return clock


class Terminal(io.StringIO):
    def isatty(self):
        return True


def test_without_a_terminal_there_is_a_line_every_few_seconds(clock):
    stream = io.StringIO()
    with progress(1000, stream) as shown:
        for second in range(1, 12):
            clock.now = 1000.0 + second
            shown.update(50 * second, 10.0 * second, 3)

    assert stream.getvalue().splitlines() == [
        "250 of 1000 scans, 50/s, 10.0x real time, 15 s left, 3 closures",
        "500 of 1000 scans, 50/s, 10.0x real time, 10 s left, 3 closures",
    ]


def test_time_spent_otherwise_does_not_count(clock):
    stream, paused = io.StringIO(), 20.0
    with progress(1000, stream, paused_s=lambda: paused) as shown:
        clock.now = 1020.0
        shown.update(1, 0.2, 0)
        paused = 25.0
        clock.now = 1035.0
        shown.update(501, 100.2, 0)

    assert stream.getvalue().splitlines()[-1] == (
        "501 of 1000 scans, 50/s, 10.0x real time, 10 s left, 0 closures"
    )


def test_no_time_is_estimated_from_the_first_scans(clock):
    stream = io.StringIO()
    with progress(1000, stream) as shown:
        clock.now += 20.0  # kernels were compiled
        shown.update(0, 0.0, 0)
        shown.update(1, 0.0, 0)
        clock.now += 5.0
        shown.update(101, 20.0, 0)

    assert stream.getvalue().splitlines() == [
        "1 of 1000 scans, 0 closures",
        "101 of 1000 scans, 20/s, 4.0x real time, 45 s left, 0 closures",
    ]


def test_the_estimate_follows_a_change_of_pace(clock):
    stream = io.StringIO()
    with progress(10_000, stream) as shown:
        for second in range(1, 61):
            clock.now += 1.0
            shown.update(100 * min(second, 30) + 10 * max(0, second - 30), 1.0, 0)

    # 3,300 scans are done, the last 300 at 10 a second
    assert stream.getvalue().splitlines()[-1].endswith("11 min 10 s left, 0 closures")


def test_on_a_terminal_there_is_a_bar(clock):
    stream = Terminal()
    with progress(1000, stream) as shown:
        shown.update(0, 0.0, 0)
        shown.update(1, 0.0, 0)
        clock.now += 2.0
        shown.update(501, 100.0, 0)

    assert "501/1000" in stream.getvalue()
    assert "50.0x real time" in stream.getvalue()


def test_more_scans_than_expected_leave_no_time(clock):
    stream = io.StringIO()
    with progress(10, stream) as shown:
        shown.update(1, 0.0, 0)
        clock.now += 6.0
        shown.update(20, 1.0, 0)

    assert " 0 s left" in stream.getvalue()


@pytest.mark.parametrize(
    ("seconds", "text"),
    [(0.2, "0 s"), (59.4, "59 s"), (59.6, "1 min 0 s"), (200, "3 min 20 s"), (7500, "2 h 5 min")],
)
def test_durations_read_as_people_say_them(seconds, text):
    assert format_duration(seconds) == text
