# SPDX-License-Identifier: Apache-2.0
"""Bytes of ROS 2 messages into messages, once it is known where the sensors sit."""

from __future__ import annotations

import struct

import pytest

from cartoloop.live import ros_messages
from cartoloop.live.messages import MessageError
from cartoloop.live.notices import Notices
from cartoloop.live.ros_messages import RosParser
from cartoloop.readers.ros import raw_messages as ros
from cartoloop.sensor.events import Imu, LaserScan, Odometry


class Cdr:
    """Writes little-endian CDR."""

    def __init__(self):
        self.data = bytearray(b"\0\1\0\0")

    def put(self, code, *values):
        size = struct.calcsize(code[-1])
        self.data += b"\0" * ((4 - len(self.data)) % size)
        self.data += struct.pack(f"<{len(values)}{code}", *values)
        return self

    def text(self, text):
        self.put("I", len(text) + 1)
        self.data += text.encode() + b"\0"
        return self

    def header(self, stamp, frame):
        return self.put("i", int(stamp)).put("I", int(1e9 * (stamp % 1))).text(frame)


def scan(frame="laser", stamp=5.25):
    cdr = Cdr().header(stamp, frame).put("f", -1.0, 1.0, 1.0, 0.0, 0.1, 0.1, 30.0)
    return bytes(cdr.put("I", 3).put("f", 1.0, 2.0, 3.0).put("I", 0).data)


def transforms(parent, child, x):
    cdr = Cdr().put("I", 1).header(0.0, parent).text(child)
    return bytes(cdr.put("d", x, 0.0, 0.5, 0.0, 0.0, 0.0, 1.0).data)


def odometry(x):
    cdr = Cdr().header(5.0, "odom").text("base_link").put("d", x, 2.0, 0.0, 0.0, 0.0, 0.0, 1.0)
    return bytes(cdr.put("d", *[0.0] * 36).data)


def imu(frame="imu"):
    numbers = [0.0] * 37
    numbers[27] = 9.8  # after orientation and rotation, each with its covariance
    return bytes(Cdr().header(6.0, frame).put("d", *numbers).data)


def test_scans_are_left_out_until_the_mounting_is_known():
    notices = Notices(lambda line: None)
    parser = RosParser(notices)
    assert parser.parse("/scan", ros.LASER_SCAN, scan()) is None
    assert notices.skipped == {"message skipped: pose of its sensor not known yet": 1}

    parser.add_transforms(transforms("base_link", "laser", 0.25))
    message = parser.parse("/scan", ros.LASER_SCAN, scan())

    assert isinstance(message, LaserScan)
    assert message.stamp == 5.25
    assert message.ranges.tolist() == [1.0, 2.0, 3.0]
    assert message.geometry.tf_tracking_sensor == (0.25, 0.0, 0.0)
    assert message.geometry.height == 0.5
    assert message.geometry.sensor == "/scan"


def test_the_wait_for_a_transform_is_bounded(monkeypatch):
    monkeypatch.setattr(ros_messages, "TRANSFORM_WAIT_S", 0.0)
    reported = []
    message = RosParser(Notices(reported.append)).parse("/scan", ros.LASER_SCAN, scan())

    assert message.geometry.tf_tracking_sensor == (0.0, 0.0, 0.0)
    assert reported == [
        "/scan: /tf_static has no pose of laser on the robot; it is assumed to be at the robot's "
        "centre, or give --laser-pose X,Y,YAW"
    ]


def test_odometry_and_imu():
    parser = RosParser(Notices(lambda line: None))
    parser.add_transforms(transforms("base_link", "imu", 0.1))

    moved = parser.parse("/odom", ros.ODOMETRY, odometry(1.5))
    felt = parser.parse("/imu", ros.IMU, imu())

    assert isinstance(moved, Odometry)
    assert moved.tf_odom_tracking == (1.5, 2.0, 0.0)
    assert isinstance(felt, Imu)
    assert felt.stamp == 6.0


@pytest.mark.parametrize("raw", [b"", b"\0\1\0\0", scan()[:40], scan()[:-6], b"\0\3" + scan()[2:]])
def test_damaged_messages_are_refused(raw):
    parser = RosParser(Notices(lambda line: None))
    parser.add_transforms(transforms("base_link", "laser", 0.25))

    with pytest.raises(MessageError):
        parser.parse("/scan", ros.LASER_SCAN, raw)
    with pytest.raises(MessageError):
        parser.add_transforms(transforms("base_link", "laser", 0.25)[:-9])
