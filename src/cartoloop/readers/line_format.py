# SPDX-License-Identifier: Apache-2.0
"""What describes a text format: how its files are recognised, and what each line says.

docs/readers.md shows how to write one.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import NamedTuple

from cartoloop.arrays import FloatArray
from cartoloop.errors import UsageError
from cartoloop.sensor.events import ScanGeometry
from cartoloop.sensor.pose import Pose


class LineError(Exception):
    """A line that cannot be used.

    Parameters
    ----------
    reason : what the line is counted under.
    detail : what is wrong with it, for the user. Without it the line is only counted: it is sound,
        but holds nothing to map with.
    """

    def __init__(self, reason: str, detail: str = "") -> None:
        super().__init__(detail or reason)
        self.reason = reason
        self.detail = detail


@contextmanager
def angles_checked() -> Iterator[None]:
    """Make a scanner's geometry in the body: one that cannot be in radians is a `LineError`."""
    try:
        yield
    except UsageError as error:
        raise LineError("angles not in radians", str(error)) from None


class Reading(NamedTuple):
    """The contents of a line.

    Attributes
    ----------
    stamp : time of the measurement [s]; NaN if the line has none.
    tf_odom_tracking : pose of the robot by its odometry, or None; with a scan, it may hold NaN.
    ranges : float64, shape (num_beams,) [m], or None. NaN, inf, 0 and values beyond the
        scanner's range are allowed.
    geometry : of these ranges, where it differs from the recording's; its `sensor` names the
        scanner. None: the recording's.
    tf_tracking_sensor : mounting pose of the scanner as this line states it, or None.
    setting : name and value of a parameter that holds for the whole recording, or None.
    """

    stamp: float = math.nan
    tf_odom_tracking: Pose | None = None
    ranges: FloatArray | None = None
    geometry: ScanGeometry | None = None
    tf_tracking_sensor: Pose | None = None
    setting: tuple[str, float] | None = None


Parse = Callable[[bytes], Reading | None]
Head = Sequence[bytes]
Settings = Mapping[str, float]


@dataclass(frozen=True, slots=True)
class LineFormat:
    """How to read a text format. The first four are required; `head` is the file's first lines.

    Attributes
    ----------
    name : of the format, for the user.
    recognise : (head) -> whether a file is of this format.
    geometry : (head) -> beam angles and mounting pose of the scanner; a scan with another number
        of beams has the same first angle and step. Raises `LineError` if these cannot be
        determined. None: each `Reading` with ranges has its own geometry.
    parser : (head) -> the function that parses a line: a `Reading`, or None where the line is
        empty or a comment; it raises `LineError` if the line cannot be used. It is called once
        for each pass, so the function may remember earlier lines.
    select_scanners : (number of scans by scanner) -> names of the scanners to use, the main one
        first; all by default.
    mounting : (scanner, settings) -> mounting pose of a scanner whose lines do not state it.
        None: the one in the geometry.
    remark : (scanner, number of beams) -> an assumption that the user should know, or "".
    repeats_odometry : whether a scan line repeats the odometry line before it; the repeated pose
        is left out.
    is_scan : (line) -> whether a line is that of a scan, also if it cannot be used: such a line is
        a lost scan. By default all are.
    stamp_ends_line : whether the stamp is the last part of a line. A last line without it, in a
        file whose other lines have one, is then cut off.
    """

    name: str
    recognise: Callable[[Head], bool]
    geometry: Callable[[Head], ScanGeometry] | None
    parser: Callable[[Head], Parse]
    select_scanners: Callable[[Mapping[str, int]], Sequence[str]] = list
    mounting: Callable[[str, Settings], Pose] | None = None
    remark: Callable[[str, int], str] | None = None
    repeats_odometry: bool = False
    stamp_ends_line: bool = False
    is_scan: Callable[[bytes], bool] = lambda _: True
