# SPDX-License-Identifier: Apache-2.0
"""Sensor events that cannot be used: faulty by themselves, or out of order."""

from __future__ import annotations

import math

import numpy as np

from cartoloop.sensor.events import (
    CloudGeometry,
    Imu,
    LaserScan,
    Odometry,
    PointCloud,
    ScanGeometry,
    SensorEvent,
)
from cartoloop.sensor.repeated_scans import SENT_AGAIN, RepeatedScans
from cartoloop.sensor.time_repair import LATEST_STAMP

MAX_TURN_RATE, MAX_ACCELERATION = 100.0, 1000.0
"""Limits of what an IMU on a robot measures [rad/s], [m/s^2]."""


class EventChecker:
    """Finds events that are to be skipped.

    Those are faulty events, scans and odometry out of order, and scans that a scanner sends again
    while the robot moves.

    Attributes
    ----------
    first_time, last_time : of the first and the last accepted scan [s]; NaN and -inf before.

    Parameters
    ----------
    accepts_late_odometry : whether odometry may come after a later scan, as in live mapping.
    """

    def __init__(self, *, accepts_late_odometry: bool) -> None:
        self._accepts_late_odometry = accepts_late_odometry
        self.first_time = math.nan
        self.last_time = -math.inf
        self._last_time_of: dict[str, float] = {}
        self._sound: ScanGeometry | None = None
        self._repeated = RepeatedScans()

    def reason_to_skip(self, event: SensorEvent) -> str | None:
        """Return why an event cannot be used, or None; the next scans are compared with it."""
        if fault := self._fault_of(event):
            return fault
        if isinstance(event, Imu):
            return None
        if isinstance(event, Odometry):
            if event.time < self.last_time and not self._accepts_late_odometry:
                return "time runs backwards"
            self._repeated.odom = event.tf_odom_tracking
            return None
        if fault := self._fault_in_order(event):
            return fault
        if math.isnan(self.first_time):
            self.first_time = event.time
        self.last_time = self._last_time_of[event.geometry.sensor] = event.time
        return None

    def _fault_in_order(self, scan: LaserScan | PointCloud) -> str | None:
        """Return the fault of a scan among the events before it."""
        if scan.time < self.last_time:
            return "time runs backwards"
        if self._last_time_of.get(scan.geometry.sensor) == scan.time:
            return "two scans at one time"
        if isinstance(scan, LaserScan) and self._repeated.is_sent_again(scan):
            return SENT_AGAIN
        return None

    def _fault_of(self, event: SensorEvent) -> str | None:
        """Return the fault of an event; the geometry that scans share is examined once."""
        if not isinstance(event, LaserScan):
            return fault_of(event)
        is_known = event.geometry is self._sound and abs(event.time) <= LATEST_STAMP
        if is_known and event.ranges.shape == (event.geometry.num_beams,):
            return None
        fault = fault_of(event)
        if fault is None:
            self._sound = event.geometry
        return fault


def fault_of(event: SensorEvent) -> str | None:
    """Return the fault of an event in a few words, by which it is counted; None without one."""
    if not abs(event.time) <= LATEST_STAMP:
        is_number = math.isfinite(event.time)
        return "time is out of all bounds" if is_number else "time is not finite"
    match event:
        case Imu():
            return _fault_of_imu(event)
        case Odometry(tf_odom_tracking=pose):
            if not all(map(math.isfinite, pose)):
                return "odometry is not finite"
        case LaserScan():
            return _fault_of_scan(event)
        case PointCloud():
            return _fault_of_cloud(event)
    return None


def _fault_of_scan(scan: LaserScan) -> str | None:
    if scan.ranges.shape != (scan.geometry.num_beams,):
        return "number of ranges does not match the scanner"
    return _fault_of_geometry(scan.geometry)


def _fault_of_imu(imu: Imu) -> str | None:
    acceleration, rate = imu.linear_acceleration, imu.angular_velocity
    if not all(map(math.isfinite, (*acceleration, *rate))):
        return "IMU reading is not finite"
    if max(map(abs, rate)) > MAX_TURN_RATE:
        return "IMU turns faster than it can"
    if max(map(abs, acceleration)) > MAX_ACCELERATION:
        return "IMU reading is more than any acceleration"
    return None


def _fault_of_cloud(cloud: PointCloud) -> str | None:
    if cloud.points.ndim != 2 or cloud.points.shape[1] != 3:
        return "points of a cloud are not three numbers each"
    if fault := _fault_of_geometry(cloud.geometry):
        return fault
    if cloud.times is None:
        return None
    if cloud.times.shape != cloud.points.shape[:1]:
        return "number of times does not match the points of a cloud"
    return None if np.isfinite(cloud.times).all() else "times of a cloud are not finite"


def _fault_of_geometry(geometry: ScanGeometry | CloudGeometry) -> str | None:
    numbers = [*geometry.tf_tracking_sensor, geometry.height, geometry.roll, geometry.pitch]
    if isinstance(geometry, ScanGeometry):
        numbers += (geometry.angle_min, geometry.angle_increment, geometry.time_increment)
    if not all(map(math.isfinite, numbers)):
        return "angles, times or place of the scanner are not finite"
    if math.isnan(geometry.range_min) or math.isnan(geometry.range_max):
        return "range limits of the scanner are not numbers"
    return None
