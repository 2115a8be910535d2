# SPDX-License-Identifier: Apache-2.0
"""The grammar of CARMEN log lines: which token of a line means what.

::

    FLASER n r1..rn  x y theta  odom_x odom_y odom_theta                     [stamp host logger]
    ROBOTLASER1 type start fov step max accuracy remission  n r1..rn [m s1..sm]
                laser_x laser_y laser_theta  robot_x robot_y robot_theta
                tv rv forward_safety side_safety [turn_axis]                 [stamp host logger]
    RAWLASER1   type start fov step max accuracy remission  n r1..rn [m s1..sm] [stamp host logger]
    ODOM x y theta tv rv accel                                               [stamp host logger]
    PARAM name value

Which optional parts a line has follows from the number of tokens, counted from the end.
"""

from __future__ import annotations

import math
from math import isfinite
from typing import NamedTuple

import numpy as np

from cartoloop.arrays import FloatArray
from cartoloop.kernels.decimal_text import POWERS_OF_TEN, parse_decimals
from cartoloop.readers.line_format import LineError
from cartoloop.sensor.pose import Pose, relative

SCAN_TAGS = (
    b"FLASER",
    b"RLASER",
    b"ROBOTLASER1",
    b"ROBOTLASER2",
    b"RAWLASER1",
    b"RAWLASER2",
)
# Messages of CARMEN that are not used for mapping.
IGNORED_TAGS = frozenset(
    b"SYNC TRUEPOS NMEA NMEAGGA NMEARMC GPS IMU LASER3 LASER4 LASER5 RAWLASER3 RAWLASER4 "
    b"RAWLASER5 ROBOTLASER0 REMISSIONFLASER REMISSIONRLASER POSITIONLASER BASEODOMETRY FRONTLASER "
    b"SIMULATOR_TRUEPOS SIMULATOR_OBJECTS ARM PANTILT SCANMARK POSITION_LASERMSG0 VISION"
    b" WIFI".split()
)
_MAX_COUNT_DIGITS = 9
"""More digits are no count, and thousands of them take long to become a number."""

_FLASER_TAGS = (b"FLASER", b"RLASER")
_STAMP_TOKENS = 3  # ipc_timestamp ipc_hostname logger_timestamp
_HEADER_TOKENS = 7  # type start fov step max accuracy remission
# laser pose, robot pose, tv, rv, two safety distances, and then maybe the turn axis
_ROBOTLASER_TAILS = (10, 11)


class ScanLine(NamedTuple):
    """A scan line; its ranges are parsed already if they are plain decimal numbers, as mostly.

    Attributes
    ----------
    head : the tokens up to the count of ranges.
    num_beams : that count.
    ranges : float64, shape (num_beams,) [m], or None where `words` must be parsed.
    words : the tokens of the ranges; empty where `ranges` are known, because splitting a line
        into a thousand tokens takes longer than parsing its numbers.
    tail : the tokens after the ranges.
    robot_pose, laser_pose, stamp : where these stand in `tail`; -1 where they are missing.
    """

    head: list[bytes]
    num_beams: int
    ranges: FloatArray | None
    words: list[bytes]
    tail: list[bytes]
    robot_pose: int
    laser_pose: int
    stamp: int


def read_scan_line(line: bytes) -> ScanLine:
    """Split a line whose tag is in `SCAN_TAGS` into its parts.

    Raises
    ------
    LineError
        If no form of the line has this number of tokens.
    """
    is_flaser = line.lstrip().startswith(_FLASER_TAGS)
    num_head = 2 if is_flaser else _HEADER_TOKENS + 2
    head = line.split(None, num_head)
    rest = head.pop() if len(head) > num_head else b""
    if len(head) < num_head and not is_flaser:
        raise LineError("line cut off", "the line ends within the header of the scan")
    num_beams = _beam_count(head[-1] if len(head) == num_head else b"")
    ranges: FloatArray | None = None
    end = -1
    if 2 * num_beams <= len(rest) + 1:
        ranges = np.empty(num_beams, dtype=np.float64)
        end = parse_decimals(rest, POWERS_OF_TEN, ranges)
    words = rest[max(end, 0) :].split()
    if end >= 0:
        words, tail = [], words
    elif len(words) >= num_beams:
        ranges, words, tail = None, words[:num_beams], words[num_beams:]
    else:
        raise LineError(
            "range count mismatch or line cut off",
            f"{num_beams} ranges are announced, the line ends after {len(words)}",
        )
    layout = _flaser_tail if is_flaser else _robotlaser_tail
    return ScanLine(head, num_beams, ranges, words, tail, *layout(head[0], tail, num_beams))


