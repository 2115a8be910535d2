# SPDX-License-Identifier: Apache-2.0
"""Any text recording that tells one thing a line: three functions say how, the rest is done here.

The three are a `LineFormat`; docs/readers.md shows how to write them.
"""

from __future__ import annotations

import math
from array import array
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cartoloop.errors import InputError
from cartoloop.readers.carmen_index import ScanSample
from cartoloop.readers.carmen_lines import LineError
from cartoloop.readers.line_times import line_times, note_damage, note_times
from cartoloop.readers.log import Problems, TellsProblems
from cartoloop.readers.source import Source
from cartoloop.sensor.events import LaserScan, Odometry, ScanGeometry, SensorEvent
from cartoloop.sensor.pose import Pose
from cartoloop.sensor.sensor_profile import SensorProfile, profile_sensor
from cartoloop.sensor.time_repair import TimeReport

__all__ = ["LineError", "LineFormat", "LineLog", "Reading", "head_of"]

FloatArray = NDArray[np.float64]

_HEAD_LINES = 32
_SILENT, _ODOMETRY, _SCAN = range(3)


class Reading(NamedTuple):
    """What a line says.

    Attributes
    ----------
    stamp : when it was measured [s]; NaN if the line does not tell.
    tf_odom_tracking : pose of the robot by its odometry, or None.
    ranges : float64, shape (num_beams,) [m], or None; NaN, inf, 0 and overlong ones may stay as
        they are.
    geometry : of these ranges, where it is not the recording's.
    """

    stamp: float = math.nan
    tf_odom_tracking: Pose | None = None
    ranges: FloatArray | None = None
    geometry: ScanGeometry | None = None


Parse = Callable[[bytes], Reading | None]
Head = Sequence[bytes]


@dataclass(frozen=True, slots=True)
class LineFormat:
    """How to read a text format. All functions get the first lines of the file.

    Attributes
    ----------
    name : of the format, for the user.
    recognise : tells whether a file is of this format.
    geometry : tells where the beams look and where the scanner sits; a scan with another number
        of beams is taken to begin at the same angle. Raises `LineError` if that cannot be told.
    parser : returns the function that reads a line: a `Reading`, or None where the line says
        nothing; it raises `LineError` if the line is damaged. It is called anew for each pass, so
        that the function may remember what lines before have told.
    """

    name: str
    recognise: Callable[[Head], bool]
    geometry: Callable[[Head], ScanGeometry]
    parser: Callable[[Head], Parse]


def head_of(source: Source) -> list[bytes]:
    """Return the first lines of a text, by which formats are recognised."""
    return list(islice(source.lines(), _HEAD_LINES))


