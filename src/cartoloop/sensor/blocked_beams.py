# SPDX-License-Identifier: Apache-2.0
"""Beams that never have a return: part of the robot is in front of them, or a filter drops them.

Drivers report such a sector as without a return. Taken for free space, it would clear the walls
that the robot passes. Isolated returns, of dust or noise, do not show that a beam sees anything.
"""

from __future__ import annotations

import numpy as np

from cartoloop.arrays import FloatArray, IntArray
from cartoloop.kernels.near_neighbours import count_and_hide
from cartoloop.sensor.isolated_returns import NEAR_M, NEAR_SPACINGS

MIN_SCANS = 200
"""Scans before a beam counts as blocked: in fewer, it may always have looked along a corridor."""

MIN_SHARE = 0.005
"""A beam with returns, isolated ones apart, in no more of the scans after these is blocked: so rare
are reflections inside a robot."""


class BlockedBeams:
    """Counts the returns of each beam of one scanner.

    Parameters
    ----------
    num_beams : of each of its scans.
    step : angle between two beams [rad].
    """

    def __init__(self, num_beams: int, step: float) -> None:
        self._step = abs(step)
        self._num_scans = 0
        self._num_returns: IntArray = np.zeros(num_beams, dtype=np.int64)

    def apply(self, ranges: FloatArray, min_range: float, no_return_range: float) -> FloatArray:
        """Count the returns of a scan; return it with NaN where blocked beams have none.

        Parameters
        ----------
        ranges : float64, shape (num_beams,) [m].
        min_range, no_return_range : a range in [min_range, no_return_range) is a return [m].
        """
        self._num_scans += 1
        slope = NEAR_SPACINGS * self._step
        most = MIN_SHARE * (self._num_scans - MIN_SCANS)
        hidden = np.empty(len(ranges))
        fewest = count_and_hide(
            ranges, min_range, no_return_range, NEAR_M, slope, most, self._num_returns, hidden
        )
        return ranges if most < fewest else hidden
