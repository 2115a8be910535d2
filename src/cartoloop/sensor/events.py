# SPDX-License-Identifier: Apache-2.0
"""The sensor events that a recording or a live source yields, in the order they happened.

`stamp` is the time as recorded: it names the scan in trajectories and relations files and is never
altered. `time` is what the mapper computes with: seconds that never run backwards, repaired from
the stamps by the reader where these repeat, jump or run back.

Where a scanner sits on the robot is told by a pose in the plane, `tf_tracking_sensor`, and by
`height` [m], `roll` and `pitch` [rad]: a point p of the sensor frame lies at
Rz(yaw) Ry(pitch) Rx(roll) p + (x, y, height) in the tracking frame, whose z axis points up where
the robot stands level.
"""

from __future__ import annotations

import math
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
    tf_tracking_sensor : where the scanner sits on the robot, seen from above.
    time_increment : from one beam to the next [s]; beam i is measured at
        ``scan.time + i * time_increment``. 0: all beams at once, or nothing is known of it.
    sensor : name of the scanner; scans of one name come from one scanner.
    height, roll, pitch : the rest of where it sits: above the tracking frame [m], tilted [rad].
    """

    angle_min: float
    angle_increment: float
    num_beams: int
    range_min: float
    range_max: float
    no_return_is_free: bool = True
    tf_tracking_sensor: Pose = IDENTITY
    time_increment: float = 0.0
    sensor: str = ""
    height: float = 0.0
    roll: float = 0.0
    pitch: float = 0.0

    @property
    def angles(self) -> FloatArray:
        """Beam angles [rad], sensor frame, shape (num_beams,)."""
        return self.angle_min + self.angle_increment * np.arange(self.num_beams, dtype=np.float64)


@dataclass(frozen=True, slots=True)
class CloudGeometry:
    """Where a scanner of points in space sits, and which of its points count. Shared alike.

    Attributes
    ----------
    sensor : name of the scanner; clouds of one name come from one scanner.
    tf_tracking_sensor : where it sits on the robot, seen from above.
    height, roll, pitch : the rest of it: above the tracking frame [m], tilted [rad].
    range_min, range_max : nearer points, and those from the latter on, are no measurements [m].
    min_z, max_z : lower and higher points are left out [m], measured upright from the origin of
        the tracking frame; whatever the configuration cuts off is left out as well. -inf and inf:
        nothing is told, and what is about as high as the scanner counts.
    """

    sensor: str = ""
    tf_tracking_sensor: Pose = IDENTITY
    height: float = 0.0
    roll: float = 0.0
    pitch: float = 0.0
    range_min: float = 0.0
    range_max: float = math.inf
    min_z: float = -math.inf
    max_z: float = math.inf


@dataclass(frozen=True, slots=True)
class LaserScan:
    """One sweep of a scanner.

    Attributes
    ----------
    stamp : as recorded [s]; the scan's name.
    time : of the first beam, repaired, never running backwards [s]; the pose that is found for
        the scan is the robot's at this moment.
    ranges : float64, shape (geometry.num_beams,) [m]; may be inf, NaN, negative or overlong.
    geometry : shared among all scans of a sensor.
    """

    stamp: float
    time: float
    ranges: FloatArray
    geometry: ScanGeometry

    @property
    def sweep(self) -> tuple[float, float]:
        """When the first and the last beam are measured, from `time` on [s], the earlier first."""
        last = self.geometry.time_increment * max(self.geometry.num_beams - 1, 0)
        return (last, 0.0) if last < 0.0 else (0.0, last)


@dataclass(frozen=True, slots=True)
class PointCloud:
    """One sweep of a scanner of points in space.

    Attributes
    ----------
    stamp : as recorded [s]; the cloud's name.
    time : repaired, never running backwards [s]; the pose that is found for the cloud is the
        robot's at this moment.
    points : float64, shape (n, 3) [m], sensor frame; may hold NaN and inf, which are left out.
    times : float64, shape (n,), when each point was measured [s], from `time` on; None if all
        were at once, or nothing is known of it.
    geometry : shared among all clouds of a sensor.
    """

    stamp: float
    time: float
    points: FloatArray
    times: FloatArray | None
    geometry: CloudGeometry

    @property
    def sweep(self) -> tuple[float, float]:
        """When the first and the last point are measured, from `time` on [s]."""
        if self.times is None or len(self.times) == 0:
            return (0.0, 0.0)
        return (float(self.times.min()), float(self.times.max()))


@dataclass(frozen=True, slots=True)
class Odometry:
    """A wheel-odometry pose: the robot in the odometry's own, drifting frame."""

    stamp: float
    time: float
    tf_odom_tracking: Pose


@dataclass(frozen=True, slots=True)
class Imu:
    """An inertial reading, turned into the tracking frame by the reader.

    Attributes
    ----------
    stamp : as recorded [s].
    time : repaired, never running backwards [s].
    linear_acceleration : x, y, z, tracking frame [m/s^2], gravity included: (0, 0, 9.8) at rest.
    angular_velocity : x, y, z, tracking frame [rad/s].
    """

    stamp: float
    time: float
    linear_acceleration: tuple[float, float, float]
    angular_velocity: tuple[float, float, float]


SensorEvent = LaserScan | PointCloud | Odometry | Imu
