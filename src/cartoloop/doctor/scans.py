# SPDX-License-Identifier: Apache-2.0
"""Statistics and checks of the scans of one scanner. One function per check."""

from __future__ import annotations

import math
from array import array
from collections import Counter
from dataclasses import dataclass, field

import numpy as np

from cartoloop.arrays import BoolArray, FloatArray, IntArray
from cartoloop.config import SensorConfig
from cartoloop.doctor.findings import Finding, first_of
from cartoloop.sensor.events import LaserScan, ScanGeometry
from cartoloop.sensor.sensor_profile import SensorProfile

USEFUL_RANGE = SensorConfig().default_max_range
"""Range beyond which returns are not matched [m]."""

MIN_RETURNS = 10
"""Returns below which a scan cannot be matched."""

NARROW_RAD = math.radians(90.0)
"""Field of view below which rotation and translation are hard to distinguish [rad]."""

SPARSE_M = 0.5
"""Mean distance between scans from which on neighbours overlap too little [m]."""

BODY_RANGE_M, BODY_SPREAD_M, BODY_SHARE = 1.0, 0.03, 0.8
"""Beams that measure less than this range [m], constant within this spread [m], in this share of
the scans, hit the robot itself."""

MIN_PATH_M = 3.0
"""Path length that is necessary to distinguish the robot's body from its surroundings [m]."""

BLIND_SHARE = 0.02
"""Share of beams without any return from which on they are reported: some glass is normal."""

OVERLAP_TOLERANCE = 0.02
"""Share of a sweep by which scans may overlap: drivers round the time between beams."""


@dataclass(slots=True)
class Values:
    """Number of ranges of each kind; see REP 117."""

    measured: int = 0
    no_return: int = 0
    too_near: int = 0
    nan: int = 0
    negative: int = 0

    @property
    def total(self) -> int:
        """Number of all ranges."""
        return self.measured + self.no_return + self.too_near + self.nan + self.negative


@dataclass(slots=True)
class ScanWatch:
    """Statistics of the scans of a scanner; memory grows by two numbers per scan.

    Attributes
    ----------
    name : of the scanner.
    stamps, times : of each scan [s].
    num_beams : number of scans by their number of beams.
    num_poor, first_poor : scans with too few returns; stamp of the first.
    num_repeated, first_repeated : scans equal to the one before.
    num_overlapping, first_overlapping : scans that begin before the last one's last beam.
    values : of all beams.
    sweep : time from the first to the last beam [s], 0 if beams have no times.
    nearest, farthest, num_measured : of each beam, over scans of the first one's length.
    """

    name: str
    stamps: array[float] = field(default_factory=lambda: array("d"))
    times: array[float] = field(default_factory=lambda: array("d"))
    num_beams: Counter[int] = field(default_factory=Counter)
    num_poor: int = 0
    first_poor: float | None = None
    num_repeated: int = 0
    first_repeated: float | None = None
    num_overlapping: int = 0
    first_overlapping: float | None = None
    values: Values = field(default_factory=Values)
    sweep: float = 0.0
    geometry: ScanGeometry | None = None
    nearest: FloatArray = field(default_factory=lambda: np.zeros(0))
    farthest: FloatArray = field(default_factory=lambda: np.zeros(0))
    num_measured: IntArray = field(default_factory=lambda: np.zeros(0, np.int64))
    _last: bytes = b""
    _last_end: float = -math.inf

    def add(self, scan: LaserScan) -> None:
        """Add a scan."""
        geometry, ranges = scan.geometry, scan.ranges
        if self.geometry is None:
            self.geometry = geometry
            self.nearest = np.full(len(ranges), np.inf)
            self.farthest = np.zeros(len(ranges))
            self.num_measured = np.zeros(len(ranges), np.int64)
        self.stamps.append(scan.stamp)
        self.times.append(scan.time)
        self.num_beams[len(ranges)] += 1
        measured = (ranges >= geometry.range_min) & (ranges < geometry.range_max)
        num_returns = int(np.count_nonzero(measured))
        self._count(ranges, geometry, num_returns)
        if np.count_nonzero(measured & (ranges <= USEFUL_RANGE)) < MIN_RETURNS:
            self.num_poor += 1
            self.first_poor = first_of(self.first_poor, scan.stamp)
        if len(ranges) == len(self.nearest):
            self.num_measured += measured
            np.minimum(self.nearest, ranges, out=self.nearest, where=measured)
            np.maximum(self.farthest, ranges, out=self.farthest, where=measured)
        self._compare_with_last(scan, num_returns)

    def _count(self, ranges: FloatArray, geometry: ScanGeometry, num_returns: int) -> None:
        values = self.values
        no_return = int(np.count_nonzero(ranges >= geometry.range_max))
        negative = int(np.count_nonzero(ranges < 0.0))
        nan = int(np.count_nonzero(np.isnan(ranges)))
        values.measured += num_returns
        values.no_return += no_return
        values.negative += negative
        values.nan += nan
        values.too_near += len(ranges) - num_returns - no_return - negative - nan

    def _compare_with_last(self, scan: LaserScan, num_returns: int) -> None:
        content = scan.ranges.tobytes()
        # Scans without returns are equal without anything being wrong.
        if content == self._last and num_returns >= MIN_RETURNS:
            self.num_repeated += 1
            self.first_repeated = first_of(self.first_repeated, scan.stamp)
        self._last = content
        sweep = abs(scan.geometry.time_increment) * (len(scan.ranges) - 1)
        self.sweep = max(self.sweep, sweep)
        if sweep > 0.0 and scan.stamp < self._last_end:
            self.num_overlapping += 1
            self.first_overlapping = first_of(self.first_overlapping, scan.stamp)
        self._last_end = scan.stamp + (1.0 - OVERLAP_TOLERANCE) * sweep

    @property
    def count(self) -> int:
        """Number of scans."""
        return len(self.stamps)


