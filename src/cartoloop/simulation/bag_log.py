# SPDX-License-Identifier: Apache-2.0
"""Simulated recordings as ROS 1 bags: scans, clouds, IMU, odometry and the mounting of scanners."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from cartoloop.errors import OutputError
from cartoloop.sensor.events import Imu, LaserScan, Odometry, PointCloud, SensorEvent
from cartoloop.simulation.rig import MountedLidar

Untyped = Any
"""Type of messages: rosbags makes their classes at run time."""

BASE_FRAME = "base_link"
_TF_DEFINITION = "geometry_msgs/TransformStamped[] transforms\n"
_TYPES = {
    LaserScan: "sensor_msgs/msg/LaserScan",
    PointCloud: "sensor_msgs/msg/PointCloud2",
    Imu: "sensor_msgs/msg/Imu",
    Odometry: "nav_msgs/msg/Odometry",
}
_TF = "tf2_msgs/msg/TFMessage"


def write_bag(
    path: Path,
    scanners: Sequence[MountedLidar],
    start_stamp: float,
    events: Iterable[SensorEvent],
) -> None:
    """Write a ROS 1 bag.

    Scanners publish on a topic of their name, in a frame of their name whose pose is on
    /tf_static; the IMU is in the body's frame, ``base_link``. Messages are recorded when the last
    beam has been measured, as those of real drivers are; the recorder's clock is right, whatever a
    scanner's clock is.

    Parameters
    ----------
    path : of the bag.
    scanners : on the robot.
    start_stamp : time stamp of the transforms [s].
    events : of all sensors.

    Raises
    ------
    OutputError
        When the file cannot be written.
    """
    from rosbags.rosbag1 import Writer, WriterError
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store: Untyped = get_typestore(Stores.ROS1_NOETIC)
    store.register(get_types_from_msg(_TF_DEFINITION, _TF))
    clocks = {scanner.name: scanner.clock_offset for scanner in scanners}
    partial = path.with_name(f".{path.name}.partial")
    try:
        partial.unlink(missing_ok=True)
        with Writer(partial) as bag:
            write = _MessageWriter(bag, store)
            write.transforms(scanners, start_stamp)
            timed = [(_recorded_at(event, clocks), event) for event in events]
            for time, event in sorted(timed, key=lambda pair: pair[0]):
                write.event(event, time)
        partial.replace(path)
    except (OSError, WriterError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise OutputError(f"{path}: cannot be written ({reason}); choose another place") from None
    finally:
        partial.unlink(missing_ok=True)


def _recorded_at(event: SensorEvent, clocks: Mapping[str, float]) -> float:
    """Return the true time [s] when a driver has received all beams of an event."""
    if isinstance(event, LaserScan | PointCloud):
        return event.time + event.sweep[1] - clocks[event.geometry.sensor]
    return event.time


def _frame(sensor: str) -> str:
    """Return the frame of a scanner, which is also its topic: its name, if it has one."""
    return sensor or "scan"


class _MessageWriter:
    """Turns events into messages of a bag."""

    def __init__(self, bag: Untyped, store: Untyped) -> None:
        self._bag, self._store = bag, store
        self._connections: dict[str, Untyped] = {}
        self._count = 0

    def event(self, event: SensorEvent, time: float) -> None:
        """Write one event as recorded at a time [s]."""
        match event:
            case LaserScan():
                topic, message = f"/{_frame(event.geometry.sensor)}", self._scan(event)
            case PointCloud():
                topic, message = f"/{_frame(event.geometry.sensor)}", self._cloud(event)
            case Imu():
                topic, message = "/imu", self._imu(event)
            case Odometry():
                topic, message = "/odom", self._odometry(event)
        self._send(topic, _TYPES[type(event)], time, message)

    def transforms(self, scanners: Sequence[MountedLidar], stamp: float) -> None:
        """Write the mounting of the scanners."""
        transforms = [self._mounting(scanner, stamp) for scanner in scanners]
        self._send("/tf_static", _TF, stamp, self._make(_TF, transforms=transforms))

    def _send(self, topic: str, kind: str, time: float, message: Untyped) -> None:
        if topic not in self._connections:
            self._connections[topic] = self._bag.add_connection(topic, kind, typestore=self._store)
        data = self._store.serialize_ros1(message, kind)
        self._bag.write(self._connections[topic], round(time * 1e9), data)

    def _make(self, kind: str, **fields: Untyped) -> Untyped:
        return self._store.types[kind](**fields)

    def _header(self, stamp: float, frame: str) -> Untyped:
        seconds, nanoseconds = divmod(round(stamp * 1e9), 10**9)
        time = self._make("builtin_interfaces/msg/Time", sec=seconds, nanosec=nanoseconds)
        self._count += 1
        return self._make("std_msgs/msg/Header", seq=self._count, stamp=time, frame_id=frame)

    def _vector(self, x: float, y: float, z: float, kind: str = "Vector3") -> Untyped:
        return self._make(f"geometry_msgs/msg/{kind}", x=x, y=y, z=z)

    def _quaternion(self, roll: float, pitch: float, yaw: float) -> Untyped:
        x, y, z, w = quaternion(roll, pitch, yaw)
        return self._make("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w)

    def _mounting(self, scanner: MountedLidar, stamp: float) -> Untyped:
        x, y, yaw = scanner.lidar.tf_tracking_sensor
        return self._make(
            "geometry_msgs/msg/TransformStamped",
            header=self._header(stamp, BASE_FRAME),
            child_frame_id=_frame(scanner.name),
            transform=self._make(
                "geometry_msgs/msg/Transform",
                translation=self._vector(x, y, scanner.height),
                rotation=self._quaternion(scanner.roll, scanner.pitch, yaw),
            ),
        )

    def _scan(self, scan: LaserScan) -> Untyped:
        geometry = scan.geometry
        sweep = geometry.angle_increment * (geometry.num_beams - 1)
        return self._make(
            _TYPES[LaserScan],
            header=self._header(scan.stamp, _frame(geometry.sensor)),
            angle_min=geometry.angle_min,
            angle_max=geometry.angle_min + sweep,
            angle_increment=geometry.angle_increment,
            time_increment=geometry.time_increment,
            scan_time=scan.sweep[1],
            range_min=geometry.range_min,
            range_max=geometry.range_max,
            # By REP 117, a beam without a return has an infinite range.
            ranges=np.where(scan.ranges >= geometry.range_max, np.inf, scan.ranges).astype("<f4"),
            intensities=np.empty(0, dtype=np.float32),
        )

    def _cloud(self, cloud: PointCloud) -> Untyped:
        names = ("x", "y", "z") if cloud.times is None else ("x", "y", "z", "time")
        rows = cloud.points
        if cloud.times is not None:
            rows = np.column_stack((rows, cloud.times))
        kind = "sensor_msgs/msg/PointField"
        float32 = self._store.types[kind].FLOAT32
        step = 4 * len(names)
        return self._make(
            _TYPES[PointCloud],
            header=self._header(cloud.stamp, _frame(cloud.geometry.sensor)),
            height=1,
            width=len(rows),
            fields=[
                self._make(kind, name=name, offset=4 * place, datatype=float32, count=1)
                for place, name in enumerate(names)
            ],
            is_bigendian=False,
            point_step=step,
            row_step=step * len(rows),
            data=np.frombuffer(rows.astype("<f4").tobytes(), dtype=np.uint8),
            is_dense=True,
        )

    def _imu(self, imu: Imu) -> Untyped:
        unknown = np.zeros(9)
        no_orientation = np.append(-1.0, np.zeros(8))
        return self._make(
            _TYPES[Imu],
            header=self._header(imu.stamp, BASE_FRAME),
            orientation=self._quaternion(0.0, 0.0, 0.0),
            orientation_covariance=no_orientation,
            angular_velocity=self._vector(*imu.angular_velocity),
            angular_velocity_covariance=unknown,
            linear_acceleration=self._vector(*imu.linear_acceleration),
            linear_acceleration_covariance=unknown,
        )

    def _odometry(self, odometry: Odometry) -> Untyped:
        x, y, theta = odometry.tf_odom_tracking
        pose = self._make(
            "geometry_msgs/msg/Pose",
            position=self._vector(x, y, 0.0, "Point"),
            orientation=self._quaternion(0.0, 0.0, theta),
        )
        at_rest = self._make(
            "geometry_msgs/msg/Twist",
            linear=self._vector(0.0, 0.0, 0.0),
            angular=self._vector(0.0, 0.0, 0.0),
        )
        unknown = np.zeros(36)
        return self._make(
            _TYPES[Odometry],
            header=self._header(odometry.stamp, "odom"),
            child_frame_id=BASE_FRAME,
            pose=self._make("geometry_msgs/msg/PoseWithCovariance", pose=pose, covariance=unknown),
            twist=self._make(
                "geometry_msgs/msg/TwistWithCovariance", twist=at_rest, covariance=unknown
            ),
        )


def quaternion(roll: float, pitch: float, yaw: float) -> tuple[float, float, float, float]:
    """Return Rz(yaw) Ry(pitch) Rx(roll) as x, y, z, w; angles in radians."""
    cr, sr = math.cos(roll / 2.0), math.sin(roll / 2.0)
    cp, sp = math.cos(pitch / 2.0), math.sin(pitch / 2.0)
    cy, sy = math.cos(yaw / 2.0), math.sin(yaw / 2.0)
    return (
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
        cr * cp * cy + sr * sp * sy,
    )
