# SPDX-License-Identifier: Apache-2.0
"""Small ROS recordings for tests, written by rosbags."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

START = 1_700_000_000
NANO = 1_000_000_000
STORES = {True: get_typestore(Stores.ROS1_NOETIC), False: get_typestore(Stores.ROS2_HUMBLE)}
STORES[True].register(
    get_types_from_msg("geometry_msgs/TransformStamped[] transforms", "tf2_msgs/msg/TFMessage")
)

LASER = "sensor_msgs/msg/LaserScan"
MULTI = "sensor_msgs/msg/MultiEchoLaserScan"
CLOUD = "sensor_msgs/msg/PointCloud2"
IMU = "sensor_msgs/msg/Imu"
ODOMETRY = "nav_msgs/msg/Odometry"
TF = "tf2_msgs/msg/TFMessage"
STRING = "std_msgs/msg/String"

FORMATS = ("bag", "db3", "mcap")


class Messages:
    """Makes messages of ROS 1 or ROS 2."""

    def __init__(self, ros1: bool) -> None:
        self.ros1 = ros1
        self.store = STORES[ros1]

    def make(self, msgtype, /, **values):
        return self.store.types[msgtype](**values)

    def stamp(self, seconds):
        nanos = round(seconds * 1e6) * 1000
        return self.make("builtin_interfaces/msg/Time", sec=nanos // NANO, nanosec=nanos % NANO)

    def header(self, seconds, frame):
        extra = {"seq": 7} if self.ros1 else {}
        return self.make("std_msgs/msg/Header", stamp=self.stamp(seconds), frame_id=frame, **extra)

    def vector(self, xyz):
        return self.make("geometry_msgs/msg/Vector3", **dict(zip("xyz", xyz, strict=True)))

    def quaternion(self, rpy):
        roll, pitch, yaw = (0.5 * a for a in rpy)
        cr, sr, cp, sp = math.cos(roll), math.sin(roll), math.cos(pitch), math.sin(pitch)
        cy, sy = math.cos(yaw), math.sin(yaw)
        return self.make(
            "geometry_msgs/msg/Quaternion",
            x=sr * cp * cy - cr * sp * sy,
            y=cr * sp * cy + sr * cp * sy,
            z=cr * cp * sy - sr * sp * cy,
            w=cr * cp * cy + sr * sp * sy,
        )

    def scan(self, seconds, ranges, frame="laser", **values):
        ranges = np.asarray(ranges, dtype=np.float32)
        numbers = {
            "angle_min": -1.5,
            "angle_max": 1.5,
            "angle_increment": 3.0 / max(len(ranges) - 1, 1),
            "time_increment": 0.0,
            "scan_time": 0.1,
            "range_min": 0.1,
            "range_max": 30.0,
            "intensities": np.zeros(len(ranges), np.float32),
        }
        return self.make(
            LASER, header=self.header(seconds, frame), ranges=ranges, **{**numbers, **values}
        )

    def multi_echo(self, seconds, echoes, intensities, frame="laser"):
        def listed(rows):
            return [
                self.make("sensor_msgs/msg/LaserEcho", echoes=np.array(row, np.float32))
                for row in rows
            ]

        return self.make(
            MULTI,
            header=self.header(seconds, frame),
            angle_min=-1.0,
            angle_max=1.0,
            angle_increment=2.0 / (len(echoes) - 1),
            time_increment=0.0,
            scan_time=0.1,
            range_min=0.1,
            range_max=30.0,
            ranges=listed(echoes),
            intensities=listed(intensities),
        )

    def imu(self, seconds, acceleration, velocity, frame="imu", covariances=(0.0, 0.0)):
        def nine(first):
            return np.array([first] + [0.0] * 8)

        return self.make(
            IMU,
            header=self.header(seconds, frame),
            orientation=self.quaternion((0.0, 0.0, 0.0)),
            orientation_covariance=nine(-1.0),
            angular_velocity=self.vector(velocity),
            angular_velocity_covariance=nine(covariances[0]),
            linear_acceleration=self.vector(acceleration),
            linear_acceleration_covariance=nine(covariances[1]),
        )

    def odometry(self, seconds, pose, child="base_link", frame="odom"):
        x, y, yaw = pose
        point = self.make("geometry_msgs/msg/Point", x=x, y=y, z=0.0)
        where = self.make(
            "geometry_msgs/msg/Pose", position=point, orientation=self.quaternion((0, 0, yaw))
        )
        twist = self.make(
            "geometry_msgs/msg/Twist", linear=self.vector((0, 0, 0)), angular=self.vector((0, 0, 0))
        )
        zeros = np.zeros(36)
        return self.make(
            ODOMETRY,
            header=self.header(seconds, frame),
            child_frame_id=child,
            pose=self.make("geometry_msgs/msg/PoseWithCovariance", pose=where, covariance=zeros),
            twist=self.make("geometry_msgs/msg/TwistWithCovariance", twist=twist, covariance=zeros),
        )

    def transforms(self, seconds, *poses):
        """Make a message of (parent, child, xyz, rpy)."""
        sent = [
            self.make(
                "geometry_msgs/msg/TransformStamped",
                header=self.header(seconds, parent),
                child_frame_id=child,
                transform=self.make(
                    "geometry_msgs/msg/Transform",
                    translation=self.vector(xyz),
                    rotation=self.quaternion(rpy),
                ),
            )
            for parent, child, xyz, rpy in poses
        ]
        return self.make(TF, transforms=sent)

    def cloud(self, seconds, data, dtype, frame="lidar", height=1, row_pad=0, big_endian=False):
        """Make a cloud out of a structured array."""
        codes = {"i1": 1, "u1": 2, "i2": 3, "u2": 4, "i4": 5, "u4": 6, "f4": 7, "f8": 8}
        fields = [
            self.make(
                "sensor_msgs/msg/PointField",
                name=name,
                offset=dtype.fields[name][1],
                datatype=codes[dtype.fields[name][0].base.str[1:]],
                count=1,
            )
            for name in dtype.names
        ]
        width = len(data) // height
        rows = np.asarray(data, dtype).reshape(height, width)
        raw = b"".join(row.tobytes() + bytes(row_pad) for row in rows)
        return self.make(
            CLOUD,
            header=self.header(seconds, frame),
            height=height,
            width=width,
            fields=fields,
            is_bigendian=big_endian,
            point_step=dtype.itemsize,
            row_step=width * dtype.itemsize + row_pad,
            data=np.frombuffer(raw, np.uint8),
            is_dense=False,
        )

    def encode(self, message, big_endian=False):
        if self.ros1:
            return bytes(self.store.serialize_ros1(message, message.__msgtype__))
        return bytes(
            self.store.serialize_cdr(message, message.__msgtype__, little_endian=not big_endian)
        )


@dataclass
class BagMaker:
    """Collects messages and writes them as a recording.

    Attributes
    ----------
    make : makes messages for this format.
    """

    form: str = "bag"
    messages: list = field(default_factory=list)

    def __post_init__(self) -> None:
        self.make = Messages(self.form == "bag")

    def add(self, topic, message, seconds):
        """Add a message, recorded `seconds` after the start."""
        nanos = START * NANO + round(seconds * NANO)
        self.messages.append((topic, message.__msgtype__, nanos, self.make.encode(message)))

    def add_raw(self, topic, msgtype, raw, seconds):
        self.messages.append((topic, msgtype, START * NANO + round(seconds * NANO), raw))

    def write(self, folder: Path, *, compression=None):
        """Write the recording and return its path."""
        if self.form == "bag":
            return self._write1(folder / "drive.bag", compression)
        path = folder / "drive"
        plugin = StoragePlugin.MCAP if self.form == "mcap" else StoragePlugin.SQLITE3
        writer = Writer2(path, version=9, storage_plugin=plugin)
        if compression is not None:
            writer.set_compression(CompressionMode[compression], CompressionFormat.ZSTD)
        with writer:
            self._write_all(writer)
        return path

    def _write1(self, path, compression):
        writer = Writer1(path)
        if compression is not None:
            writer.set_compression(Writer1.CompressionFormat[compression])
        with writer:
            self._write_all(writer)
        return path

    def _write_all(self, writer):
        connections = {}
        for topic, msgtype, nanos, raw in self.messages:
            if (topic, msgtype) not in connections:
                connections[topic, msgtype] = writer.add_connection(
                    topic, msgtype, typestore=self.make.store
                )
            writer.write(connections[topic, msgtype], nanos, raw)


def ranges_of(number, beams=61):
    """Return a smooth wall that differs from scan to scan."""
    return 4.0 + 0.5 * np.sin(np.linspace(0.0, 3.0, beams) + 0.05 * number) + 0.01 * number


def drive(form="bag", num_scans=30, *, odometry=True, imu=True, transforms=True):
    """Return a maker with a scanner at 10 Hz, odometry at 20 Hz, an IMU at 50 Hz and their tf."""
    bag = BagMaker(form)
    make = bag.make
    events = []
    if transforms:
        sent = make.transforms(
            START,
            ("base_link", "laser", (0.2, 0.0, 0.3), (0.0, 0.0, 0.0)),
            ("base_link", "imu", (0.0, 0.0, 0.1), (0.0, 0.0, 0.0)),
        )
        events.append((0.0, "/tf_static", sent))
    for i in range(num_scans):
        t = 0.1 + 0.1 * i
        events.append((t, "/scan", make.scan(START + t, ranges_of(i), time_increment=1e-4)))
    for i in range(2 * num_scans if odometry else 0):
        t = 0.1 + 0.05 * i
        events.append((t, "/odom", make.odometry(START + t, (0.01 * i, 0.0, 0.0))))
    for i in range(5 * num_scans if imu else 0):
        t = 0.1 + 0.02 * i
        events.append((t, "/imu", make.imu(START + t, (0.1, 0.0, 9.8), (0.0, 0.0, 0.02))))
    for t, topic, message in sorted(events, key=lambda e: e[0]):
        bag.add(topic, message, t + 0.001)
    return bag
