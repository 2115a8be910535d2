# SPDX-License-Identifier: Apache-2.0
"""From the bytes of a message to a sensor event, for each kind of sensor."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from cartoloop.arrays import FloatArray
from cartoloop.readers.read_options import ReadOptions
from cartoloop.readers.ros import raw_messages as ros
from cartoloop.readers.ros.choice import ScannerChoice
from cartoloop.readers.ros.cloud import decode_cloud
from cartoloop.readers.ros.imu_choice import ABSURD_READING, ImuChoice
from cartoloop.readers.ros.odometry_choice import OdometryChoice
from cartoloop.readers.ros.transforms import Pose3
from cartoloop.readers.ros.wire import DecodeError
from cartoloop.sensor.events import (
    MAX_ANGLE,
    CloudGeometry,
    Imu,
    LaserScan,
    Odometry,
    PointCloud,
    ScanGeometry,
)
from cartoloop.sensor.pose import Pose
from cartoloop.sensor.sensor_profile import SensorProfile

_MAX_GEOMETRIES = 256
"""Geometries kept of scanners whose beams change from scan to scan: bounds the memory."""

_NEAREST_OF_CLOUDS = 0.3
"""Nearer points of clouds are mostly the robot itself [m]."""


class ScanDecoder:
    """Laser scans of one scanner; scans with the same beams share one geometry object.

    The beams of a scanner mounted upside down are mirrored: turned by pi about x, its beam at
    angle a has the direction of a beam at -a of an upright one.
    """

    def __init__(self, scanner: ScannerChoice, options: ReadOptions) -> None:
        self._stream = scanner.stream
        self._is_ros1 = scanner.stream.is_ros1
        self._is_multi_echo = scanner.stream.msgtype == ros.MULTI_ECHO
        self._echo = options.echo
        roll, pitch, yaw = scanner.tf_base_sensor.rpy
        self._is_flipped = scanner.tf_base_sensor.rotation[2, 2] < 0.0
        if self._is_flipped:
            roll = math.remainder(roll - math.pi, 2.0 * math.pi)
        self._x, self._y, self._height = (float(v) for v in scanner.tf_base_sensor.translation)
        self._roll, self._pitch, self._yaw = roll, pitch, yaw
        self._profile: SensorProfile | None = None
        self._geometries: dict[tuple[bytes, int], ScanGeometry] = {}

    def use_profile(self, profile: SensorProfile) -> None:
        """Use the range limits that were estimated from the recording."""
        self._profile = profile
        self._geometries.clear()

    def decode(self, raw: bytes, stamp: float, time: float) -> LaserScan:
        """Return the event of a message.

        Raises
        ------
        DecodeError
            The message is cut off, or its values are not valid.
        """
        if self._is_multi_echo:
            message = ros.decode_multi_echo(raw, self._is_ros1, self._echo)
        else:
            message = ros.decode_scan(raw, self._is_ros1)
        return self.event(message, stamp, time)

    def event(self, message: ros.RawScan, stamp: float, time: float) -> LaserScan:
        """Return the event of a decoded message; raises as `decode`."""
        key = (message.beams, len(message.ranges))
        geometry = self._geometries.get(key)
        if geometry is None:
            if len(self._geometries) >= _MAX_GEOMETRIES:
                self._geometries.clear()
            geometry = self._geometries[key] = self._geometry(message)
        return LaserScan(stamp, time, message.ranges, geometry)

    def _geometry(self, message: ros.RawScan) -> ScanGeometry:
        first, last, step, time_increment, _, range_min, range_max = message.beam_numbers
        count = len(message.ranges)
        if count == 0:
            raise DecodeError("scan without ranges")
        if not (math.isfinite(step) and step != 0.0) and count > 1:
            step = (last - first) / (count - 1)
        if not (math.isfinite(first) and math.isfinite(step) and (step != 0.0 or count == 1)):
            raise DecodeError("scan without angles")
        if abs(step) * (count - 1) > MAX_ANGLE:
            raise DecodeError("beams go round more than twice")
        if abs(first) > MAX_ANGLE:
            raise DecodeError("angle of the first beam is not in radians")
        sign = -1.0 if self._is_flipped else 1.0
        sound = math.isfinite(range_max) and range_max > max(range_min, 0.0)
        geometry = ScanGeometry(
            angle_min=sign * first,
            angle_increment=sign * step,
            num_beams=count,
            range_min=range_min if math.isfinite(range_min) and sound else 0.0,
            range_max=range_max if sound else math.inf,
            no_return_is_free=False,
            tf_tracking_sensor=Pose(self._x, self._y, self._yaw),
            time_increment=self.time_increment(time_increment, count),
            sensor=self._stream.topic,
            height=self._height,
            roll=self._roll,
            pitch=self._pitch,
        )
        profile = self._profile
        if profile is None:
            return geometry
        # REP 117: a range beyond range_max is discarded, unless it is this scanner's sign
        # for no return.
        value = profile.no_return
        is_sign = value is not None and math.isfinite(value) and value > 0.0
        return replace(profile.apply(geometry), no_return_is_free=is_sign)

    def time_increment(self, sent: float, count: int) -> float:
        """Return the time between beams [s], 0 if the value sent is not possible."""
        if not (math.isfinite(sent) and sent > 0.0):
            return 0.0
        rate = self._profile.rate if self._profile is not None else 0.0
        longest = 1.5 / rate if rate > 0.0 else 2.0
        return sent if sent * count <= longest else 0.0


class CloudDecoder:
    """Point clouds of one scanner."""

    def __init__(self, scanner: ScannerChoice) -> None:
        pose = scanner.tf_base_sensor
        roll, pitch, _ = pose.rpy
        self._is_ros1 = scanner.stream.is_ros1
        self._geometry = CloudGeometry(
            sensor=scanner.stream.topic,
            tf_tracking_sensor=pose.plane,
            height=float(pose.translation[2]),
            roll=roll,
            pitch=pitch,
            range_min=_NEAREST_OF_CLOUDS,
        )

    def decode(self, raw: bytes, stamp: float, time: float) -> PointCloud:
        """Return the event of a message.

        Raises
        ------
        DecodeError
            The message is cut off, or its values are not valid.
        """
        message = decode_cloud(raw, self._is_ros1)
        if len(message.points) == 0:
            raise DecodeError("cloud without points")
        return PointCloud(stamp, time, message.points, message.times, self._geometry)


class OdometryDecoder:
    """Poses of the base out of odometry messages or transforms."""

    def __init__(self, choice: OdometryChoice) -> None:
        self._is_ros1 = choice.stream.is_ros1
        self._tf_child_base = choice.tf_child_base

    def decode(self, raw: bytes, stamp: float, time: float) -> Odometry:
        """Return the event of a nav_msgs/Odometry.

        Raises
        ------
        DecodeError
            The message is cut off, or its pose is not valid.
        """
        return self.event(ros.decode_odometry(raw, self._is_ros1).values, stamp, time)

    def decode_pose(self, raw: bytes, stamp: float, time: float) -> Odometry:
        """Return the event of seven float64, as `event` takes them; raises as `decode`."""
        return self.event(tuple(np.frombuffer(raw, dtype=np.float64).tolist()), stamp, time)

    def event(self, values: tuple[float, ...], stamp: float, time: float) -> Odometry:
        """Return the event of a pose: x y z [m], quaternion x y z w; raises as `decode`."""
        try:
            pose = Pose3.from_quaternion(values[:3], values[3:])
        except ValueError:
            raise DecodeError("odometry pose is not valid") from None
        return Odometry(stamp, time, (pose @ self._tf_child_base).plane)


class ImuDecoder:
    """Inertial readings, turned into the base frame."""

    def __init__(self, choice: ImuChoice) -> None:
        self._is_ros1 = choice.stream.is_ros1
        rotation: FloatArray = choice.tf_base_sensor.rotation
        self._turned = not np.allclose(rotation, np.eye(3), atol=1e-12)
        self._rows = [tuple(float(v) for v in row) for row in rotation]
        self._acceleration_scale = choice.acceleration_scale
        self._velocity_scale = choice.velocity_scale

    def decode(self, raw: bytes, stamp: float, time: float) -> Imu:
        """Return the event of a message.

        Raises
        ------
        DecodeError
            The message is cut off, lacks a quantity, or is not finite.
        """
        message = ros.decode_imu(raw, self._is_ros1)
        if message.linear_acceleration is None or message.angular_velocity is None:
            raise DecodeError("IMU reading without acceleration or angular velocity")
        acceleration = self._in_base(message.linear_acceleration)
        velocity = self._in_base(message.angular_velocity)
        if not all(abs(value) < ABSURD_READING for value in (*acceleration, *velocity)):
            raise DecodeError("IMU reading is not finite")
        return Imu(
            stamp,
            time,
            _scaled(acceleration, self._acceleration_scale),
            _scaled(velocity, self._velocity_scale),
        )

    def _in_base(self, vector: tuple[float, float, float]) -> tuple[float, float, float]:
        if not self._turned:
            return vector
        x, y, z = vector
        a, b, c = self._rows
        return (
            a[0] * x + a[1] * y + a[2] * z,
            b[0] * x + b[1] * y + b[2] * z,
            c[0] * x + c[1] * y + c[2] * z,
        )


def _scaled(vector: tuple[float, float, float], by: float) -> tuple[float, float, float]:
    if by == 1.0:
        return vector
    x, y, z = vector
    return (by * x, by * y, by * z)
