# SPDX-License-Identifier: Apache-2.0
"""Lines of a CARMEN log, as they are written, into messages."""

from __future__ import annotations

import math

from cartoloop.live.messages import (
    Message,
    MessageError,
    OdometryMessage,
    ScanMessage,
)
from cartoloop.readers.carmen_index import REAR_TAGS
from cartoloop.readers.carmen_lines import (
    IGNORED_TAGS,
    SCAN_TAGS,
    LineError,
    ScanLine,
    beam_angles,
    laser_offset_params,
    odom_stamp_index,
    parse_laser_offset,
    parse_pose,
    parse_ranges,
    parse_stamp,
    read_scan_line,
)
from cartoloop.sensor.events import ScanGeometry
from cartoloop.sensor.pose import Pose


class CarmenParser:
    """Reads lines one by one; where the scanners sit, the lines before have told."""

    def __init__(self) -> None:
        self._params: dict[str, float] = {}
        self._tags: dict[bool, bytes] = {}  # of the scanner in front, and of the one behind
        self._offsets: dict[bytes, Pose] = {}

    def parse(self, line: bytes) -> list[Message]:
        """Return the messages in a line: odometry, a scan, both or neither.

        Raises
        ------
        MessageError
            The line is damaged, or is none of a CARMEN log.
        """
        words = line.split(None, 1)
        if not words or words[0].startswith(b"#"):
            return []
        tag = words[0]
        try:
            if tag == b"ODOM":
                tokens = line.split()
                stamp = parse_stamp(tokens, odom_stamp_index(len(tokens)))
                return [OdometryMessage(stamp, parse_pose(tokens, 1))]
            if tag == b"PARAM":
                self._note_param(line.split())
                return []
            if tag in SCAN_TAGS:
                return self._scan(tag, line)
        except LineError as error:
            raise MessageError(error.reason, str(error)) from None
        if tag in IGNORED_TAGS:
            return []
        shown = tag[:20].decode("ascii", "replace")
        raise MessageError("unknown line", f"unknown line {shown!a}")

    def _note_param(self, tokens: list[bytes]) -> None:
        try:
            value = float(tokens[2])
        except (ValueError, IndexError):
            return  # most parameters are names
        if math.isfinite(value):
            self._params[tokens[1].decode("ascii", "replace")] = value

    def _scan(self, tag: bytes, line: bytes) -> list[Message]:
        # FLASER and ROBOTLASER1 lines may tell of the same scanner: the first to come is taken.
        if self._tags.setdefault(tag in REAR_TAGS, tag) != tag:
            return []
        scan = read_scan_line(line)
        ranges, angles = parse_ranges(scan), beam_angles(scan)
        stamp = parse_stamp(scan.tail, scan.stamp)
        geometry = ScanGeometry(
            angle_min=angles.angle_min,
            angle_increment=angles.angle_increment,
            num_beams=scan.num_beams,
            range_min=0.0,
            range_max=angles.range_max,
            tf_tracking_sensor=self._offset(tag, scan),
            sensor="rear" if tag in REAR_TAGS else "",
        )
        messages: list[Message] = []
        if scan.robot_pose >= 0:
            messages.append(OdometryMessage(stamp, parse_pose(scan.tail, scan.robot_pose)))
        return [*messages, ScanMessage(stamp, ranges, geometry)]

    def _offset(self, tag: bytes, scan: ScanLine) -> Pose:
        """Return where the scanner sits, as its first scan or the parameters tell."""
        if tag not in self._offsets:
            if tag.startswith(b"ROBOTLASER"):
                self._offsets[tag] = parse_laser_offset(scan)
            else:
                return laser_offset_params(self._params, rear=tag in REAR_TAGS)
        return self._offsets[tag]
