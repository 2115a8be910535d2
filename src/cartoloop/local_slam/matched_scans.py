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
    """The scans of one scanner, and whether the step to each is used; not that to the first."""

    times: list[float] = field(default_factory=list)
    poses: list[Pose] = field(default_factory=list)
    is_usable: list[bool] = field(default_factory=list)

    def cut(self, window: int) -> None:
        """Drop all but the latest scans."""
        del self.times[:-window], self.poses[:-window], self.is_usable[:-window]
        self.is_usable[0] = False


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
    with_faulty : whether steps that are not used count as usable.
    """
    every = [(one.times[-window:], one.poses[-window:], one.is_usable[-window:]) for one in series]
    is_usable = [np.array(usable, dtype=np.bool_) | with_faulty for _, _, usable in every]
    for one in is_usable:
        one[0] = False
    return MatchedScans(
        np.concatenate([np.array(times) for times, _, _ in every]),
        np.concatenate([pose_rows(poses) for _, poses, _ in every]),
        np.concatenate(is_usable),
    )
