# SPDX-License-Identifier: Apache-2.0
"""Gaps across which the poses moved faster than the robot drives."""

from __future__ import annotations

import pytest

from cartoloop.quality.leaps import leap_places, leaps
from cartoloop.quality.verdict import Severity
from tests.quality.gap_run import Run, drive


def test_a_robot_that_drove_on_crossed_the_gap():
    assert leaps(drive(gap=5.0, moved=5.0)) == []


def test_poses_faster_than_the_robot_are_doubtful():
    run = drive(gap=5.0, moved=8.0)
    [event] = leaps(run)
    assert event.scan == 50
    assert event.seconds == pytest.approx(5.2)
    assert event.moved == pytest.approx(8.2)
    assert event.expected == pytest.approx(5.2, abs=0.01)
    [place] = leap_places([event], run)
    assert place.severity is Severity.DOUBTFUL
    assert "8.2 m meanwhile: the robot drives 5.2 m at most" in place.reason


def test_steps_without_a_gap_are_no_leaps():
    assert leaps(drive(gap=0.0, moved=8.0)) == []


def test_too_few_scans_show_no_speed():
    run = drive(gap=5.0, moved=8.0)
    assert leaps(Run(run.stamps[40:60], run.trajectory[40:60])) == []
