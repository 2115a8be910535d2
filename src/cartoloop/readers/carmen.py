# SPDX-License-Identifier: Apache-2.0
"""CARMEN text logs, plain or gzip: one quick pass for stamps and counts, then events lazily.

File order is the true order. The odometry pose of a scan line is used, its corrected pose never.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cartoloop.errors import InputError
from cartoloop.readers.carmen_index import (
    BROKEN,
    CUT,
    FIRST_SCAN,
    IGNORED,
    ODOM,
    REAR_TAGS,
    SILENT,
    UNKNOWN,
    index_log,
    scan_kind,
)
from cartoloop.readers.carmen_lines import (
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
from cartoloop.readers.line_times import line_times, note_damage, note_times
from cartoloop.readers.log import Problems, TellsProblems
from cartoloop.readers.source import Source
from cartoloop.sensor.events import LaserScan, Odometry, ScanGeometry, SensorEvent
from cartoloop.sensor.pose import Pose, wrap_angle
from cartoloop.sensor.sensor_profile import SensorProfile, profile_sensor
from cartoloop.sensor.time_repair import TimeReport

FloatArray = NDArray[np.float64]
GeometryKey = tuple[bytes, int, tuple[bytes, ...]]

# A laser that moves against the robot by more than this is a corrected pose, not an offset.
_RIGID_METERS = 0.02
_RIGID_RADIANS = 0.02
ODOM_TAG = b"ODOM"
_CUSTOMARY_BEAMS = (180, 181, 360, 361)


class CarmenLog(TellsProblems):
    """A CARMEN log; see `cartoloop.readers.log.Log` for what it offers.

    Parameters
    ----------
    source : the file, plain or gzip, or its path.
    laser_pose : where the main scanner sits on the robot, if the log is not to be asked.

    Attributes
    ----------
    profiles : the profile of each scanner, by the tag of its lines; the main scanner first.

    Raises
    ------
    InputError
        If the file cannot be read, is no CARMEN log, or holds no usable scan.
    """

    def __init__(self, source: Source | str | Path, *, laser_pose: Pose | None = None) -> None:
        self._source = source if isinstance(source, Source) else Source(source)
        self.name = self._source.name
        self._found = Problems()  # while opening; does not change any more
        self._index = index_log(self._source)
        self._tags = self._index.used_tags()
        if not self._tags:
            raise InputError(self._why_no_scans())
        self.num_scans = sum(self._index.count(tag) for tag in self._tags)
        self._times, self.time_report = self._repair_times()
        self._offsets = {tag: self._find_offset(tag) for tag in self._tags}
        if laser_pose is not None:
            self._offsets[self._tags[0]] = laser_pose
        self._geometries: dict[GeometryKey, ScanGeometry] = {}
        self.profiles: dict[str, SensorProfile] = {}
        self._profile_scanners()
        self._note_what_was_found()
        self._current = self._found

    @property
    def line_counts(self) -> dict[str, int]:
        """How many lines of each kind that could be mapped there are, whether used or not."""
        tags = [ODOM_TAG, *SCAN_TAGS]
        kinds = [ODOM, *map(scan_kind, SCAN_TAGS)]
        counts = {
            tag.decode(): int((self._index.kinds == kind).sum())
            for tag, kind in zip(tags, kinds, strict=True)
        }
        return {tag: count for tag, count in counts.items() if count}

    @property
    def description(self) -> str:
        """What is in it: some lines for the user."""
        return self.profile.describe()

    @property
    def profile(self) -> SensorProfile:
        """What the recording says of its main scanner."""
        return next(iter(self.profiles.values()))

    @property
    def duration(self) -> float:
        """Repaired time from the first to the last event [s]."""
        finite = self._times[np.isfinite(self._times)]
        return float(finite[-1] - finite[0])

    def __iter__(self) -> Iterator[SensorEvent]:
        """Yield the events in file order; bad lines are skipped and counted.

        Raises
        ------
        InputError
            At the end, if no scan at all could be used.
        """
        current = self._current = self._found.copy()
        kinds, times, stamps = self._index.kinds.tolist(), self._times, self._index.stamps
        used = {scan_kind(tag) for tag in self._tags}
        last_odometry = None
        odometry: Odometry | None
        scan: LaserScan | None
        num_yielded = 0
        for number, line in enumerate(self._source.lines()):
            kind = kinds[number]
            if kind == SILENT:
                continue
            if kind != ODOM and kind not in used:
                self._skip(current, number, kind, line)
                continue
            time = float(times[number])
            stamp = float(stamps[number])
            stamp = time if math.isnan(stamp) else stamp
            odometry, scan = None, None
            try:
                if kind == ODOM:
                    odometry = Odometry(stamp, time, parse_pose(line.split(None, 4), 1))
                else:
                    odometry, scan = self._parse_scan(line, stamp, time)
            except LineError as error:
                current.skip(error.reason, self._at(number, error.detail))
                continue
            if odometry is not None:
                # A scan line repeats the ODOM line before it; its stamp names the scan alike.
                key = (odometry.tf_odom_tracking, stamp)
                if key != last_odometry:
                    yield odometry
                last_odometry = key
            if scan is not None:
                num_yielded += 1
                yield scan
        if num_yielded == 0:
            raise InputError(self._why_no_scans())

    def _parse_scan(
        self, line: bytes, stamp: float, time: float
    ) -> tuple[Odometry | None, LaserScan]:
        """Return the odometry and the scan of a scan line."""
        scan = read_scan_line(line)
        ranges = parse_ranges(scan)
        geometry = self._geometry(scan)
        odometry = None
        if scan.robot_pose >= 0:
            odometry = Odometry(stamp, time, parse_pose(scan.tail, scan.robot_pose))
        return odometry, LaserScan(stamp, time, ranges, geometry)

    def _geometry(self, scan: ScanLine) -> ScanGeometry:
        """Return the geometry, one object for all lines with the same beams."""
        tag = scan.head[0]
        key = (tag, scan.num_beams, tuple(scan.head[2:-1]))
        geometry = self._geometries.get(key)
        if geometry is None:
            angles = beam_angles(scan)
            geometry = ScanGeometry(
                angle_min=angles.angle_min,
                angle_increment=angles.angle_increment,
                num_beams=scan.num_beams,
                range_min=0.0,
                range_max=angles.range_max,
                tf_tracking_sensor=self._offsets[tag],
                sensor=tag.decode(),
            )
            profile = self.profiles.get(tag.decode())
            geometry = profile.apply(geometry) if profile else geometry
            self._geometries[key] = geometry
        return geometry

    def _repair_times(self) -> tuple[FloatArray, TimeReport]:
        """Return a time for each line with an event, NaN for others, and what was wrong."""
        index = self._index
        scans = [np.flatnonzero(index.kinds == scan_kind(tag)) for tag in self._tags]
        return line_times(index.stamps, scans, np.flatnonzero(index.kinds == ODOM))

    def _find_offset(self, tag: bytes) -> Pose:
        """Return where the scanner sits, from the scans' two poses or else from PARAM lines."""
        told = laser_offset_params(self._index.params, rear=tag in REAR_TAGS)
        if not tag.startswith(b"ROBOTLASER"):
            return told
        offsets = []
        for _, line in self._index.samples[tag].lines:
            try:
                offsets.append(parse_laser_offset(read_scan_line(line)))
            except LineError:
                continue  # the line is counted when it is its turn
        if not offsets:
            return told
        columns = np.array(offsets)
        # Angles near pi must not be averaged across the seam.
        turns = np.array([wrap_angle(theta - offsets[0].theta) for theta in columns[:, 2]])
        x, y = (float(value) for value in np.median(columns[:, :2], axis=0))
        turn = float(np.median(turns))
        shift = np.hypot(columns[:, 0] - x, columns[:, 1] - y)
        rigid = np.quantile(shift, 0.9) <= _RIGID_METERS
        if rigid and np.quantile(np.abs(turns - turn), 0.9) <= _RIGID_RADIANS:
            return Pose(x, y, wrap_angle(offsets[0].theta + turn))
        self._found.add(
            "warning",
            f"{self.name}: the laser moves against the robot in {tag.decode()} lines (corrected "
            "poses?), so its place is taken from PARAM lines or else the robot's centre",
        )
        return told

    def _profile_scanners(self) -> None:
        """Read each scanner's profile off the sample of its scans."""
        has_odometry = bool((self._index.kinds == ODOM).any()) or any(
            not tag.startswith(b"RAW") for tag in self._tags
        )
        for tag in self._tags:
            scans = []
            for number, line in self._index.samples[tag].lines:
                time = float(self._times[number])
                try:
                    scans.append(self._parse_scan(line, time, time)[1])
                except LineError:
                    continue  # the line is counted when it is its turn
            if not scans:
                raise InputError(self._why_no_scans())
            profile = profile_sensor(scans, has_odometry=has_odometry)
            times = self._times[self._index.kinds == scan_kind(tag)]
            if len(times) > 1:
                profile = replace(profile, rate=1.0 / self.time_report.period)
            self.profiles[tag.decode()] = profile
        self._geometries.clear()  # those without the profiles

    def _note_what_was_found(self) -> None:
        """Turn what opening found into problems."""
        note_damage(self._found, self._source, len(self._index.kinds))
        note_times(self._found, self.name, self.time_report)
        beams = self.profile.num_beams
        if self._tags[0] == b"FLASER" and beams not in _CUSTOMARY_BEAMS:
            self._found.add(
                "note",
                f"{self.name}: FLASER lines carry no angles; {beams} beams are taken to span "
                "180 degrees",
            )

    def _skip(self, current: Problems, number: int, kind: int, line: bytes) -> None:
        """Count a line that yields no event."""
        tag = line.split(None, 1)[0].decode("ascii", "replace")[:20]
        if kind >= FIRST_SCAN:
            current.skip(f"{tag} (the same scanner as {self._tags[0].decode()})")
        elif kind == IGNORED:
            current.skip(f"{tag} (not used)")
        elif kind == UNKNOWN:
            current.skip("unknown line", self._at(number, f"unknown line {tag!r}"))
        elif kind == CUT:
            current.skip("line cut off", self._at(number, "the last line is cut off"))
        elif kind == BROKEN:
            error = _fault(line)
            current.skip(error.reason, self._at(number, error.detail))

    def _at(self, line_index: int, message: str) -> str:
        return f"{self.name}:{line_index + 1}: {message}"

    def _why_no_scans(self) -> str:
        """Return the message for a file without a single usable scan."""
        path, kinds = self._source.path, self._index.kinds
        for number, line in enumerate(self._source.lines()):
            if line.lstrip().startswith(SCAN_TAGS) and line.split(None, 1)[0] in SCAN_TAGS:
                fault = _fault(line).detail
                return (
                    f"{path}:{number + 1}: no scan of this log can be used; "
                    f"here {fault}; check how it was written"
                )
        if (kinds == ODOM).any() or (kinds == IGNORED).any():
            return f"{path}: holds no laser scans; record FLASER or ROBOTLASER1 lines"
        return (
            f"{path}: is no CARMEN log (no line starts with FLASER, ROBOTLASER1, ODOM), nor any "
            "other recording that is known; give a CARMEN, DP-SLAM, tinySLAM or CSV text log, "
            "plain or gzip, or a ROS bag"
        )


def _fault(line: bytes) -> LineError:
    """Return what is wrong with a line that cannot be used."""
    tokens = line.split()
    try:
        if tokens[0] == b"ODOM":
            stamp = odom_stamp_index(len(tokens))
            parse_stamp(tokens, stamp)
        else:
            scan = read_scan_line(line)
            parse_stamp(scan.tail, scan.stamp)
            parse_ranges(scan)
            if scan.robot_pose >= 0:
                parse_pose(scan.tail, scan.robot_pose)
            beam_angles(scan)
    except LineError as error:
        return error
    return LineError("line cut off", "the line is cut off")
