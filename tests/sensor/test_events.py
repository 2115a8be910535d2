# SPDX-License-Identifier: Apache-2.0
"""Sensor events: what readers may leave out means a level scanner that measures all at once."""

from __future__ import annotations

import math
from dataclasses import FrozenInstanceError
from typing import get_args

import numpy as np
import pytest

from cartoloop.sensor.events import (
    CloudGeometry,
    Imu,
    LaserScan,
    Odometry,
    PointCloud,
    ScanGeometry,
    SensorEvent,
)
from cartoloop.sensor.pose import IDENTITY


def test_a_geometry_is_level_and_without_sweep_by_default():
    geometry = ScanGeometry(-1.0, 0.5, 5, 0.1, 20.0)

    assert geometry.angles.tolist() == [-1.0, -0.5, 0.0, 0.5, 1.0]
    assert geometry.time_increment == 0.0
    assert (geometry.height, geometry.roll, geometry.pitch) == (0.0, 0.0, 0.0)
    assert geometry.sensor == ""


def test_a_cloud_geometry_drops_no_point_by_default():
    geometry = CloudGeometry()

    assert geometry.tf_tracking_sensor == IDENTITY
    assert (geometry.range_min, geometry.range_max) == (0.0, math.inf)
    assert (geometry.min_z, geometry.max_z) == (-math.inf, math.inf)


def test_every_event_is_frozen():
    cloud = PointCloud(1.0, 1.0, np.zeros((2, 3)), None, CloudGeometry())

    with pytest.raises(FrozenInstanceError):
        cloud.time = 2.0


def test_sensor_events_are_scans_clouds_odometry_and_imu():
    assert get_args(SensorEvent) == (LaserScan, PointCloud, Odometry, Imu)
