# SPDX-License-Identifier: Apache-2.0
"""The latest scans as matched, from which a calibration is estimated."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from cartoloop.arrays import BoolArray, FloatArray
from cartoloop.sensor.pose import Pose, pose_rows


@dataclass(slots=True)
class ScanSeries:
    """The scans of one scanner, and whether the step to each is used; not that to the first.

    A pose that was not matched follows the odometry, and would confirm any calibration.
    """

    times: list[float] = field(default_factory=list)
    poses: list[Pose] = field(default_factory=list)
    is_usable: list[bool] = field(default_factory=list)
    is_matched: list[bool] = field(default_factory=list)

    def cut(self, window: int) -> None:
        """Drop all but the latest scans."""
        del self.times[:-window], self.poses[:-window]
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
        np.concatenate([pose_rows(one.poses[-window:]) for one in every]),
        np.concatenate([one.steps(window, with_faulty=with_faulty) for one in every]),
    )
