# SPDX-License-Identifier: Apache-2.0
"""CARMEN text logs as a `LineFormat`.

File order is the true order. The odometry pose of a scan line is used, its corrected pose never.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from cartoloop.readers.carmen_lines import (
    IGNORED_TAGS,
    SCAN_TAGS,
    ScanLine,
    beam_angles,
    odom_stamp_index,
    parse_mounting,
    parse_pose,
    parse_ranges,
    parse_stamp,
    read_scan_line,
)
from cartoloop.readers.line_format import (
    Head,
    LineError,
    LineFormat,
    Parse,
    Reading,
    Settings,
    angles_checked,
)
from cartoloop.sensor.events import ScanGeometry
from cartoloop.sensor.pose import IDENTITY, Pose

ODOM_TAG, PARAM_TAG = b"ODOM", b"PARAM"

# Each scanner by the tags of its scans, those with an odometry pose first. A log often holds each
# scan twice, once with a pose and once raw.
FRONT_TAGS = ("ROBOTLASER1", "FLASER", "RAWLASER1")
REAR_TAGS = ("ROBOTLASER2", "RLASER", "RAWLASER2")

_KNOWN_TAGS = frozenset((*SCAN_TAGS, *IGNORED_TAGS, ODOM_TAG, PARAM_TAG))
_TITLE = b"# CARMEN"
_CUSTOMARY_BEAMS = (180, 181, 360, 361)  # of SICK scanners, by which the angles of FLASER are known

_MAX_GEOMETRIES = 256
"""Geometries kept of scanners whose header changes from scan to scan: bounds the memory."""

GeometryKey = tuple[bytes, int, tuple[bytes, ...]]


def _recognise(head: Head) -> bool:
    tags = (line.split(None, 1)[:1] for line in head)
    return any(line.startswith(_TITLE) for line in head) or any(
        tag[0] in _KNOWN_TAGS for tag in tags if tag
    )


def _parser(_: Head) -> Parse:
    geometries: dict[GeometryKey, ScanGeometry] = {}

    def parse(line: bytes) -> Reading | None:
        words = line.split(None, 1)
        if not words:
            return None
        tag = words[0]
        if tag in SCAN_TAGS:
            return _scan_reading(read_scan_line(line), geometries)
        if tag == ODOM_TAG:
            tokens = line.split()
            stamp = parse_stamp(tokens, odom_stamp_index(len(tokens)))
            return Reading(stamp, parse_pose(tokens, 1))
        if tag == PARAM_TAG:
            return _setting(line.split())
        if tag.startswith(b"#"):
            return None
        shown = tag.decode("ascii", "replace")[:20]
        if tag in IGNORED_TAGS:
            raise LineError(f"{shown} (not used)")
        raise LineError("unknown line", f"unknown line {shown!a}")

    return parse


def _scan_reading(scan: ScanLine, geometries: dict[GeometryKey, ScanGeometry]) -> Reading:
    stamp = parse_stamp(scan.tail, scan.stamp)
    ranges = parse_ranges(scan)
    pose = None
    if scan.robot_pose >= 0:  # a scan is of use without odometry
        pose = parse_pose(scan.tail, scan.robot_pose, must_be_finite=False)
    tag = scan.head[0]
    mounting = _stated_mounting(scan) if tag.startswith(b"ROBOTLASER") else None
    key = (tag, scan.num_beams, tuple(scan.head[2:-1]))
    geometry = geometries.get(key)
    if geometry is None:
        if len(geometries) >= _MAX_GEOMETRIES:
            geometries.clear()
        angles = beam_angles(scan)
        with angles_checked():
            geometry = geometries[key] = ScanGeometry(
                angle_min=angles.angle_min,
                angle_increment=angles.angle_increment,
                num_beams=scan.num_beams,
                range_min=0.0,
                range_max=angles.range_max,
                sensor=tag.decode(),
            )
    return Reading(stamp, pose, ranges, geometry, mounting)


def _stated_mounting(scan: ScanLine) -> Pose | None:
    """Return tf_tracking_sensor by the two poses of a ROBOTLASER line, None if one is damaged."""
    try:
        return parse_mounting(scan)
    except LineError:
        return None  # the scan itself is sound, and other lines state the mounting too


def _setting(tokens: list[bytes]) -> Reading | None:
    """Return a parameter with a finite value; others do not concern scanners."""
    try:
        value = float(tokens[2])
    except (ValueError, IndexError):
        return None
    if not math.isfinite(value):
        return None
    return Reading(setting=(tokens[1].decode("ascii", "replace"), value))


def _select(counts: Mapping[str, int]) -> list[str]:
    """Return the tag to use of each scanner: with an odometry pose where there is one."""
    used = []
    for tags in (FRONT_TAGS, REAR_TAGS):
        with_pose = max(tags[:2], key=lambda tag: counts.get(tag, 0))
        tag = with_pose if counts.get(with_pose, 0) else tags[2]
        if counts.get(tag, 0):
            used.append(tag)
    return used


def mounting(tag: str, settings: Settings) -> Pose:
    """Return tf_tracking_sensor of the front or the rear laser by the PARAM lines.

    Without such lines the scanner is at the robot's centre; the rear one looks backwards.
    """
    is_rear = tag in REAR_TAGS
    prefix = "robot_rearlaser" if is_rear else "robot_frontlaser"
    facing = math.pi if is_rear else IDENTITY.theta
    return Pose(
        settings.get(f"{prefix}_offset", 0.0),
        settings.get(f"{prefix}_side_offset", 0.0),
        settings.get(f"{prefix}_angular_offset", facing),
    )


def _remark(tag: str, num_beams: int) -> str:
    if tag != "FLASER" or num_beams in _CUSTOMARY_BEAMS:
        return ""
    return f"FLASER lines carry no angles; {num_beams} beams are taken to span 180 degrees"


CARMEN = LineFormat(
    "CARMEN log",
    _recognise,
    None,
    _parser,
    select_scanners=_select,
    mounting=mounting,
    remark=_remark,
    repeats_odometry=True,
    stamp_ends_line=True,
    is_scan=lambda line: line.lstrip().startswith(SCAN_TAGS),
)
