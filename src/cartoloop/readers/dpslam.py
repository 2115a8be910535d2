# SPDX-License-Identifier: Apache-2.0
"""DP-SLAM's text logs: ``Odometry x y theta`` before each ``Laser n r1 .. rn``, without times.

Metres and radians. The beams span 180 degrees from -90 degrees on counter-clockwise, as those of
CARMEN's FLASER lines do.
"""

from __future__ import annotations

import math

import numpy as np

from cartoloop.kernels.decimal_text import POWERS_OF_TEN, parse_decimals
from cartoloop.readers.line_format import Head, LineError, LineFormat, Parse, Reading
from cartoloop.sensor.events import ScanGeometry
from cartoloop.sensor.pose import Pose

_TAGS = (b"Odometry", b"Laser")


def _recognise(head: Head) -> bool:
    tags = {line.split(None, 1)[0] for line in head if line.strip() and not line.startswith(b"#")}
    return bool(tags) and tags <= set(_TAGS)


def _geometry_of(num_beams: int) -> ScanGeometry:
    """Return the geometry of a number of beams: 180 and 181 beams are one degree apart."""
    steps = max(num_beams - num_beams % 2, 1)
    return ScanGeometry(-math.pi / 2, math.pi / steps, num_beams, 0.0, math.inf, sensor="Laser")


def _geometry(head: Head) -> ScanGeometry:
    for line in head:
        words = line.split(None, 2)
        if words[:1] == [b"Laser"] and len(words) > 1 and (count := _count(words[1])):
            return _geometry_of(count)
    raise LineError("no scan", "no Laser line among the first; check how the log was written")


def _parser(_: Head) -> Parse:
    pose: Pose | None = None
    geometries: dict[int, ScanGeometry] = {}

    def parse(line: bytes) -> Reading | None:
        nonlocal pose
        tag, _, rest = line.strip().partition(b" ")
        if not tag or tag.startswith(b"#"):
            return None
        if tag == b"Odometry":
            pose = None
            pose = Pose(*_numbers(rest, 3))
            return None
        if tag != b"Laser":
            raise LineError("unknown line", f"unknown line {tag.decode('ascii', 'replace')[:20]!r}")
        count, _, rest = rest.strip().partition(b" ")
        num_ranges = _count(count)
        if num_ranges is None:
            raise LineError("no range count", "the count of ranges is not a whole number")
        # The odometry belongs to the scan that follows it, and to no other.
        own, pose = pose, None
        ranges = _numbers(rest, num_ranges)
        geometry = geometries.setdefault(len(ranges), _geometry_of(len(ranges)))
        return Reading(tf_odom_tracking=own, ranges=ranges, geometry=geometry)

    return parse


def _count(word: bytes) -> int | None:
    """Return a count of ranges, None if it is none; no line has a thousand million."""
    return int(word) if word.isdigit() and len(word) <= 9 else None


def _numbers(text: bytes, count: int) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """Return the `count` numbers in a text."""
    if 2 * count <= len(text) + 1:
        values = np.empty(count)
        end = parse_decimals(text, POWERS_OF_TEN, values)
        if end >= 0 and not text[end:].strip():
            return values
    words = text.split()
    if len(words) != count:
        raise LineError(
            "range count mismatch or line cut off",
            f"{count} numbers should follow, but {len(words)} do",
        )
    try:
        return np.array(words, dtype=np.float64)
    except ValueError:
        raise LineError("not a number", "a word of the line is not a number") from None


DPSLAM = LineFormat(
    "DP-SLAM log",
    _recognise,
    _geometry,
    _parser,
    is_scan=lambda line: line.lstrip().startswith(b"Laser"),
)
