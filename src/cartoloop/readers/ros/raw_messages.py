# SPDX-License-Identifier: Apache-2.0
"""Scans, inertial readings, odometry and transforms out of the bytes of their messages.

Decoded here and not by rosbags, whose deserialisation of all fields of any type is slower. Measured
on one core (Python 3.11, rosbags 0.11): LaserScan of 361 beams 46,000 scans/s by rosbags and 75,000
here; MultiEchoLaserScan of 1,079 beams 70 and 15,000 scans/s: 15 ms a scan would be more than
mapping it takes. The first pass over a recording decodes headers alone, which rosbags cannot do.

Every function raises `DecodeError` if the bytes do not match the type.
"""

from __future__ import annotations

import struct
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cartoloop.arrays import FloatArray, IntArray
from cartoloop.kernels.nested_lists import find_lists
from cartoloop.readers.ros.wire import (
    Cursor,
    DecodeError,
    MessageHeader,
    aligned,
    frame_name,
    read_header,
)

Echo = Literal["first", "strongest"]

LASER_SCAN = "sensor_msgs/msg/LaserScan"
MULTI_ECHO = "sensor_msgs/msg/MultiEchoLaserScan"
POINT_CLOUD = "sensor_msgs/msg/PointCloud2"
IMU = "sensor_msgs/msg/Imu"
ODOMETRY = "nav_msgs/msg/Odometry"
STRING = "std_msgs/msg/String"
TF_TYPES = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")

_BEAMS = {order: struct.Struct(f"{order}7fI") for order in "<>"}
_IMU = {order: struct.Struct(f"{order}37d") for order in "<>"}
_FLOAT32 = {order: np.dtype(f"{order}f4") for order in "<>"}
_UINT32 = {order: np.dtype(f"{order}u4") for order in "<>"}
_HEAD_SIZE = 28  # of the seven numbers before the ranges


class RawScan(NamedTuple):
    """A scan as sent.

    Attributes
    ----------
    header : stamp [ns] and frame.
    beams : angle_min, angle_max, angle_increment [rad], time_increment, scan_time [s], range_min,
        range_max [m], as sent: 28 bytes, the same for scans alike.
    ranges : float64, shape (n,) [m].
    """

    header: MessageHeader
    beams: bytes
    ranges: FloatArray

    @property
    def beam_numbers(self) -> tuple[float, ...]:
        """The seven numbers of `beams`."""
        return struct.unpack(f"{self.header.order}7f", self.beams)


class RawImu(NamedTuple):
    """An inertial reading as sent, in the IMU's frame: m/s^2, rad/s; None where it has none."""

    header: MessageHeader
    linear_acceleration: tuple[float, float, float] | None
    angular_velocity: tuple[float, float, float] | None


class RawTransform(NamedTuple):
    """A transform as sent: translation x y z [m] and quaternion x y z w of child in parent."""

    stamp: int
    parent: str
    child: str
    values: tuple[float, ...]


class RawOdometry(NamedTuple):
    """A pose x y z [m], quaternion x y z w, of the frame `child` in the odometry's own."""

    header: MessageHeader
    child: str
    values: tuple[float, ...]


def decode_scan(raw: bytes, is_ros1: bool) -> RawScan:
    """Return a sensor_msgs/LaserScan."""
    header = read_header(raw, is_ros1)
    order = header.order
    start = aligned(header.end, 4, is_ros1)
    first = start + _HEAD_SIZE + 4
    try:
        count = _BEAMS[order].unpack_from(raw, start)[7]
        ranges = _float64(np.frombuffer(raw, _FLOAT32[order], count, first))
    except (struct.error, ValueError):
        raise DecodeError("cut off") from None
    return RawScan(header, raw[start : start + _HEAD_SIZE], ranges)


def _float64(values: NDArray[np.float32]) -> FloatArray:
    """Return the values as float64; of odd kinds of NaN, which make NumPy warn, as well."""
    with np.errstate(invalid="ignore"):
        return values.astype(np.float64)


