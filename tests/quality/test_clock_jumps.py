# SPDX-License-Identifier: Apache-2.0
"""A clock that jumps while the robot drives on is no gap in its motion; a carried robot is."""

from __future__ import annotations

import pytest

from cartoloop.quality import motion
from cartoloop.quality.clock_jumps import clock_jump_places, clock_jumps
from cartoloop.quality.verdict import Kind, Severity
from tests.quality.test_path_findings import drive, without

JUMP_AT = 40
"""First scan after the gap."""


def jumped(by=3600.0):
    run = drive()
    run.stamps[JUMP_AT:] += by
    return run


def reported(run, metres, radians=0.0):
    """Return the summary of odometry that moved so far across the gap."""
    begin, end = run.stamps[JUMP_AT - 1 : JUMP_AT + 1].tolist()
    pause = {"begin": begin, "end": end, "odometry_m": metres, "odometry_rad": radians}
    return {"pauses": [pause]}


def test_a_clock_that_jumps_is_a_minor_place():
    run = jumped()
    gaps = motion.gaps(run)
    found = clock_jumps(gaps, (), run, reported(run, 0.19))

    assert [(event.scan, event.expected) for event in found] == [(JUMP_AT, 0.19)]
    [place] = clock_jump_places(found, run)
    assert (place.kind, place.severity) == (Kind.GAP, Severity.MINOR)
    assert "jumps by 3600.2 s" in place.reason
    assert "0.19 m by the odometry, 0.20 m by the scans" in place.reason


@pytest.mark.parametrize("metres", [0.0, 0.05, 0.5, 3600.0])
def test_odometry_must_drive_on_as_the_scans_do(metres):
    run = jumped()

    assert clock_jumps(motion.gaps(run), (), run, reported(run, metres)) == []


def test_odometry_must_turn_as_the_scans_do():
    run = jumped()

    assert clock_jumps(motion.gaps(run), (), run, reported(run, 0.2, radians=0.5)) == []


def test_without_odometry_a_gap_remains():
    run = jumped()

    for odometry in (None, {}, {"pauses": []}):
        assert clock_jumps(motion.gaps(run), (), run, odometry) == []


def test_odometry_of_another_gap_says_nothing():
    run = jumped()
    odometry = reported(run, 0.2)
    odometry["pauses"][0]["end"] += 5.0

    assert clock_jumps(motion.gaps(run), (), run, odometry) == []


def test_a_robot_that_stops_and_is_carried_is_a_gap():
    # Neither wheels nor scans along bare walls show it, but a robot at speed does not just stop.
    run = without(drive(), 108.0, 114.0, moved=False)

    [gap] = motion.gaps(run)
    assert gap.scan == JUMP_AT
    assert clock_jumps([gap], (), run, reported(run, 0.0)) == []


def test_scans_that_do_not_fit_remain_a_gap():
    run = jumped()

    assert clock_jumps(motion.gaps(run), {JUMP_AT}, run, reported(run, 0.2)) == []
