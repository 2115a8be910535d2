# SPDX-License-Identifier: Apache-2.0
"""The sensor events that a recording or a live source yields, in the order they happened.

`stamp` is the time as recorded: it identifies the scan in trajectories and relations files and is
never changed. `time` is what the mapper computes with: seconds that never run backwards, repaired
from the stamps by the reader where these repeat, jump or run backwards.

The pose of a scanner on the robot is a pose in the plane, `tf_tracking_sensor`, and `height` [m],
`roll` and `pitch` [rad]: a point p of the sensor frame is at
Rz(yaw) Ry(pitch) Rx(roll) p + (x, y, height) in the tracking frame, whose z axis points up where
the robot is level.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from cartoloop.arguments import as_array, as_number, as_numbers, require_type
from cartoloop.arrays import FloatArray
from cartoloop.errors import UsageError
from cartoloop.sensor.pose import IDENTITY, Pose

MAX_ANGLE = 2.0 * math.tau
"""Larger angles, and sweeps over more, are not in radians: scanners turn once, or a bit more."""


def _set(event: object, name: str, value: object) -> None:
    """Set a field of an object that is being made, which does not change afterwards."""
    object.__setattr__(event, name, value)


def _check_mounting(geometry: ScanGeometry | CloudGeometry, kind: str) -> None:
    """Convert the pose of a scanner on the robot, and refuse what is none, or in degrees."""
    pose = _as_pose(geometry.tf_tracking_sensor, f"{kind}: tf_tracking_sensor")
    _set(geometry, "tf_tracking_sensor", pose)
    for name in ("height", "roll", "pitch", "range_min", "range_max"):
        _set(geometry, name, as_number(getattr(geometry, name), f"{kind}: {name}"))
    _require_radians(pose.theta, f"{kind}: tf_tracking_sensor.theta")
    _require_radians(geometry.roll, f"{kind}: roll")
    _require_radians(geometry.pitch, f"{kind}: pitch")
    require_type(geometry.sensor, str, f"{kind}: sensor", "a name")


def _require_radians(angle: float, what: str) -> None:
    if math.isfinite(angle) and abs(angle) > MAX_ANGLE:
        raise UsageError(
            f"{what} is {angle:g}, which is more than two turns: give radians, not degrees"
        )


def _as_pose(value: object, what: str) -> Pose:
    if type(value) is Pose and all(type(number) is float for number in value):
        return value
    return Pose(*as_numbers(value, f"{what}, a Pose(x, y, theta),", 3))


def _check_times(event: SensorEvent, kind: str) -> None:
    if type(event.stamp) is not float:
        _set(event, "stamp", as_number(event.stamp, f"{kind}: stamp [s]"))
    if type(event.time) is not float:
        _set(event, "time", as_number(event.time, f"{kind}: time [s]"))


@dataclass(frozen=True, slots=True)
class ScanGeometry:
    """Directions of the beams and valid ranges of a scanner; one object for all its scans.

    Attributes
    ----------
    angle_min : angle of beam 0 [rad], sensor frame, counter-clockwise from the x axis.
    angle_increment : angle from one beam to the next [rad]; may be negative (clockwise sensors).
    num_beams : number of ranges of a scan.
    range_min : shorter ranges are no measurements [m].
    range_max : ranges from here on are no measurements [m].
    no_return_is_free : whether a range of `range_max` or more means that there is no obstacle
        (SICK logs), so that the beam clears free space; +inf always means that (REP 117).
    tf_tracking_sensor : pose of the scanner on the robot, seen from above.
    time_increment : from one beam to the next [s]; beam i is measured at
        ``scan.time + i * time_increment``. 0: all beams at once, or not known.
    sensor : name of the scanner; scans of one name come from one scanner.
    height, roll, pitch : the rest of its pose: above the tracking frame [m], tilted [rad].

    Raises
    ------
    UsageError
        An attribute is of another kind, or an angle cannot be in radians.
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

    def __post_init__(self) -> None:
        _check_mounting(self, "ScanGeometry")
        for name in ("angle_min", "angle_increment", "time_increment"):
            _set(self, name, as_number(getattr(self, name), f"ScanGeometry: {name}"))
        count = self.num_beams
        if not isinstance(count, int | np.integer) or count < 0:
            raise UsageError(f"ScanGeometry: num_beams is {count!r}: give a whole number")
        _require_radians(self.angle_min, "ScanGeometry: angle_min")
        sweep = self.angle_increment * max(count - 1, 0)
        if math.isfinite(sweep) and abs(sweep) > MAX_ANGLE:
            raise UsageError(
                f"ScanGeometry: angle_increment is {self.angle_increment:g}, with which {count} "
                "beams sweep over more than two turns: give radians, not degrees"
            )

    @property
    def is_level(self) -> bool:
        """Whether the scanner is mounted level."""
        return self.roll == 0.0 and self.pitch == 0.0

    @property
    def angles(self) -> FloatArray:
        """Beam angles [rad], sensor frame, shape (num_beams,)."""
        return self.angle_min + self.angle_increment * np.arange(self.num_beams, dtype=np.float64)


