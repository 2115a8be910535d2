# SPDX-License-Identifier: Apache-2.0
"""A text recording of any format that has one message on each line.

A `LineFormat` describes the format. The rest is common to all of them and done here: compression,
times, skipped lines, mounting poses and profiles of the scanners.
"""

from __future__ import annotations

import math
from array import array
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from itertools import islice
from math import isfinite
from pathlib import Path

import numpy as np

from cartoloop.arrays import FloatArray, IntArray
from cartoloop.errors import InputError
from cartoloop.readers.copies import COPIED_SCAN, CopyFinder, LastOdometry
from cartoloop.readers.fingerprint import fingerprint
from cartoloop.readers.kept_readings import KeptReadings
from cartoloop.readers.line_checks import bounded, careful, check, has_pose, is_finite
from cartoloop.readers.line_format import LineError, LineFormat, Reading
from cartoloop.readers.line_times import line_times, note_damage, note_times
from cartoloop.readers.log import EventGenerator, LogBase, ProblemLog
from cartoloop.readers.scan_sample import ScanSample
from cartoloop.readers.text_file import TextFile
from cartoloop.sensor.events import LaserScan, Odometry, ScanGeometry
from cartoloop.sensor.pose import Pose, wrap_angle
from cartoloop.sensor.sensor_profile import SensorProfile, profile_sensor
from cartoloop.sensor.time_repair import LATEST_STAMP, TimeReport

_HEAD_LINES = 32
"""Lines of the head, blank lines and comments not counted: enough to see each kind of line."""

_MAX_HEAD_LINES = 4096
"""Lines of the head in all: a file of comments is not read whole."""

_MAX_SHIFT_M, _MAX_TURN_RAD = 0.02, 0.02
"""A scanner that moves against the robot by more than this in a tenth of its scans is not where
its lines state: they hold poses corrected by scan matching. Coarser than the 1 cm and 0.01 rad to
which some logs round their poses."""

_MAX_GEOMETRIES = 256
"""Geometries kept of scanners whose beam angles change from scan to scan: bounds the memory."""

# What a line holds. Scans: _FIRST_SCANNER + the number of the scanner, by first appearance.
_SILENT, _ODOMETRY, _CUT_OFF, _COPY, _FIRST_SCANNER = range(5)


def head_of(text: TextFile) -> list[bytes]:
    """Return the first lines of a text, by which formats are recognised."""
    head: list[bytes] = []
    num_filled = 0
    for line in islice(text.lines(), _MAX_HEAD_LINES):
        head.append(line)
        start = line.lstrip()[:1]
        num_filled += start not in (b"", b"#")
        if num_filled == _HEAD_LINES:
            break
    return head


