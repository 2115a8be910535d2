# SPDX-License-Identifier: Apache-2.0
"""Messages of a live source, and the parser of those in newline-delimited JSON.

docs/live.md describes the messages that a robot has to send.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple, NoReturn

import numpy as np

from cartoloop.arrays import FloatArray
from cartoloop.errors import UsageError
from cartoloop.plain_text import one_line
from cartoloop.sensor.events import (
    CloudGeometry,
    Imu,
    LaserScan,
    Odometry,
    PointCloud,
    ScanGeometry,
    SensorEvent,
)
from cartoloop.sensor.pose import IDENTITY, Pose, wrap_angle

MAX_BEAMS = 100_000
"""Ranges of a scan: thirty times those of the finest scanners; longer lists are nonsense."""

MAX_POINTS = 2_000_000
"""Points of a cloud: ten times those of the finest scanners; longer lists are nonsense."""


class MessageError(Exception):
    """A message that cannot be used: the reason it is counted under, and a detail for the user."""

    def __init__(self, reason: str, detail: str = "") -> None:
        super().__init__(detail or reason)
        self.reason = reason


@dataclass(frozen=True, slots=True)
class EndMessage:
    """The source has no more messages."""


LiveMessage = SensorEvent | EndMessage
"""A message is an event whose `time` is not known yet (NaN); so is its `stamp` if none was sent."""


class Mount(NamedTuple):
    """Mounting pose of a sensor: in the plane, and height [m], roll and pitch [rad]."""

    tf_tracking_sensor: Pose = IDENTITY
    height: float = 0.0
    roll: float = 0.0
    pitch: float = 0.0


def parse_message(line: bytes | str) -> LiveMessage:
    """Return the message in a line of JSON.

    Raises
    ------
    MessageError
        It is not a message, or a value in it cannot be used.
    """
    try:
        content = json.loads(line)
    except (ValueError, RecursionError):
        raise MessageError("no JSON", f"is no JSON: {_shown(line)}") from None
    if not isinstance(content, dict):
        raise MessageError("no JSON object", f"is no JSON object: {_shown(line)}")
    kind = content.get("type")
    parse = _PARSERS.get(kind) if isinstance(kind, str) else None
    if parse is None:
        raise MessageError(
            "unknown type", f'has "type" {kind!r}; known are {", ".join(sorted(_PARSERS))}'
        )
    try:
        return parse(content)
    except UsageError as error:
        raise MessageError("angles not in radians", str(error)) from None


def _scan(content: Mapping[str, Any]) -> LaserScan:
    ranges = _numbers(content, "ranges", MAX_BEAMS)
    mount = _mount(content)
    increment = _number(content, "angle_increment")
    range_min = _number(content, "range_min", 0.0)
    range_max = _number(content, "range_max", math.inf, may_be_infinite=True)
    if increment == 0.0:
        _refuse("angle_increment", "is 0")
    if not 0.0 <= range_min < range_max:
        _refuse("range_max", "is not more than range_min, or range_min is negative")
    geometry = ScanGeometry(
        angle_min=_number(content, "angle_min"),
        angle_increment=increment,
        num_beams=len(ranges),
        range_min=range_min,
        range_max=range_max,
        # REP 117: where range_max is given, numbers beyond it are no measurements.
        no_return_is_free=math.isinf(range_max),
        tf_tracking_sensor=mount.tf_tracking_sensor,
        time_increment=_number(content, "time_increment", 0.0),
        sensor=_text(content, "sensor"),
        height=mount.height,
        roll=mount.roll,
        pitch=mount.pitch,
    )
    return LaserScan(_stamp(content), math.nan, ranges, geometry)


def _cloud(content: Mapping[str, Any]) -> PointCloud:
    points = _array(content, "points", MAX_POINTS)
    if points.ndim != 2 or points.shape[1] != 3:
        _refuse("points", "are not three numbers each")
    times = _numbers(content, "times", MAX_POINTS) if content.get("times") is not None else None
    if times is not None and len(times) != len(points):
        _refuse("times", "are not as many as the points")
    mount = _mount(content)
    return PointCloud(
        _stamp(content),
        math.nan,
        points,
        times,
        CloudGeometry(
            sensor=_text(content, "sensor"),
            tf_tracking_sensor=mount.tf_tracking_sensor,
            height=mount.height,
            roll=mount.roll,
            pitch=mount.pitch,
            range_min=_number(content, "range_min", 0.0),
            range_max=_number(content, "range_max", math.inf, may_be_infinite=True),
        ),
    )


def _odometry(content: Mapping[str, Any]) -> Odometry:
    x, y = _number(content, "x"), _number(content, "y")
    pose = Pose(x, y, wrap_angle(_number(content, "theta")))
    return Odometry(_stamp(content), math.nan, pose)


def _imu(content: Mapping[str, Any]) -> Imu:
    return Imu(
        _stamp(content),
        math.nan,
        _three(content, "linear_acceleration"),
        _three(content, "angular_velocity"),
    )


def _end(_: Mapping[str, Any]) -> EndMessage:
    return EndMessage()


_PARSERS: dict[str, Callable[[Mapping[str, Any]], LiveMessage]] = {
    "scan": _scan,
    "cloud": _cloud,
    "odometry": _odometry,
    "imu": _imu,
    "end": _end,
}


def _stamp(content: Mapping[str, Any]) -> float:
    """Return the stamp [s]; NaN where there is none: the time of arrival is used then."""
    return _number(content, "stamp", math.nan)


def _mount(content: Mapping[str, Any]) -> Mount:
    """Return the mounting pose: "pose" is [x, y, yaw] or [x, y, z, roll, pitch, yaw]."""
    if content.get("pose") is None:
        return Mount()
    values = _numbers(content, "pose", 6)
    if len(values) not in (3, 6) or not np.isfinite(values).all():
        _refuse("pose", "is not x, y, yaw, nor x, y, z, roll, pitch, yaw")
    if len(values) == 3:
        return Mount(Pose(*values.tolist()))
    x, y, z, roll, pitch, yaw = values.tolist()
    return Mount(Pose(x, y, yaw), z, roll, pitch)


def _number(
    content: Mapping[str, Any],
    key: str,
    default: float | None = None,
    *,
    may_be_infinite: bool = False,
) -> float:
    value = content.get(key)
    if value is None:
        if default is None:
            _refuse(key, "is missing")
        return default
    if isinstance(value, bool) or not isinstance(value, int | float):
        _refuse(key, f"is not a number: {str(value)[:20]}")
    try:
        number = float(value)
    except OverflowError:
        number = math.inf
    if math.isnan(number) or (math.isinf(number) and not may_be_infinite):
        _refuse(key, f"is {number}")
    return number


def _array(content: Mapping[str, Any], key: str, most: int) -> FloatArray:
    value = content.get(key)
    if not isinstance(value, list):
        _refuse(key, "is missing" if value is None else "is not a list")
    if len(value) > most:
        _refuse(key, f"has {len(value)} entries, more than {most}")
    try:
        return np.array(value, dtype=np.float64)  # null becomes NaN
    except (ValueError, TypeError, OverflowError):
        _refuse(key, "are not all numbers")


def _numbers(content: Mapping[str, Any], key: str, most: int) -> FloatArray:
    values = _array(content, key, most)
    if values.ndim != 1 or len(values) == 0:
        _refuse(key, "is empty" if values.size == 0 else "is a list of lists")
    return values


def _three(content: Mapping[str, Any], key: str) -> tuple[float, float, float]:
    values = _numbers(content, key, 3)
    if len(values) != 3 or not np.isfinite(values).all():
        _refuse(key, "are not three numbers")
    x, y, z = values.tolist()
    return x, y, z


def _text(content: Mapping[str, Any], key: str) -> str:
    value = content.get(key, "")
    if not isinstance(value, str) or len(value) > 100:
        _refuse(key, "is not a short text")
    return one_line(value)


def _refuse(key: str, what: str) -> NoReturn:
    raise MessageError(f'bad "{key}"', f'"{key}" {what}')


def _shown(line: bytes | str) -> str:
    """Return the beginning of a line in ASCII."""
    return ascii(bytes(line[:40]).decode("latin-1") if isinstance(line, bytes) else line[:40])