def check_scans(watch: ScanWatch, profile: SensorProfile | None, path_m: float) -> list[Finding]:
    """Return the problems of a scanner's scans.

    Parameters
    ----------
    path_m : path length of the odometry [m].
    """
    found = [
        check_returns(watch),
        check_repeated(watch),
        check_overlap(watch),
        check_beam_count(watch),
        check_blind_beams(watch),
        check_own_body(watch, path_m),
        check_spacing(watch, path_m),
    ]
    if profile is not None:
        found += [check_field_of_view(watch, profile), check_no_return(watch, profile)]
    return [finding for finding in found if finding is not None]


def check_returns(watch: ScanWatch) -> Finding | None:
    """Scans with too few returns to be matched."""
    if not watch.num_poor:
        return None
    if watch.num_poor == watch.count:
        return Finding(
            "error",
            "no_returns",
            f"no scan has {MIN_RETURNS} returns within {USEFUL_RANGE:g} m: nothing to map",
            "check the scanner, and its range limits in the recording; ranges must be in metres",
            watch.name,
            watch.num_poor,
            watch.first_poor,
        )
    share = watch.num_poor / watch.count
    return Finding(
        "warning" if share > 0.01 else "info",
        "few_returns",
        f"{watch.num_poor} of {watch.count} scans have fewer than {MIN_RETURNS} returns",
        "their poses are predicted; keep walls within the scanner's range",
        watch.name,
        watch.num_poor,
        watch.first_poor,
    )


def check_repeated(watch: ScanWatch) -> Finding | None:
    """Identical ranges in consecutive scans."""
    if not watch.num_repeated:
        return None
    share = watch.num_repeated / max(watch.count, 1)
    return Finding(
        "warning" if share > 0.01 else "info",
        "repeated_scans",
        f"{watch.num_repeated} scans hold exactly the ranges of the scan before",
        "record the driver's own topic; if the robot moved meanwhile, scans were lost",
        watch.name,
        watch.num_repeated,
        watch.first_repeated,
    )


def check_overlap(watch: ScanWatch) -> Finding | None:
    """Scans that begin before the previous one has ended."""
    if not watch.num_overlapping:
        return None
    return Finding(
        "warning",
        "overlapping_scans",
        f"{watch.num_overlapping} scans begin before the last beam of the one before: stamps or "
        f"time_increment (a sweep of {watch.sweep:.4g} s) are wrong",
        "let the driver stamp the first beam, and publish the true time between beams",
        watch.name,
        watch.num_overlapping,
        watch.first_overlapping,
    )