@dataclass(frozen=True, slots=True)
class CloudGeometry:
    """Pose and valid points of a scanner of point clouds; one object for all its clouds.

    Attributes
    ----------
    sensor : name of the scanner; clouds of one name come from one scanner.
    tf_tracking_sensor : pose of the scanner on the robot, seen from above.
    height, roll, pitch : the rest of its pose: above the tracking frame [m], tilted [rad].
    range_min, range_max : points nearer than the first, or at least as far as the second, are no
        measurements [m].
    min_z, max_z : lower and higher points are dropped [m], height above the tracking frame; the
        configuration may drop more. -inf and inf: not known; points at about the height of the
        scanner are used.
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

    def __post_init__(self) -> None:
        _check_mounting(self, "CloudGeometry")
        for name in ("min_z", "max_z"):
            _set(self, name, as_number(getattr(self, name), f"CloudGeometry: {name}"))


@dataclass(frozen=True, slots=True, eq=False)
class LaserScan:
    """One sweep of a scanner.

    Attributes
    ----------
    stamp : as recorded [s]; identifies the scan.
    time : of the first beam, repaired, never running backwards [s]; the pose of the scan is the
        robot's at this time.
    ranges : float64, shape (geometry.num_beams,) [m]; may be inf, NaN, negative or too long.
    geometry : shared among all scans of a sensor.
    """

    stamp: float
    time: float
    ranges: FloatArray
    geometry: ScanGeometry

    def __post_init__(self) -> None:
        _check_times(self, "LaserScan")
        _set(self, "ranges", as_array(self.ranges, "LaserScan: ranges"))
        if type(self.geometry) is not ScanGeometry:
            require_type(self.geometry, ScanGeometry, "LaserScan: geometry", "a ScanGeometry")

    @property
    def sweep(self) -> tuple[float, float]:
        """Times of the first and the last beam relative to `time` [s], the earlier first."""
        last = self.geometry.time_increment * max(self.geometry.num_beams - 1, 0)
        return (last, 0.0) if last < 0.0 else (0.0, last)


@dataclass(frozen=True, slots=True, eq=False)
class PointCloud:
    """One sweep of a scanner of point clouds.

    Attributes
    ----------
    stamp : as recorded [s]; identifies the cloud.
    time : repaired, never running backwards [s]; the pose of the cloud is the robot's at this
        time.
    points : float64, shape (n, 3) [m], sensor frame; NaN and inf are ignored.
    times : float64, shape (n,), when each point was measured, relative to `time` [s]; None if
        all at once, or not known.
    geometry : shared among all clouds of a sensor.
    """

    stamp: float
    time: float
    points: FloatArray
    times: FloatArray | None
    geometry: CloudGeometry

    def __post_init__(self) -> None:
        _check_times(self, "PointCloud")
        _set(self, "points", as_array(self.points, "PointCloud: points"))
        if self.times is not None:
            _set(self, "times", as_array(self.times, "PointCloud: times"))
        if type(self.geometry) is not CloudGeometry:
            require_type(self.geometry, CloudGeometry, "PointCloud: geometry", "a CloudGeometry")

    @property
    def sweep(self) -> tuple[float, float]:
        """Times of the first and the last point relative to `time` [s]."""
        if self.times is None or len(self.times) == 0:
            return (0.0, 0.0)
        return (float(self.times.min()), float(self.times.max()))


@dataclass(frozen=True, slots=True)
class Odometry:
    """A wheel-odometry pose: the robot in the odometry's own, drifting frame."""

    stamp: float
    time: float
    tf_odom_tracking: Pose

    def __post_init__(self) -> None:
        _check_times(self, "Odometry")
        pose = self.tf_odom_tracking
        if type(pose) is not Pose or type(pose.x) is not float:
            _set(self, "tf_odom_tracking", _as_pose(pose, "Odometry: tf_odom_tracking"))


@dataclass(frozen=True, slots=True)
class Imu:
    """An inertial reading, rotated into the tracking frame by the reader.

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

    def __post_init__(self) -> None:
        _check_times(self, "Imu")
        for name in ("linear_acceleration", "angular_velocity"):
            value = getattr(self, name)
            if type(value) is not tuple or len(value) != 3:
                _set(self, name, as_numbers(value, f"Imu: {name}", 3))


SensorEvent = LaserScan | PointCloud | Odometry | Imu
