# SPDX-License-Identifier: Apache-2.0
"""Faults of a line of a text recording, and of what a format reads in it."""

from __future__ import annotations

from math import isfinite

from cartoloop.readers.line_format import LineError, Parse, Reading
from cartoloop.readers.text_file import MAX_LINE_BYTES, OVERLONG
from cartoloop.sensor.events import MAX_ANGLE, ScanGeometry
from cartoloop.sensor.pose import Pose


def bounded(line: bytes) -> bytes:
    """Return a line as it is, unless it was too long to be kept."""
    if line is OVERLONG:
        detail = f"the line is longer than {MAX_LINE_BYTES >> 20} MB"
        raise LineError("line too long", detail)
    return line


def careful(parse: Parse) -> Parse:
    """Return a function that parses a line, and finds fault with it whatever happens."""

    def parse_carefully(line: bytes) -> Reading | None:
        try:
            return parse(line)
        except LineError:
            raise
        except Exception as error:  # one line must not cost the others
            what = " ".join(str(error).split())[:80]
            raise LineError(
                "line that the reader fails at",
                f"the reader fails at this line ({type(error).__name__}: {what})",
            ) from error

    return parse_carefully


def is_finite(pose: Pose | None) -> bool:
    """Return whether all numbers of a pose are finite, or there is none."""
    # The sum first: this is done for each line.
    return pose is None or isfinite(sum(pose)) or all(map(isfinite, pose))


def has_pose(reading: Reading) -> bool:
    """Return whether a line holds a usable odometry pose."""
    pose = reading.tf_odom_tracking
    return pose is not None and is_finite(pose)


def check(reading: Reading, default: ScanGeometry | None) -> None:
    """Raise `LineError` if a reading cannot be used; `default`: geometry of scans without one."""
    ranges = reading.ranges
    if ranges is None and not is_finite(reading.tf_odom_tracking):
        raise LineError("pose not finite", "a number of the pose is NaN or infinite")
    if ranges is not None and len(ranges) == 0:
        raise LineError("scan without ranges", "the scan has no ranges")
    geometry = reading.geometry or default
    if ranges is None or geometry is None:
        return
    step = geometry.angle_increment
    if abs(step) * (len(ranges) - 1) > MAX_ANGLE:
        detail = f"{len(ranges)} beams, {step:g} rad apart, sweep over more than two turns"
        raise LineError("more beams than a sweep has", detail)