def _flaser_tail(_: bytes, tail: list[bytes], num_beams: int) -> tuple[int, int, int]:
    """Return where robot pose, laser pose and stamp stand after the ranges of FLASER."""
    if len(tail) == 6:
        return 3, 0, -1
    if len(tail) == 6 + _STAMP_TOKENS:
        return 3, 0, 6
    raise _wrong_count(num_beams, len(tail), "6 pose numbers and 3 of the stamp")


def _robotlaser_tail(tag: bytes, tail: list[bytes], num_beams: int) -> tuple[int, int, int]:
    """Return the same for ROBOTLASERn and RAWLASERn."""
    has_pose = tag.startswith(b"ROBOT")
    wanted = _ROBOTLASER_TAILS if has_pose else (0,)
    # A host name is no number, so it identifies a stamp; if it is a number, try both.
    has_host = len(tail) >= _STAMP_TOKENS and not _is_number(tail[-2])
    for num_stamp in (_STAMP_TOKENS,) if has_host else (0, _STAMP_TOKENS):
        start = _pose_start(tail, len(tail) - num_stamp, wanted)
        if start >= 0:
            laser, robot = (start, start + 3) if has_pose else (-1, -1)
            return robot, laser, len(tail) - _STAMP_TOKENS if num_stamp else -1
    raise _wrong_count(num_beams, len(tail), "the poses and the stamp")


def _pose_start(tail: list[bytes], end: int, wanted: tuple[int, ...]) -> int:
    """Return where the laser's pose begins, after any remissions, or -1."""
    plain = end in wanted
    blocked = -1
    if end > 0 and _is_count(tail[0]):
        after = 1 + int(tail[0])
        if end - after in wanted:
            blocked = after
    if plain and blocked >= 0:
        # "0" may be an empty remission block or the laser's x. Beside coordinates with decimals it
        # is a count; otherwise the form with the laser nearer to the robot is right.
        if any(b"." in token for token in tail[1:7]):
            return blocked
        return min((blocked, 0), key=lambda start: _laser_offset(tail, start))
    return 0 if plain else blocked


def _laser_offset(tokens: list[bytes], start: int) -> float:
    """Return the distance from robot to laser [m] plus turn [rad] if poses begin at `start`."""
    try:
        offset = relative(parse_pose(tokens, start + 3), parse_pose(tokens, start))
    except LineError:
        return math.inf
    return math.hypot(offset.x, offset.y) + abs(offset.theta)


def _beam_count(token: bytes) -> int:
    if not _is_count(token):
        shown = token.decode("ascii", "replace")[:20]
        raise LineError("no range count", f"the count of ranges is {shown!r}, not a whole number")
    if int(token) == 0:
        raise LineError("scan without ranges", "the scan has no ranges")
    return int(token)


def _is_count(token: bytes) -> bool:
    """Return whether a token is a whole number that can count the numbers of a line."""
    return token.isdigit() and len(token) <= _MAX_COUNT_DIGITS


def _wrong_count(num_beams: int, extra: int, wanted: str) -> LineError:
    return LineError(
        "range count mismatch or line cut off",
        f"{num_beams} ranges are announced, then {wanted} should follow, but {extra} tokens do",
    )


