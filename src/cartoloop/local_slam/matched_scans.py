# SPDX-License-Identifier: Apache-2.0
"""The latest scans as matched, from which a calibration is estimated."""

from __future__ import annotations

from array import array
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from cartoloop.arrays import BoolArray, FloatArray
from cartoloop.sensor.pose import Pose


@dataclass(slots=True)
class ScanSeries:
    """The scans of one scanner, and whether the step to each is used; not that to the first.

    A pose that was not matched follows the odometry, and would confirm any calibration.

    Attributes
    ----------
    times : of the scans [s].
    poses : x, y [m] and theta [rad] of each, one after the other.
    is_usable, is_matched : of each.
    """

    times: array[float] = field(default_factory=lambda: array("d"))
    poses: array[float] = field(default_factory=lambda: array("d"))
    is_usable: list[bool] = field(default_factory=list)
    is_matched: list[bool] = field(default_factory=list)

    def add(self, time: float, pose: Pose, *, is_matched: bool) -> None:
        """Add a scan; the step to it is used unless it is the first."""
        self.times.append(time)
        self.poses.extend(pose)
        self.is_usable.append(bool(self.is_usable))
        self.is_matched.append(is_matched)

    def leave_out(self, count: int) -> None:
        """Do not use a number of the latest steps."""
        self.is_usable[-count:] = [False] * min(count, len(self.is_usable))

    def shift(self, by: float) -> None:
        """Correct the times so far [s]."""
        self.times = array("d", (time + by for time in self.times))

    def cut(self, window: int) -> None:
        """Drop all but the latest scans."""
        del self.times[:-window], self.poses[: -3 * window]
        del self.is_usable[:-window], self.is_matched[:-window]
        self.is_usable[0] = False

    def steps(self, window: int, *, with_faulty: bool) -> BoolArray:
        """Return which steps to the latest scans are used, as :func:`latest` does."""
        matched = np.array(self.is_matched[-window:])
        usable = np.array(self.is_usable[-window:]) | with_faulty
        usable[0] = False
        usable[1:] &= matched[1:] & matched[:-1]
        return usable


class MatchedScans(NamedTuple):
    """Scans of all scanners, one scanner after the other.

    Attributes
    ----------
    times, poses : float64, shapes (n,), (n, 3).
    is_usable : shape (n,), whether the step to each scan is used; not that to a scanner's first.
    """

    times: FloatArray
    poses: FloatArray
    is_usable: BoolArray


def latest(series: Iterable[ScanSeries], window: int, *, with_faulty: bool = False) -> MatchedScans:
    """Return the latest scans of each scanner; each has some.

    Parameters
    ----------
    with_faulty : whether steps count as usable that are not used since the odometry was faulty.
    """
    every = list(series)
    return MatchedScans(
        np.concatenate([np.array(one.times[-window:]) for one in every]),
        np.concatenate([np.array(one.poses[-3 * window :]).reshape(-1, 3) for one in every]),
        np.concatenate([one.steps(window, with_faulty=with_faulty) for one in every]),
    )
