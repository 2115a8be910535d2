# SPDX-License-Identifier: Apache-2.0
"""Events that are useless by themselves, each with its reason."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from cartoloop.sensor.event_faults import fault_of
from cartoloop.sensor.events import (
    CloudGeometry,
    Imu,
    LaserScan,
    Odometry,
    PointCloud,
    ScanGeometry,
)
from cartoloop.sensor.pose import IDENTITY

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