class LineLog(TellsProblems):
    """A text recording; see `cartoloop.readers.log.Log` for what it offers.

    Parameters
    ----------
    source : the file, plain or gzip, or its path.
    line_format : how to read it.
    laser_pose : where the scanner sits on the robot, if the log is not to be asked.

    Attributes
    ----------
    format_name : what kind of recording it is.
    num_odometry : how many readings of the odometry there are.

    Raises
    ------
    InputError
        If the file cannot be read, or holds no usable scan.
    """

    def __init__(
        self,
        source: Source | str | Path,
        line_format: LineFormat,
        *,
        laser_pose: Pose | None = None,
    ) -> None:
        self._source = source if isinstance(source, Source) else Source(source)
        self.name = self._source.name
        self.format_name = line_format.name
        self._format = line_format
        self._head = head_of(self._source)
        self._found = Problems()  # while opening; does not change any more
        try:
            geometry = line_format.geometry(self._head)
        except LineError as error:
            raise InputError(f"{self._source.path}: {error}") from None
        if laser_pose is not None:
            geometry = replace(geometry, tf_tracking_sensor=laser_pose)
        self._geometry = geometry
        self._geometries: dict[tuple[ScanGeometry, int], ScanGeometry] = {}
        self._profile: SensorProfile | None = None
        self.num_scans = self.num_odometry = 0
        self._index()
        self.profile: SensorProfile = self._read_profile()
        self._profile = self.profile
        self._geometries.clear()  # those without the profile
        note_damage(self._found, self._source, len(self._kinds))
        note_times(self._found, self.name, self.time_report)
        self._current = self._found

    @property
    def description(self) -> str:
        """What is in it: some lines for the user."""
        return self.profile.describe()

    @property
    def profiles(self) -> dict[str, SensorProfile]:
        """The profile of the one scanner, by its name."""
        return {self._geometry.sensor: self.profile}

    @property
    def duration(self) -> float:
        """Repaired time from the first to the last event [s]."""
        finite = self._times[np.isfinite(self._times)]
        return float(finite[-1] - finite[0])

    def __iter__(self) -> Iterator[SensorEvent]:
        """Yield the events in file order; bad lines are skipped and counted."""
        current = self._current = self._found.copy()
        times = self._times.tolist()
        for number, reading in self._readings(current):
            time = times[number]
            stamp = time if math.isnan(reading.stamp) else reading.stamp
            if reading.tf_odom_tracking is not None:
                yield Odometry(stamp, time, reading.tf_odom_tracking)
            if reading.ranges is not None:
                yield self._scan(reading, stamp, time)

    def _scan(self, reading: Reading, stamp: float, time: float) -> LaserScan:
        ranges = np.zeros(0) if reading.ranges is None else reading.ranges
        own = self._geometry if reading.geometry is None else reading.geometry
        geometry = self._geometries.get((own, len(ranges)))
        if geometry is None:
            # Where the scanner sits, the log as a whole tells.
            geometry = replace(
                own,
                num_beams=len(ranges),
                tf_tracking_sensor=self._geometry.tf_tracking_sensor,
                sensor=self._geometry.sensor,
            )
            geometry = self._profile.apply(geometry) if self._profile else geometry
            self._geometries[own, len(ranges)] = geometry
        return LaserScan(stamp, time, ranges, geometry)

    def _readings(self, problems: Problems) -> Iterator[tuple[int, Reading]]:
        """Yield the index of each line that says something, and what."""
        parse = self._format.parser(self._head)
        for number, line in enumerate(self._source.lines()):
            try:
                reading = parse(line)
                if reading is None:
                    continue
                _check(reading)
            except LineError as error:
                problems.skip(error.reason, f"{self.name}:{number + 1}: {error}")
                continue
            yield number, reading

    def _index(self) -> None:
        """Read the file through: the time of each line, and some scans."""
        kinds, stamps = bytearray(), array("d")
        self._sample: ScanSample[Reading] = ScanSample()
        for number, reading in self._readings(Problems()):
            silent = number - len(kinds)
            kinds.extend(bytes([_SILENT]) * silent)
            stamps.extend([math.nan] * silent)
            is_scan = reading.ranges is not None
            kinds.append(_SCAN if is_scan else _ODOMETRY)
            stamps.append(reading.stamp if math.isfinite(reading.stamp) else math.nan)
            self.num_odometry += reading.tf_odom_tracking is not None
            if is_scan:
                self._sample.offer(number, reading)
        self._kinds = np.frombuffer(bytes(kinds), np.uint8)
        scans = np.flatnonzero(self._kinds == _SCAN)
        if not len(scans):
            raise InputError(self._why_no_scans())
        self.num_scans = len(scans)
        odometry = np.flatnonzero(self._kinds == _ODOMETRY)
        self.time_report: TimeReport
        self._times, self.time_report = line_times(np.array(stamps), [scans], odometry)

    def _read_profile(self) -> SensorProfile:
        scans = []
        for number, reading in self._sample.lines:
            time = float(self._times[number])
            scans.append(self._scan(reading, time, time))
        profile = profile_sensor(scans, has_odometry=self.num_odometry > 0)
        del self._sample
        return replace(profile, rate=1.0 / self.time_report.period) if len(scans) > 1 else profile

    def _why_no_scans(self) -> str:
        """Return the message for a file without a single usable scan."""
        faults = Problems()
        for _ in self._readings(faults):
            pass
        what = f"no scan of this {self.format_name} can be used"
        if faults.kept:
            return f"{faults.kept[0].message}; {what}, check how it was written"
        return f"{self._source.path}: holds no scan; {what}, check how it was written"


def _check(reading: Reading) -> None:
    pose, ranges = reading.tf_odom_tracking, reading.ranges
    if pose is not None and not all(map(math.isfinite, pose)):
        raise LineError("pose not finite", "a number of the pose is NaN or infinite")
    if ranges is not None and len(ranges) == 0:
        raise LineError("scan without ranges", "the scan has no ranges")
