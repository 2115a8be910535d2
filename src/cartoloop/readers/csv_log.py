# SPDX-License-Identifier: Apache-2.0
"""Scans as comma-separated values: a line with the column names, then one line for each scan.

::

    # angle_min=-1.5708 angle_increment=0.01745
    time,x,y,theta,r0,r1,r2
    0.0,0,0,0,2.31,2.30,inf

docs/readers.md lists the columns. The output of ``rostopic echo -p`` for a LaserScan is read too.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from cartoloop.arrays import FloatArray
from cartoloop.kernels.decimal_text import POWERS_OF_TEN, parse_decimals
from cartoloop.readers.line_format import (
    Head,
    LineError,
    LineFormat,
    Parse,
    Reading,
    angles_checked,
)
from cartoloop.sensor.events import ScanGeometry
from cartoloop.sensor.pose import Pose

_RANGE = re.compile(r"(?:r|ranges?)[_.\[]?\d+\]?")
_ALL_THAT_FOLLOW = "ranges"
_SETTING = re.compile(r"([a-z_]+)\s*[=:]\s*([-+.\deE]+|[-+]?inf)")
# In order of preference, with the unit [s]. ROS prints nanoseconds.
_TIMES = {
    "header.stamp": 1e-9, "time": 1.0, "timestamp": 1.0, "stamp": 1.0, "t": 1.0, "time_s": 1.0,
    "time_ms": 1e-3, "time_us": 1e-6, "time_ns": 1e-9, "%time": 1e-9,
}  # fmt: skip
_POSES = (("x", "y", "theta"), ("x", "y", "yaw"), ("odom_x", "odom_y", "odom_theta"))
_ANGLES = ("angle_min", "angle_increment")


class Columns(NamedTuple):
    """The columns of the file.

    Attributes
    ----------
    num_columns : number of names.
    time, time_unit : index of the time, -1 if there is none; its unit [s].
    pose : indices of x, y, theta; empty if there are none.
    settings : of the values that are columns: they may change from line to line.
    first_range, num_ranges : index and number of the ranges; 0: all columns from the first on.
    """

    num_columns: int
    time: int
    time_unit: float
    pose: tuple[int, ...]
    settings: dict[str, int]
    first_range: int
    num_ranges: int


def _names(line: bytes) -> list[str]:
    text = line.decode("utf-8", "replace").lstrip("\ufeff").strip().lower()
    return [name.strip().strip("\"'").removeprefix("field.") for name in text.split(",")]


def _is_comment(line: bytes) -> bool:
    return not line.strip() or line.lstrip().startswith(b"#")


def _header(head: Head) -> list[str]:
    return next((_names(line) for line in head if not _is_comment(line)), [])


def _is_range(name: str) -> bool:
    return name == _ALL_THAT_FOLLOW or _RANGE.fullmatch(name) is not None


def _recognise(head: Head) -> bool:
    names = _header(head)
    return len(names) > 1 and any(_is_range(name) for name in names)


def _columns(head: Head) -> Columns:
    names = _header(head)
    ranges = [place for place, name in enumerate(names) if _is_range(name)]
    if ranges[-1] - ranges[0] != len(ranges) - 1:
        raise LineError(
            "ranges not side by side", "the columns of the ranges do not stand side by side"
        )
    time = next((name for name in _TIMES if name in names), "")
    pose = next((p for p in _POSES if set(p) <= set(names)), ())
    return Columns(
        num_columns=len(names),
        time=names.index(time) if time else -1,
        time_unit=_TIMES.get(time, 1.0),
        pose=tuple(names.index(name) for name in pose),
        settings={name: names.index(name) for name in _ANGLES if name in names},
        first_range=ranges[0],
        num_ranges=0 if names[ranges[-1]] == _ALL_THAT_FOLLOW else len(ranges),
    )


def _settings(head: Head) -> dict[str, float]:
    """Return the values in the comments before the header."""
    found: dict[str, float] = {}
    for line in head:
        if not _is_comment(line):
            break
        for name, value in _SETTING.findall(line.decode("utf-8", "replace").lower()):
            try:
                found[name] = float(value)
            except ValueError:
                continue  # a word of the comment
    return found


def _geometry(head: Head) -> ScanGeometry:
    columns, given = _columns(head), _settings(head)
    num_beams = max(columns.num_ranges, 1)
    if not columns.settings.keys() >= set(_ANGLES):
        if "angle_max" in given and "angle_min" in given and num_beams > 1:
            step = (given["angle_max"] - given["angle_min"]) / (num_beams - 1)
            given.setdefault("angle_increment", step)
        for name in _ANGLES:
            if name not in given and name not in columns.settings:
                raise LineError(
                    "no angles",
                    f"{name} is missing: the beam angles are not known; begin the file with a line "
                    "like '# angle_min=-1.5708 angle_increment=0.0087' (rad)",
                )
    first, step = given.get("angle_min", 0.0), given.get("angle_increment", 0.0)
    if "angle_increment" not in columns.settings and not (math.isfinite(step) and step != 0.0):
        raise LineError("no angles", "angle_increment is 0 or not a number; correct the file")
    with angles_checked():
        return ScanGeometry(
            angle_min=first,
            angle_increment=step,
            num_beams=num_beams,
            range_min=given.get("range_min", 0.0),
            range_max=given.get("range_max", math.inf),
            tf_tracking_sensor=Pose(
                given.get("laser_x", 0.0), given.get("laser_y", 0.0), given.get("laser_yaw", 0.0)
            ),
            time_increment=given.get("time_increment", 0.0),
            sensor="csv",
        )


def _parser(head: Head) -> Parse:
    columns, fixed = _columns(head), _geometry(head)
    header = next(line for line in head if not _is_comment(line))
    seen: dict[tuple[float, float], ScanGeometry] = {}

    def geometry(cells: Sequence[bytes]) -> ScanGeometry | None:
        if not columns.settings:
            return None
        given = {name: _number(cells, place) for name, place in columns.settings.items()}
        first = given.get("angle_min", fixed.angle_min)
        step = given.get("angle_increment", fixed.angle_increment)
        if not (math.isfinite(first) and math.isfinite(step) and step != 0.0):
            raise LineError("scan without angles", "an angle of the scan is 0 or not a number")
        if (first, step) not in seen:
            with angles_checked():
                seen[first, step] = replace(fixed, angle_min=first, angle_increment=step)
        return seen[first, step]

    def parse(line: bytes) -> Reading | None:
        if _is_comment(line) or line == header:
            return None
        *cells, rest = line.rstrip(b"\r\n").split(b",", columns.first_range)
        if len(cells) < columns.first_range:
            cells, rest = [*cells, rest], b""
            if len(cells) <= max(columns.pose, default=len(cells)):
                raise LineError("line cut off", "the line is cut off")
        ranges = _ranges(rest, columns)
        stamp = _number(cells, columns.time) * columns.time_unit if columns.time >= 0 else math.nan
        pose = None
        if columns.pose and any(_cell(cells, place) for place in columns.pose):
            pose = Pose(*(_number(cells, place) for place in columns.pose))
        if ranges is None:
            return Reading(stamp, pose) if pose is not None else None
        return Reading(stamp, pose, ranges, geometry(cells))

    return parse


def _cell(cells: Sequence[bytes], place: int) -> bytes:
    return cells[place].strip() if 0 <= place < len(cells) else b""


def _number(cells: Sequence[bytes], place: int) -> float:
    """Return the number in a cell, NaN if it is empty."""
    text = _cell(cells, place)
    try:
        return float(text) if text else math.nan
    except ValueError:
        shown = text.decode("ascii", "replace")[:20]
        raise LineError("not a number", f"{shown!r} is not a number") from None


def _ranges(text: bytes, columns: Columns) -> FloatArray | None:
    """Return the ranges in the rest of a line; None if there are none."""
    if not text.strip(b" ,\t"):
        return None
    count = columns.num_ranges
    plain = text.count(b",") + 1
    wanted = columns.num_columns - columns.first_range
    if count and plain != wanted:
        raise LineError(
            "range count mismatch or line cut off",
            f"{wanted} values are expected from the first range on, but there are {plain}",
        )
    values = np.empty(count or plain)
    # Only where no cell is empty: an empty one is not visible without the commas.
    if (
        b",," not in text
        and not text.endswith(b",")
        and parse_decimals(text.replace(b",", b" "), POWERS_OF_TEN, values) >= 0
    ):
        return values
    cells = text.split(b",")
    for beam in range(len(values)):
        values[beam] = _number(cells, beam)
    return values


CSV = LineFormat("CSV file", _recognise, _geometry, _parser)
