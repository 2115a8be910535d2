# SPDX-License-Identifier: Apache-2.0
"""Events that cannot be used, each with its reason."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from cartoloop.sensor.event_faults import EventChecker, fault_of
from cartoloop.sensor.events import (
    CloudGeometry,
    Imu,
    LaserScan,
    Odometry,
    PointCloud,
    ScanGeometry,
)
from cartoloop.sensor.pose import IDENTITY, Pose
from cartoloop.sensor.repeated_scans import MIN_CHANGES, SENT_AGAIN

SCAN = LaserScan(1.0, 1.0, np.ones(3), ScanGeometry(0.0, 0.1, 3, 0.1, 9.0))
CLOUD = PointCloud(1.0, 1.0, np.ones((4, 3)), np.zeros(4), CloudGeometry())
ODOMETRY = Odometry(1.0, 1.0, IDENTITY)
IMU = Imu(1.0, 1.0, (0.0, 0.0, 9.8), (0.0, 0.0, 0.0))


@pytest.mark.parametrize("event", [SCAN, CLOUD, replace(CLOUD, times=None), ODOMETRY, IMU])
def test_good_events_have_no_fault(event):
    assert fault_of(event) is None


@pytest.mark.parametrize("event", [SCAN, CLOUD, ODOMETRY, IMU])
def test_a_time_must_be_finite(event):
    assert fault_of(replace(event, time=math.nan)) == "time is not finite"
    assert fault_of(replace(event, time=1e300)) == "time is out of all bounds"


@pytest.mark.parametrize(
    ("event", "reason"),
    [
        (replace(SCAN, ranges=np.ones(4)), "number of ranges does not match the scanner"),
        (replace(CLOUD, points=np.ones((4, 2))), "points of a cloud are not three numbers each"),
        (replace(CLOUD, points=np.ones(3)), "points of a cloud are not three numbers each"),
        (
            replace(CLOUD, times=np.ones(3)),
            "number of times does not match the points of a cloud",
        ),
        (
            replace(CLOUD, times=np.array((0.0, 1.0, math.nan, 0.0))),
            "times of a cloud are not finite",
        ),
        (
            replace(ODOMETRY, tf_odom_tracking=IDENTITY._replace(x=math.inf)),
            "odometry is not finite",
        ),
        (replace(IMU, angular_velocity=(0.0, math.nan, 0.0)), "IMU reading is not finite"),
        (replace(IMU, linear_acceleration=(math.inf, 0.0, 0.0)), "IMU reading is not finite"),
    ],
)
def test_each_fault_has_its_reason(event, reason):
    assert fault_of(event) == reason


@pytest.mark.parametrize(
    "event",
    [
        replace(IMU, angular_velocity=(0.0, -900.0, 0.0)),
        replace(IMU, linear_acceleration=(0.0, 0.0, 1e5)),
    ],
)
def test_implausible_imu_readings_are_faults(event):
    assert "than" in str(fault_of(event))


@pytest.mark.parametrize(
    "values",
    [
        {"time_increment": math.inf},
        {"angle_increment": math.nan},
        {"range_max": math.nan},
        {"tf_tracking_sensor": IDENTITY._replace(x=math.nan)},
    ],
)
def test_the_geometry_of_a_scanner_must_be_finite(values):
    assert "of the scanner" in str(
        fault_of(replace(SCAN, geometry=replace(SCAN.geometry, **values)))
    )
    both = {key: value for key, value in values.items() if hasattr(CLOUD.geometry, key)}
    if both:
        broken = replace(CLOUD, geometry=replace(CLOUD.geometry, **both))
        assert "of the scanner" in str(fault_of(broken))


def reasons(*events, late=False):
    checker = EventChecker(accepts_late_odometry=late)
    return [checker.reason_to_skip(event) for event in events]


def test_scans_must_be_in_order_and_differ_in_time():
    earlier = replace(SCAN, time=0.5)
    assert reasons(SCAN, earlier, SCAN) == [None, "time runs backwards", "two scans at one time"]


def test_scans_of_two_scanners_can_have_one_time():
    assert reasons(SCAN, replace(CLOUD, geometry=CloudGeometry(sensor="other"))) == [None, None]


def test_faulty_scans_are_not_compared_with():
    faulty = replace(SCAN, time=9.0, ranges=np.ones(4))
    assert reasons(faulty, SCAN)[1] is None


@pytest.mark.parametrize(("late", "reason"), [(True, None), (False, "time runs backwards")])
def test_late_odometry_is_accepted_where_configured(late, reason):
    assert reasons(SCAN, replace(ODOMETRY, time=0.5), late=late) == [None, reason]


def test_the_times_of_accepted_scans_are_kept():
    checker = EventChecker(accepts_late_odometry=False)
    assert math.isnan(checker.first_time)
    for time in (1.0, 3.0, 2.0):
        checker.reason_to_skip(replace(SCAN, time=time))
    assert (checker.first_time, checker.last_time) == (1.0, 3.0)


def moved(time, pose):
    return Odometry(time, time, pose)


def seen(time, ranges, sensor="laser"):
    geometry = ScanGeometry(0.0, 0.01, len(ranges), 0.1, 9.0, sensor=sensor)
    return LaserScan(time, time, ranges, geometry)


WALLS = np.linspace(1.0, 4.0, 90)


def checker_of_changing_scans():
    """A checker that has seen as many different scans as it takes, to time 0."""
    checker = EventChecker(accepts_late_odometry=False)
    for i in range(MIN_CHANGES - 1):
        assert checker.reason_to_skip(seen(i - 100.0, WALLS + 0.1 * (i + 1))) is None
    return checker


OTHER_WALLS = np.where(np.arange(90) == 40, 1.5, WALLS)


@pytest.mark.parametrize(
    ("pose", "ranges", "reason"),
    [
        (Pose(0.05, 0.0, 0.0), WALLS, SENT_AGAIN),
        (Pose(0.0, 0.0, 0.05), WALLS, SENT_AGAIN),
        (Pose(0.0, 0.0, 2.0 * math.pi), WALLS, None),
        (Pose(0.01, 0.0, 0.005), WALLS, None),
        (Pose(0.05, 0.0, 0.0), OTHER_WALLS, None),
    ],
)
def test_a_scan_sent_again_by_a_moving_robot_is_found(pose, ranges, reason):
    checker = checker_of_changing_scans()
    for event in (moved(1.0, IDENTITY), seen(1.0, WALLS), moved(1.1, pose)):
        assert checker.reason_to_skip(event) is None

    assert checker.reason_to_skip(seen(1.1, ranges)) == reason


def test_scans_sent_again_are_compared_with_the_first_of_them():
    checker = checker_of_changing_scans()
    reasons = []
    for step in range(5):
        checker.reason_to_skip(moved(float(step), Pose(0.009 * step, 0.0, 0.0)))
        reasons.append(checker.reason_to_skip(seen(float(step), WALLS)))

    assert reasons == [None, None, None, SENT_AGAIN, SENT_AGAIN]


def test_equal_scans_of_nothing_or_of_two_scanners_are_used():
    checker = checker_of_changing_scans()
    nothing = np.full(90, 9.0)
    for step in range(3):
        checker.reason_to_skip(moved(float(step), Pose(float(step), 0.0, 0.0)))
        assert checker.reason_to_skip(seen(float(step), nothing)) is None
        assert checker.reason_to_skip(seen(float(step), WALLS + step, "rear")) is None


def test_equal_scans_without_odometry_are_used():
    checker = checker_of_changing_scans()

    assert [checker.reason_to_skip(seen(float(i), WALLS)) for i in range(3)] == [None] * 3


def test_scans_that_never_changed_are_used():
    checker = EventChecker(accepts_late_odometry=False)
    for step in range(20):
        assert checker.reason_to_skip(moved(float(step), Pose(float(step), 0.0, 0.0))) is None
        assert checker.reason_to_skip(seen(float(step), WALLS)) is None