class LineLog(LogBase):
    """A text recording; see `cartoloop.readers.log.Log` for what it offers.

    Parameters
    ----------
    text : the file, plain or gzip, or its path.
    line_format : how to read it.
    laser_pose : mounting pose of the main scanner, instead of the recorded one.

    Attributes
    ----------
    format_name : name of its format.
    profiles : the profile of each scanner in use, by name; the main scanner first.
    scan_counts : number of scans by scanner, in use or not.
    num_odometry : number of odometry poses, including those of scan lines.
    num_odometry_lines : number of lines that hold odometry and no scan.

    Raises
    ------
    InputError
        If the file cannot be read, or holds no usable scan.
    """

    def __init__(
        self,
        text: TextFile | str | Path,
        line_format: LineFormat,
        *,
        laser_pose: Pose | None = None,
    ) -> None:
        super().__init__()
        self._text = text if isinstance(text, TextFile) else TextFile(text)
        self.name = self._text.name
        self.fingerprint = fingerprint(self._text.path)
        self.format_name = line_format.name
        self._format = line_format
        self._head = head_of(self._text)
        self._geometry = self._default_geometry()
        self._geometries: dict[tuple[ScanGeometry, int], ScanGeometry] = {}
        self._recent: tuple[ScanGeometry | None, ScanGeometry | None] = None, None
        self._kept = KeptReadings()
        self._index_lines()
        scans = [self._lines_of(scanner) for scanner in self._used]
        odometry = np.flatnonzero(self._kinds == _ODOMETRY)
        self.time_report: TimeReport
        self._times, self.time_report = line_times(self._stamps, scans, odometry)
        self.num_scans = sum(map(len, scans))
        self._mountings = {scanner: self._find_mounting(scanner) for scanner in self._used}
        if laser_pose is not None:
            self._mountings[self._used[0]] = laser_pose
        self.profiles: dict[str, SensorProfile] = {}
        self.profiles = {scanner: self._profile(scanner) for scanner in self._used}
        self._geometries.clear()  # those without the profiles
        self._recent = None, None
        del self._samples, self._stamps
        self._note_what_was_found()

    @property
    def description(self) -> str:
        """Beams, ranges and rate of the main scanner: some lines for the user."""
        return self.profile.describe()

    @property
    def profile(self) -> SensorProfile:
        """Properties of the main scanner, estimated from its scans."""
        return self.profiles[self._used[0]]

    @property
    def duration(self) -> float:
        """Repaired time from the first to the last event [s]."""
        finite = self._times[np.isfinite(self._times)]
        return float(finite[-1] - finite[0]) if len(finite) else 0.0

    def _events(self, problems: ProblemLog) -> EventGenerator:
        parse = careful(self._format.parser(self._head))
        unused = self._unused_scanners()
        kinds, times, kept = self._kinds.tolist(), self._times.tolist(), self._kept
        last_odometry = LastOdometry()
        for number, (line, kind) in enumerate(zip(self._text.lines(), kinds, strict=False)):
            if kind in unused:
                problems.skip(unused[kind])
                continue
            if kind == _COPY:
                if self._format.is_scan(line):
                    problems.skip(COPIED_SCAN)
                continue
            try:
                if kind == _CUT_OFF:
                    raise LineError("line cut off", "the last line is cut off")
                reading = kept.of_line(number) if kept.is_whole else parse(bounded(line))
                if reading is None:
                    continue
                if kind == _SILENT:
                    # The other lines passed it while they were indexed.
                    check(reading, self._geometry)
            except LineError as error:
                place = f"{self.name}:{number + 1}: {error.detail}"
                is_lost = bool(error.detail) and self._format.is_scan(line)
                problems.skip(error.reason, place if error.detail else "", is_scan=is_lost)
                continue
            time = times[number]
            stamp = reading.stamp if abs(reading.stamp) <= LATEST_STAMP else time
            if not is_finite(reading.tf_odom_tracking):
                place = f"{self.name}:{number + 1}: the odometry pose is NaN or infinite"
                problems.skip("odometry not finite, scan kept", place)
            elif reading.tf_odom_tracking is not None:
                is_repeated = last_odometry.is_repeated(reading.tf_odom_tracking, stamp)
                if not (self._format.repeats_odometry and is_repeated):
                    yield Odometry(stamp, time, reading.tf_odom_tracking)
            if reading.ranges is not None:
                yield self._scan(reading, reading.ranges, stamp, time)

    def _unused_scanners(self) -> dict[int, str]:
        """Return the reason for skipping the scans of each scanner that is not in use, by kind."""
        return {
            self._kind_of(scanner): f"{scanner} (the same scanner as {self._used[0]})"
            for scanner in self.scan_counts
            if scanner not in self._used
        }

    def _scan(self, reading: Reading, ranges: FloatArray, stamp: float, time: float) -> LaserScan:
        own = self._geometry if reading.geometry is None else reading.geometry
        assert own is not None  # checked while indexing
        recent, geometry = self._recent
        if own is recent and geometry is not None and geometry.num_beams == len(ranges):
            return LaserScan(stamp, time, ranges, geometry)  # comparing geometries takes longer
        geometry = self._geometries.get((own, len(ranges)))
        if geometry is None:
            mounting = self._mountings[own.sensor]
            geometry = replace(own, num_beams=len(ranges), tf_tracking_sensor=mounting)
            profile = self.profiles.get(own.sensor)
            geometry = profile.apply(geometry) if profile else geometry
            if len(self._geometries) >= _MAX_GEOMETRIES:
                self._geometries.clear()
            self._geometries[own, len(ranges)] = geometry
        self._recent = own, geometry
        return LaserScan(stamp, time, ranges, geometry)

    def _default_geometry(self) -> ScanGeometry | None:
        try:
            return self._format.geometry(self._head) if self._format.geometry else None
        except LineError as error:
            raise InputError(f"{self._text.path}: {error}") from None

    def _index_lines(self) -> None:
        """Read the file once: the kind and the stamp of each line, and a sample of the scans."""
        parse = careful(self._format.parser(self._head))
        kinds, stamps = array("H"), array("d")
        self._scanners: list[str] = []
        self._samples: dict[str, ScanSample[Reading]] = {}
        self._settings: dict[str, float] = {}
        num_poses: Counter[int] = Counter()
        first_fault = ""
        copies, last_odometry = CopyFinder(), LastOdometry()
        for number, line in enumerate(self._text.lines()):
            kind, stamp = _SILENT, math.nan
            outcome: Reading | LineError | None
            try:
                reading = outcome = parse(bounded(line))
                if reading is not None:
                    check(reading, self._geometry)
                    repeats = last_odometry.is_repeated(reading.tf_odom_tracking, reading.stamp)
                    repeats = repeats and self._format.repeats_odometry and reading.ranges is None
                    if isfinite(reading.stamp) and (repeats or copies.is_copy(line)):
                        kind = _COPY
                    else:
                        kind, stamp = self._index_reading(number, reading), reading.stamp
                        num_poses[kind] += has_pose(reading)
            except LineError as error:
                outcome = error
                if error.detail and not first_fault:
                    first_fault = f"{self._text.path}:{number + 1}: {error.detail}"
            self._kept.add(outcome)
            kinds.append(kind)
            stamps.append(stamp if abs(stamp) <= LATEST_STAMP else math.nan)
        self._kinds = np.array(kinds, dtype=np.uint16)
        self._stamps: FloatArray = np.array(stamps)
        self._mark_cut_line()
        counts = {name: len(self._lines_of(name)) for name in self._scanners}
        self.scan_counts = {name: count for name, count in counts.items() if count}
        self._used = list(self._format.select_scanners(self.scan_counts))
        if not self._used:
            raise InputError(self._no_scans_message(first_fault))
        self.num_odometry_lines = int((self._kinds == _ODOMETRY).sum())
        self.num_odometry = num_poses[_ODOMETRY]
        self.num_odometry += sum(num_poses[self._kind_of(name)] for name in self._used)

    def _index_reading(self, number: int, reading: Reading) -> int:
        """Add a line to the settings or the samples; return its kind."""
        if reading.setting is not None:
            self._settings.setdefault(*reading.setting)
        if reading.ranges is None:
            return _SILENT if reading.tf_odom_tracking is None else _ODOMETRY
        geometry = reading.geometry or self._geometry
        if geometry is None:
            raise LineError("scan without angles", "the beam angles of the scan are not known")
        sample = self._samples.get(geometry.sensor)
        if sample is None:
            self._scanners.append(geometry.sensor)
            sample = self._samples[geometry.sensor] = ScanSample()
        sample.offer(number, reading)
        return self._kind_of(geometry.sensor)

    def _kind_of(self, scanner: str) -> int:
        return _FIRST_SCANNER + self._scanners.index(scanner)

    def _lines_of(self, scanner: str) -> IntArray:
        """Return the indices of the lines with a scan of a scanner."""
        return np.flatnonzero(self._kinds == self._kind_of(scanner))

    def _mark_cut_line(self) -> None:
        """Mark a last line that lost its stamp where others have one: its numbers are cut too."""
        if not (self._format.stamp_ends_line and self._text.ends_mid_line):
            return
        if self._kinds[-1] != _SILENT and np.isnan(self._stamps[-1]):
            if not np.isfinite(self._stamps[:-1]).any():
                return
            self._kinds[-1] = _CUT_OFF
            for sample in self._samples.values():
                sample.drop(len(self._kinds) - 1)

    def _find_mounting(self, scanner: str) -> Pose:
        """Return tf_tracking_sensor: as the scans state it, else the settings or the geometry."""
        first = self._samples[scanner].scans[0][1].geometry or self._geometry
        assert first is not None
        mounting = first.tf_tracking_sensor
        if self._format.mounting is not None:
            mounting = self._format.mounting(scanner, self._settings)
            if isfinite(mounting.theta):  # a setting may be any number
                mounting = mounting._replace(theta=wrap_angle(mounting.theta))
        readings = (reading for _, reading in self._samples[scanner].scans)
        stated = [r.tf_tracking_sensor for r in readings if r.tf_tracking_sensor is not None]
        if not stated:
            return mounting
        common = _rigid_mounting(stated)
        if common is not None:
            return common
        self._found.add(
            "warning",
            f"{self.name}: the laser moves against the robot in {scanner} lines (corrected "
            "poses?), so the mounting pose in the log's parameters is used, or else the robot's "
            "centre",
        )
        return mounting

    def _profile(self, scanner: str) -> SensorProfile:
        """Return a scanner's profile, estimated from the sample of its scans."""
        scans = []
        for number, reading in self._samples[scanner].scans:
            if reading.ranges is not None:
                time = float(self._times[number])
                scans.append(self._scan(reading, reading.ranges, time, time))
        profile = profile_sensor(scans, has_odometry=self.num_odometry > 0)
        if len(self._lines_of(scanner)) < 2:
            return profile
        return replace(profile, rate=1.0 / self.time_report.period)

    def _note_what_was_found(self) -> None:
        note_damage(self._found, self._text, len(self._kinds))
        note_times(self._found, self.name, self.time_report)
        if self._format.remark is not None:
            remark = self._format.remark(self._used[0], self.profile.num_beams)
            if remark:
                self._found.add("note", f"{self.name}: {remark}")

    def _no_scans_message(self, fault: str) -> str:
        """Return the message for a file without a single usable scan."""
        if fault:
            return (
                f"{fault}; no scan of this {self.format_name} can be used, check how it was written"
            )
        return (
            f"{self._text.path}: holds no laser scans, though it is a {self.format_name}; "
            "check how it was recorded"
        )


def _rigid_mounting(stated: Sequence[Pose]) -> Pose | None:
    """Return the median of the mounting poses that scans state, None if they differ too much."""
    columns = np.array(stated)
    # Angles near pi must not be averaged across the seam.
    turns = np.array([wrap_angle(theta - stated[0].theta) for theta in columns[:, 2]])
    x, y = (float(value) for value in np.median(columns[:, :2], axis=0))
    turn = float(np.median(turns))
    shifts = np.hypot(columns[:, 0] - x, columns[:, 1] - y)
    if np.quantile(shifts, 0.9) > _MAX_SHIFT_M:
        return None
    if np.quantile(np.abs(turns - turn), 0.9) > _MAX_TURN_RAD:
        return None
    return Pose(x, y, wrap_angle(stated[0].theta + turn))
