# SPDX-License-Identifier: Apache-2.0
"""Events on their way to local SLAM: checked, counted and queued."""

import math

import numpy as np
import pytest

from cartoloop.config import SensorConfig
from cartoloop.errors import UsageError
from cartoloop.event_intake import EventIntake
from cartoloop.sensor.events import LaserScan, Odometry, ScanGeometry
from cartoloop.sensor.pose import Pose

GEOMETRY = ScanGeometry(
    num_beams=3, angle_min=-1.0, angle_increment=1.0, range_min=0.1, range_max=10.0
)


class Readings:
    """Local SLAM, as far as the intake knows it: a scan is ready half a second later."""

    def __init__(self):
        self.odometry = []

    def add_odometry(self, reading):
        self.odometry.append(reading)

    def is_ready(self, scan, time):
        return scan.time + 0.5 <= time


@pytest.fixture
def readings():
    return Readings()


@pytest.fixture
def intake(readings):
    return EventIntake(SensorConfig(), readings, accepts_late_odometry=False)


def scan(time):
    return LaserScan(time, time, np.ones(3), GEOMETRY)


def test_scans_wait_until_their_sweeps_are_covered(intake):
    assert all(intake.take(scan(time)) for time in (1.0, 2.0, 3.0))
    assert [each.time for each in intake.ready_scans(2.5)] == [1.0, 2.0]
    assert list(intake.ready_scans(2.5)) == []
    assert [each.time for each in intake.ready_scans(math.inf)] == [3.0]
    assert intake.duration_s == 2.0


def test_odometry_is_passed_on_at_once(intake, readings):
    assert intake.take(Odometry(1.0, 1.0, Pose(1.0, 2.0, 0.3)))
    assert [each.time for each in readings.odometry] == [1.0]
    assert intake.num_scans == 0


def test_what_is_skipped_is_counted(intake, readings):
    intake.take(scan(2.0))
    assert not intake.take(scan(1.0))
    assert not intake.take(Odometry(1.0, 1.0, Pose(1.0, 2.0, 0.3)))
    assert intake.num_scans == 2
    assert intake.skipped.total() == 2
    assert readings.odometry == []
    assert len(list(intake.ready_scans(math.inf))) == 1


def test_only_events_are_taken(intake):
    with pytest.raises(UsageError, match=r"Mapper\.add: event"):
        intake.take("scan")
