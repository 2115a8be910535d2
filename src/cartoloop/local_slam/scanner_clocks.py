# SPDX-License-Identifier: Apache-2.0
"""Offsets between the clocks of several scanners, from the motion between their scans.

A scan of a further scanner is matched where the robot was when it was measured. If its clock is
late, that is ahead of where the reference scanner saw the robot at the scan's time: by the offset
times the velocity, along the motion and in the turn.
"""

from __future__ import annotations

import math
from array import array
from bisect import bisect_left
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from cartoloop.arrays import FloatArray
from cartoloop.local_slam.clock_offset import (
    FIRST_ESTIMATE,
    MIN_LOG_ODDS,
    log_likelihood,
    next_estimate,
    refined_minimum,
)
from cartoloop.sensor.pose import Pose, relative_all

SCANNER_OFFSETS_S: FloatArray = np.arange(-25.0, 26.0) * 0.02
"""Clock offsets tried [s]: buffers and transport delay scans by some tenths of a second."""

WINDOW = 600
"""Number of latest scans of a scanner that are used: a minute or some."""

MAX_REFERENCE = 6000
"""Number of latest scans of the reference scanner that are kept: it may be much faster."""

MAX_GAP_S = 0.5
"""Longest time between two scans of the reference scanner across which it shows the motion [s]."""

MIN_SCANS = 40
"""Least number of scans between those of the reference scanner."""

POSITION_SIGMA, HEADING_SIGMA = 0.015, 0.003
"""Errors of a matched pose [m], [rad]: weights of position and heading."""


@dataclass(slots=True)
class _Series:
    """The scans of one scanner: times by its own clock, poses, offset, and when it is due.

    Packed, since there may be many: the numbers of all poses are in one array.
    """

    times: array[float] = field(default_factory=lambda: array("d"))
    poses: array[float] = field(default_factory=lambda: array("d"))
    offset: float = 0.0
    num_scans: int = 0
    due: int = FIRST_ESTIMATE

    def drop(self, count: int) -> None:
        """Drop the oldest scans."""
        if count > 0:
            del self.times[:count], self.poses[: 3 * count]

    def rows(self, first: int = 0) -> tuple[FloatArray, FloatArray]:
        """Return times and poses from a scan on, shapes (n,), (n, 3)."""
        return np.array(self.times[first:]), np.array(self.poses[3 * first :]).reshape(-1, 3)


class ScannerClocks:
    """Estimates the clock offset of each scanner against the first one.

    Parameters
    ----------
    offsets : what is known before, by name [s].
    """

    def __init__(self, offsets: Mapping[str, float] | None = None) -> None:
        self._series: dict[str, _Series] = {}
        self._reference = ""
        self._known = dict(offsets or {})

    @property
    def offsets(self) -> dict[str, float]:
        """By name: scans show the robot this much later than those of the first scanner [s]."""
        return {name: series.offset for name, series in self._series.items()}

    def offset_of(self, scanner: str) -> float:
        """Return the offset of a scanner [s], 0 for the first and for a new one."""
        series = self._series.get(scanner)
        if series is None:
            series = self._series[scanner] = _Series()
            self._reference = self._reference or scanner
            if scanner != self._reference:
                series.offset = self._known.get(scanner, 0.0)
        return series.offset

    def add(self, scanner: str, time: float, tf_local_tracking: Pose) -> float:
        """Add the matched pose of a scan; return by how much the scanner's offset changes [s].

        Parameters
        ----------
        scanner, time : its name, and its time with the offset [s].
        tf_local_tracking : its pose.
        """
        offset = self.offset_of(scanner)
        series = self._series[scanner]
        series.times.append(time - offset)
        series.poses.extend(tf_local_tracking)
        series.num_scans += 1
        if scanner == self._reference:
            if len(series.times) >= 2 * MAX_REFERENCE:
                series.drop(MAX_REFERENCE)
            return 0.0
        if series.num_scans < series.due:
            return 0.0
        series.due = next_estimate(series.num_scans)
        series.drop(len(series.times) - WINDOW)
        reference = self._series[self._reference]
        first = bisect_left(reference.times, series.times[0] - 1.0)
        found = scanner_offset(*series.rows(), *reference.rows(first))
        if found is not None:
            series.offset = found
        return series.offset - offset


def scanner_offset(
    times: FloatArray, poses: FloatArray, reference_times: FloatArray, reference_poses: FloatArray
) -> float | None:
    """Return the clock offset of a scanner [s]; 0 unless it is better than none; None if unknown.

    Parameters
    ----------
    times, poses : float64, shapes (n,), (n, 3): its scans.
    reference_times, reference_poses : float64, shapes (k,), (k, 3): those of the reference.

    Notes
    -----
    Constant differences of the poses are errors of the mounting, and do not count.
    """
    if len(reference_times) < 2:
        return None
    reach = float(SCANNER_OFFSETS_S[-1])
    after = np.searchsorted(reference_times, times)
    inside = (times - reach > reference_times[0]) & (times + reach < reference_times[-1])
    after = np.clip(after, 1, len(reference_times) - 1)
    inside &= reference_times[after] - reference_times[after - 1] < MAX_GAP_S
    if np.count_nonzero(inside) < MIN_SCANS:
        return None
    heading = np.unwrap(reference_poses[:, 2])
    columns = (reference_poses[:, 0], reference_poses[:, 1], heading)

    def errors(offset: float) -> FloatArray:
        at = times[inside] + offset
        seen = np.column_stack([np.interp(at, reference_times, column) for column in columns])
        apart = relative_all(seen, poses[inside])
        apart -= np.median(apart, axis=0)
        apart /= (POSITION_SIGMA, POSITION_SIGMA, HEADING_SIGMA)
        return apart.ravel()

    costs = np.array([-log_likelihood(errors(offset)) for offset in SCANNER_OFFSETS_S.tolist()])
    best = int(np.argmin(costs))
    gain = 0.5 * (-log_likelihood(errors(0.0)) - costs[best])
    if gain <= MIN_LOG_ODDS + math.log(len(costs)):
        return 0.0
    return refined_minimum(SCANNER_OFFSETS_S, costs, best)