def decode_multi_echo(raw: bytes, is_ros1: bool, echo: Echo = "first") -> RawScan:
    """Return one echo of each beam of a sensor_msgs/MultiEchoLaserScan; +inf where it has none."""
    header = read_header(raw, is_ros1)
    start = aligned(header.end, 4, is_ros1)
    body = start + _HEAD_SIZE
    num_words = (len(raw) - body) // 4
    if num_words < 1:
        raise DecodeError("cut off")
    words = np.frombuffer(raw, _UINT32[header.order], num_words, body).astype(np.uint32)
    floats = np.frombuffer(raw, _FLOAT32[header.order], num_words, body)
    first, num_echoes, end = _echo_places(words, 0)
    ranges = np.full(len(first), np.inf)
    has_echo = num_echoes > 0
    chosen = first[has_echo]
    if echo == "strongest" and end < num_words:
        strong_first, strong_count, _ = _echo_places(words, end)
        if np.array_equal(strong_count, num_echoes):
            chosen = chosen + _strongest(floats, strong_first[has_echo], num_echoes[has_echo])
    ranges[has_echo] = _float64(floats[chosen])
    return RawScan(header, raw[start:body], ranges)


def _echo_places(words: NDArray[np.uint32], start: int) -> tuple[IntArray, IntArray, int]:
    """Return where each beam's first echo stands, how many it has, and where the list ends."""
    num_beams = int(words[start])
    if num_beams > len(words) - start - 1:
        raise DecodeError("cut off")
    firsts = np.empty(num_beams, dtype=np.int64)
    counts = np.empty(num_beams, dtype=np.int64)
    end = find_lists(words, start + 1, firsts, counts)
    if end < 0:
        raise DecodeError("cut off")
    return firsts, counts, end


def _strongest(intensities: NDArray[np.float32], first: IntArray, count: IntArray) -> IntArray:
    """Return which echo of each beam is the strongest, the earlier one among equals."""
    best = np.zeros(len(first), dtype=np.int64)
    strength = intensities[first].copy()
    for k in range(1, int(count.max(initial=0))):
        has = count > k
        other = intensities[first[has] + k]
        stronger = other > strength[has]
        places = np.flatnonzero(has)[stronger]
        best[places] = k
        strength[places] = other[stronger]
    return best


def decode_imu(raw: bytes, is_ros1: bool) -> RawImu:
    """Return a sensor_msgs/Imu; -1 as first covariance means that a quantity is not measured."""
    header = read_header(raw, is_ros1)
    try:
        values = _IMU[header.order].unpack_from(raw, aligned(header.end, 8, is_ros1))
    except struct.error:
        raise DecodeError("cut off") from None
    return RawImu(
        header,
        None if values[28] == -1.0 else values[25:28],
        None if values[16] == -1.0 else values[13:16],
    )


def decode_odometry(raw: bytes, is_ros1: bool) -> RawOdometry:
    """Return the pose of a nav_msgs/Odometry."""
    header = read_header(raw, is_ros1)
    cursor = Cursor(raw, is_ros1, aligned(header.end, 4, is_ros1))
    child = frame_name(cursor.text())
    return RawOdometry(header, child, cursor.numbers("d", 8, 7))


def decode_transforms(raw: bytes, is_ros1: bool) -> list[RawTransform]:
    """Return what a tf2_msgs/TFMessage holds."""
    cursor = Cursor(raw, is_ros1)
    transforms = []
    for _ in range(cursor.u32()):
        header = cursor.header()
        child = frame_name(cursor.text())
        values = cursor.numbers("d", 8, 7)
        transforms.append(RawTransform(header.stamp, frame_name(header.frame), child, values))
    return transforms


def decode_string(raw: bytes, is_ros1: bool) -> bytes:
    """Return a std_msgs/String."""
    return Cursor(raw, is_ros1).text()
