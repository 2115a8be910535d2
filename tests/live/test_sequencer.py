# SPDX-License-Identifier: Apache-2.0
"""Messages become events in the order that mapping wants, in bounded time."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

from cartoloop.live.inbox import Arrival
from cartoloop.live.messages import parse_message
from cartoloop.live.notices import Notices
from cartoloop.live.scanner import FIRST_S, FIRST_SCANS
from cartoloop.live.sequencer import MAX_MISSES, MAX_SENSORS, Sequencer
from cartoloop.sensor.events import (
    CloudGeometry,
    Imu,
    LaserScan,
    Odometry,
    PointCloud,
    ScanGeometry,
)
from cartoloop.sensor.pose import Pose
from tests.live.live_room import lines

RNG = np.random.default_rng(1)


def scan(stamp, sensor="", num_beams=30, value=None, **options):
    geometry = ScanGeometry(0.0, 0.1, num_beams, 0.0, math.inf, sensor=sensor, **options)
    ranges = RNG.uniform(1.0, 5.0, num_beams) if value is None else np.full(num_beams, value)
    return LaserScan(stamp, math.nan, ranges, geometry)


def odometry(stamp, x=0.0):
    return Odometry(stamp, math.nan, Pose(x, 0.0, 0.0))


class Line:
    """A sequencer past its first scans, and what came out of it."""

    def __init__(self, sensors=("",), **options):
        self.reported = []
        self.sequencer = Sequencer(Notices(self.reported.append), **options)
        for k in range(FIRST_SCANS):
            for sensor in sensors:
                self.sequencer.add(Arrival(scan(k * 0.001, sensor), k * 0.001))
        self.first = self.out(1.0)
        self.reported.clear()

    def add(self, message, arrival):
        self.sequencer.add(Arrival(message, arrival))

    def out(self, now):
        return [
            (type(event).__name__, round(event.time, 6)) for event, _ in self.sequencer.ready(now)
        ]


def test_first_scans_wait_for_the_profile_and_none_is_lost():
    reported = []
    sequencer = Sequencer(Notices(reported.append))
    for k in range(FIRST_SCANS):
        assert list(sequencer.ready(0.01 * k)) == []
        sequencer.add(Arrival(scan(0.01 * k), 0.01 * k))
    events = [event for event, _ in sequencer.ready(0.01 * FIRST_SCANS + 1.0)]

    assert len(events) == FIRST_SCANS
    assert reported[1] == f"scanner, by its first {FIRST_SCANS} scans:"
    assert "30 beams" in reported[2] or "beams      30" in reported[2]


def test_a_slow_scanner_is_known_after_a_time():
    sequencer = Sequencer(Notices(lambda line: None))
    sequencer.add(Arrival(scan(0.0), 10.0))

    assert sequencer.next_deadline == 10.0 + FIRST_S
    assert list(sequencer.ready(10.0 + FIRST_S - 0.01)) == []
    assert len(list(sequencer.ready(10.0 + FIRST_S))) == 1


def test_the_no_return_value_is_read_off_the_first_scans():
    reported = []
    sequencer = Sequencer(Notices(reported.append))
    for k, line in enumerate(lines(duration=12.0)):
        sequencer.add(Arrival(parse_message(line), 0.05 * k))
    events = [event for event, _ in sequencer.ready(math.inf) if isinstance(event, LaserScan)]

    assert 81.0 < events[0].geometry.range_max < 81.91
    assert all(event.geometry is events[0].geometry for event in events)
    assert any("no return: 81.91" in line for line in reported)


def test_a_no_return_value_that_is_seen_later_is_adopted():
    line = Line()
    for k in range(400):
        message = scan(1.0 + 0.1 * k)
        message.ranges[10 + k % 15 :] = 81.91
        line.add(message, 1.0 + 0.1 * k)
        line.sequencer.scanners[""].wait()
        list(line.sequencer.ready(math.inf))
    line.add(scan(50.0), 50.0)

    [(last, _)] = line.sequencer.ready(math.inf)
    assert last.geometry.range_max == pytest.approx(81.91, rel=0.01)
    assert any("ranges" in text and "81." in text for text in line.reported)


def test_odometry_a_little_late_is_used_before_its_scan():
    line = Line()
    line.add(odometry(2.00), 2.0)
    line.add(scan(2.02), 2.02)

    assert line.out(2.02) == [("Odometry", 2.0)]
    line.add(odometry(2.03), 2.05)
    assert line.out(2.05) == [("Odometry", 2.03), ("LaserScan", 2.02)]


def test_no_scan_waits_for_long():
    line = Line(max_delay=0.05)
    line.add(odometry(2.00), 2.0)
    line.add(scan(2.02), 2.02)

    assert line.sequencer.next_deadline == pytest.approx(2.07)
    assert line.out(2.069) == [("Odometry", 2.0)]
    assert line.out(2.0701) == [("LaserScan", 2.02)]


def test_silent_and_late_sensors_are_not_waited_for():
    line = Line(max_delay=0.05)
    line.add(odometry(2.00), 2.0)
    line.add(scan(3.5), 3.5)
    assert line.out(3.5) == [("Odometry", 2.0), ("LaserScan", 3.5)]

    for k in range(MAX_MISSES):
        line.add(odometry(4.0 + k - 0.5), 4.0 + k)
        line.add(scan(4.0 + k), 4.0 + k)
        assert len(line.out(4.06 + k)) == 2
    line.add(odometry(29.5), 30.0)
    line.add(scan(30.0), 30.0)
    assert [kind for kind, _ in line.out(30.0)] == ["Odometry", "LaserScan"]


def test_a_sweep_waits_for_messages_until_its_end():
    line = Line()
    line.add(odometry(2.0), 2.0)
    line.add(scan(2.0, time_increment=0.001), 2.03)

    assert line.out(2.03) == [("Odometry", 2.0)]
    line.add(odometry(2.02), 2.035)
    assert line.out(2.035) == [("Odometry", 2.02)]
    line.add(odometry(2.03), 2.04)
    assert line.out(2.04) == [("Odometry", 2.03), ("LaserScan", 2.0)]


def test_scans_of_two_scanners_come_in_order():
    line = Line(sensors=("front", "rear"))
    line.add(scan(2.0, "front"), 2.0)
    line.add(scan(2.01, "front"), 2.01)
    line.add(scan(1.99, "rear"), 2.015)
    line.add(scan(2.1, "rear"), 2.02)

    assert [time for _, time in line.out(2.02)] == [1.99, 2.0, 2.01]


def test_damaged_order_is_repaired_or_counted():
    line = Line()
    again = scan(2.0)
    for message, arrival in [(again, 2.0), (again, 2.0), (scan(1.9), 2.1)]:
        line.add(message, arrival)
    line.add(odometry(2.0), 2.11)
    line.add(odometry(1.5), 2.12)

    assert [time for _, time in line.out(3.0)] == [2.0, 2.0, pytest.approx(2.1, abs=0.11)]
    assert "the same scan again, not used" in line.reported
    assert "stamps of scans repeat or run backwards: repaired" in line.reported
    assert "odometry out of order, not used" in line.reported


def test_clouds_and_imu_need_no_profile():
    sequencer = Sequencer(Notices(lambda line: None), laser_pose=Pose(1.0, 0.0, 0.0))
    sequencer.add(Arrival(Imu(1.0, math.nan, (0.0, 0.0, 9.8), (0.0, 0.0, 0.0)), 1.0))
    cloud = PointCloud(math.nan, math.nan, np.ones((4, 3)), None, CloudGeometry("top"))
    sequencer.add(Arrival(cloud, 1.5))

    imu, cloud = [event for event, _ in sequencer.ready(2.0)]
    assert imu.time == 1.0
    assert cloud.time == cloud.stamp == pytest.approx(1.5)
    assert cloud.geometry.tf_tracking_sensor.x == 1.0


def test_nonsense_sensors_do_not_fill_the_memory():
    line = Line()
    for k in range(100):
        line.add(scan(2.0 + 0.1 * k, f"scanner {k}"), 2.0 + 0.1 * k)

    assert len(line.out(100.0)) == MAX_SENSORS - 1
    assert f"scans of more than {MAX_SENSORS} sensors, not used" in line.reported


def test_the_pose_of_the_scanner_can_be_given():
    line = Line(laser_pose=Pose(0.3, 0.0, 0.1))
    line.add(scan(2.0), 2.0)

    [(event, _)] = line.sequencer.ready(3.0)
    assert event.geometry.tf_tracking_sensor == Pose(0.3, 0.0, 0.1)


def test_beams_beyond_a_given_range_max_do_not_clear():
    content = json.loads(lines(1.0)[1]) | {"range_max": 30.0}
    sequencer = Sequencer(Notices(lambda line: None))
    sequencer.add(Arrival(parse_message(json.dumps(content)), 0.0))

    [(event, _)] = sequencer.ready(math.inf)
    assert event.geometry.range_max <= 30.0
    assert not event.geometry.no_return_is_free
    assert isinstance(Odometry, type)