def odom_stamp_index(num_tokens: int) -> int:
    """Return the index of the stamp among the tokens of an ODOM line, -1 if it has none.

    Raises
    ------
    LineError
        If no form of the line has this number of tokens.
    """
    if num_tokens == 7 + _STAMP_TOKENS:
        return 7
    if num_tokens == 7:
        return -1
    raise LineError("line cut off", f"an ODOM line has 7 or 10 tokens, this one {num_tokens}")


def parse_stamp(tokens: list[bytes], index: int) -> float:
    """Return the stamp [s]; NaN if it is missing (`index` -1) or not finite.

    Raises
    ------
    LineError
        If the token is not a number.
    """
    if index < 0:
        return math.nan
    try:
        stamp = float(tokens[index])
    except ValueError:
        raise _not_a_number(tokens[index : index + 1]) from None
    return stamp if isfinite(stamp) else math.nan


def parse_pose(tokens: list[bytes], index: int, *, must_be_finite: bool = True) -> Pose:
    """Return the pose x, y [m], theta [rad] in the three tokens from `index` on.

    Raises
    ------
    LineError
        If a token is not a number, or not finite though it must be.
    """
    try:
        x, y, theta = float(tokens[index]), float(tokens[index + 1]), float(tokens[index + 2])
    except ValueError:
        raise _not_a_number(tokens[index : index + 3]) from None
    # The sum first: this is done for each line.
    if must_be_finite and not (
        isfinite(x + y + theta) or (isfinite(x) and isfinite(y) and isfinite(theta))
    ):
        raise LineError("pose not finite", "a number of the pose is NaN or infinite")
    return Pose(x, y, theta)


def parse_ranges(scan: ScanLine) -> FloatArray:
    """Return the ranges of a scan line [m], including NaN, infinite and negative ones.

    Raises
    ------
    LineError
        If a token is not a number.
    """
    if scan.ranges is not None:
        return scan.ranges
    try:
        return np.array(scan.words, dtype=np.float64)
    except ValueError:
        raise _not_a_number(scan.words) from None


def parse_mounting(scan: ScanLine) -> Pose:
    """Return tf_tracking_sensor; the poses of laser and robot are both in the odometry frame."""
    robot = parse_pose(scan.tail, scan.robot_pose)
    return relative(robot, parse_pose(scan.tail, scan.laser_pose))


class BeamAngles(NamedTuple):
    """Angle of beam 0 and step to the next [rad], sensor frame; maximum range [m] or inf."""

    angle_min: float
    angle_increment: float
    range_max: float


def beam_angles(scan: ScanLine) -> BeamAngles:
    """Return the beam angles of a scan line.

    FLASER and RLASER lines have no angles: by convention the beams span 180 degrees
    counter-clockwise from -90 degrees, an odd number with both ends (181: 1.0 degree), an even one
    without the last (180: 1.0 degree too). The other lines have them in their header.

    Raises
    ------
    LineError
        If a token of the header is not a number, or an angle is not finite.
    """
    num_beams = scan.num_beams
    if scan.head[0] in _FLASER_TAGS:
        steps = max(num_beams if num_beams % 2 == 0 else num_beams - 1, 1)
        return BeamAngles(-math.pi / 2, math.pi / steps, math.inf)
    try:
        start, field_of_view, step, longest = map(float, scan.head[2:6])
    except ValueError:
        raise _not_a_number(scan.head[2:6]) from None
    if not (isfinite(start) and isfinite(field_of_view)):
        raise LineError("header not finite", "an angle of the scan's header is NaN or infinite")
    if not (isfinite(step) and step != 0.0):
        step = field_of_view / max(num_beams - 1, 1)
    usable = isfinite(longest) and longest > 0.0
    return BeamAngles(start, step, longest if usable else math.inf)


def _not_a_number(tokens: list[bytes]) -> LineError:
    """Return the fault of the first of the tokens that is not a number."""
    fault = next((token for token in tokens if not _is_number(token)), tokens[0])
    shown = fault.decode("ascii", "replace")[:20]
    return LineError("not a number", f"{shown!r} is not a number")


def _is_number(token: bytes) -> bool:
    try:
        float(token)
    except ValueError:
        return False
    return True
