# SPDX-License-Identifier: Apache-2.0
"""The sensor events that a recording or a live source yields, in the order they happened.

`stamp` is the time as recorded: it names the scan in trajectories and relations files and is never
altered. `time` is what the mapper computes with: seconds that never run backwards, repaired from
the stamps by the reader where these repeat, jump or run back.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cartoloop.sensor.pose import IDENTITY, Pose

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class ScanGeometry:
    """Which beam looks where, and which ranges are measurements. Shared by all scans alike.

    Attributes
    ----------
    angle_min : angle of beam 0 [rad], sensor frame, counter-clockwise from the x axis.
    angle_increment : angle from one beam to the next [rad]; may be negative (clockwise sensors).
    num_beams : how many ranges a scan has.
    range_min : shorter ranges are no measurements [m].
    range_max : ranges from here on are no measurements [m].
    no_return_is_free : whether a range at or over `range_max` means that the beam met nothing
        (SICK logs), and so may clear free space; +inf always means that (REP 117).
    tf_tracking_sensor : where the scanner sits on the robot.
    """

    angle_min: float
    angle_increment: float
    num_beams: int
    range_min: float
    range_max: float
    no_return_is_free: bool = True
    tf_tracking_sensor: Pose = IDENTITY

    @property
    def angles(self) -> FloatArray:
        """Beam angles [rad], sensor frame, shape (num_beams,)."""
        return self.angle_min + self.angle_increment * np.arange(self.num_beams, dtype=np.float64)


@dataclass(frozen=True, slots=True)
class LaserScan:
    """One sweep of a scanner.

    Attributes
    ----------
    stamp : as recorded [s]; the scan's name.
    time : repaired, never running backwards [s].
    ranges : float64, shape (geometry.num_beams,) [m]; may be inf, NaN, negative or overlong.
    geometry : shared among all scans of a sensor.
    """

    stamp: float
    time: float
    ranges: FloatArray
    geometry: ScanGeometry


@dataclass(frozen=True, slots=True)
class Odometry:
    """A wheel-odometry pose: the robot in the odometry's own, drifting frame."""

    stamp: float
    time: float
    tf_odom_tracking: Pose


@dataclass(frozen=True, slots=True)
class Imu:
    """An inertial reading: acceleration [m/s^2] and angular velocity [rad/s], each (x, y, z)."""

    stamp: float
    time: float
    linear_acceleration: tuple[float, float, float]
    angular_velocity: tuple[float, float, float]


SensorEvent = LaserScan | Odometry | Imu