def check_beam_count(watch: ScanWatch) -> Finding | None:
    """Scans of different length, as cheap scanners send them."""
    if len(watch.num_beams) < 2:
        return None
    usual, count = watch.num_beams.most_common(1)[0]
    low, high = min(watch.num_beams), max(watch.num_beams)
    return Finding(
        "info",
        "beam_count_changes",
        f"the number of beams changes from {low} to {high}; {count} scans have {usual}",
        "each scan is taken as it is",
        watch.name,
        watch.count - count,
    )


def check_blind_beams(watch: ScanWatch) -> Finding | None:
    """Beams that never measure anything."""
    blind = watch.num_measured == 0
    num_blind = int(np.count_nonzero(blind))
    if watch.count < 10 or num_blind == len(blind) or num_blind <= BLIND_SHARE * len(blind):
        return None
    return Finding(
        "info",
        "blind_beams",
        f"{num_blind} of {len(blind)} beams never measure anything ({_sectors(blind, watch)})",
        "something covers the scanner there, or its driver cuts them off",
        watch.name,
        num_blind,
    )


def check_own_body(watch: ScanWatch, path_m: float) -> Finding | None:
    """Beams with the same short range while the robot moves: they hit the robot."""
    if path_m < MIN_PATH_M:
        return None
    always = watch.num_measured > BODY_SHARE * watch.count
    steady = watch.farthest - watch.nearest < BODY_SPREAD_M
    body = always & steady & (watch.farthest < BODY_RANGE_M)
    num_body = int(np.count_nonzero(body))
    if num_body == 0:
        return None
    reach = float(watch.farthest[body].max())
    return Finding(
        "warning",
        "own_body",
        f"{num_body} beams always measure the same within {reach:.2f} m ({_sectors(body, watch)}): "
        "a part of the robot",
        f"give --set sensor.min_range={reach + 0.05:.2f}, or cut these beams off in the driver",
        watch.name,
        num_body,
    )


def check_spacing(watch: ScanWatch, path_m: float) -> Finding | None:
    """Scans too far apart to overlap well."""
    spacing = path_m / max(watch.count - 1, 1)
    if watch.count < 2 or spacing <= SPARSE_M:
        return None
    return Finding(
        "warning",
        "sparse_scans",
        f"scans are {spacing:.2f} m apart on average: neighbours overlap little",
        "record every scan; without good odometry such a recording is hard to map",
        watch.name,
        watch.count,
    )


def check_field_of_view(watch: ScanWatch, profile: SensorProfile) -> Finding | None:
    """A field of view too narrow to distinguish rotation from translation."""
    if profile.field_of_view >= NARROW_RAD:
        return None
    return Finding(
        "warning",
        "narrow_view",
        f"the scanner sees only {math.degrees(profile.field_of_view):.0f} degrees",
        "record odometry or an IMU along with it, and turn slowly",
        watch.name,
        watch.count,
    )


def check_no_return(watch: ScanWatch, profile: SensorProfile) -> Finding | None:
    """Whether the value of a beam without a return is known."""
    if profile.no_return is None and not math.isfinite(profile.range_max):
        return Finding(
            "info",
            "no_range_end",
            "no value stands for 'no return', and no greatest range was seen",
            "all ranges count; give --set sensor.max_range=METRES if far ones are wrong",
            watch.name,
        )
    if profile.no_return == 0.0:
        return Finding(
            "info",
            "no_return_is_zero",
            f"{100 * profile.share_no_return:.0f}% of beams send 0: no return, or an error",
            "they do not clear free space, since both are possible",
            watch.name,
        )
    return None


def _sectors(mask: BoolArray, watch: ScanWatch) -> str:
    """Return the widest sectors of the masked beams [deg]."""
    if watch.geometry is None:
        return "all"
    angles = np.degrees(watch.geometry.angle_min) + np.degrees(
        watch.geometry.angle_increment
    ) * np.arange(len(mask))
    edges = np.flatnonzero(np.diff(np.concatenate(([0], mask.astype(np.int8), [0]))))
    sectors = sorted(
        zip(edges[::2].tolist(), (edges[1::2] - 1).tolist(), strict=True),
        key=lambda sector: sector[0] - sector[1],
    )
    shown = [f"{angles[a]:.0f} to {angles[b]:.0f} deg" for a, b in sectors[:3]]
    return ", ".join(shown) + (", ..." if len(sectors) > 3 else "")
