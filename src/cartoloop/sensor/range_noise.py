# SPDX-License-Identifier: Apache-2.0
"""Noise that grows with the range, as cheap scanners have it, and up to where returns are useful.

Far returns of such scanners smear the walls of submaps, which near ones show well.
"""

from __future__ import annotations

import math

import numpy as np

from cartoloop.arrays import BoolArray, FloatArray

NEAR_M, FAR_M = (1.0, 2.0), (4.0, 8.0)
"""Ranges at which the noise is measured [m]: where scanners measure best, and where most of the
walls are that help."""

EVERY_NTH_SCAN, MIN_SAMPLES = 5, 2000
"""One in five scans is measured, until there is this number of samples at both ranges."""

MIN_SHARE, MAX_RATIO = 0.0125, 2.0
"""Noise of this share of the range or more limits the range, if the share is not larger by more
than the second near the scanner: other noise, and bushes, do not grow with the range. Good
scanners measure to 0.3 to 0.8% at these ranges."""

MAX_NOISE_M = 0.15
"""Returns are useful up to where the noise has this standard deviation [m], three pixels."""

EDGE_M, EDGE_SHARE = 0.3, 0.1
"""Neighbouring ranges further apart than the first [m] and this share of them are not of one wall.
"""

SHORTEST_M = 0.1
"""Shorter ranges have no reciprocal that means anything [m]."""

MEDIAN_OF_NORMAL = 0.6745
"""Median of the absolute value of a normal variable with a standard deviation of 1."""


class RangeNoise:
    """Measures the noise of one scanner, until it is known.

    Parameters
    ----------
    step : angle between two beams [rad].

    Attributes
    ----------
    useful_range : returns farther away are too noisy [m]; infinite as long as that is not known.
    share : standard deviation of the ranges as a share of them; 0 where nothing limits the range.
    """

    def __init__(self, step: float) -> None:
        self.useful_range = math.inf
        self.share = 0.0
        self._step = step
        self._num_scans = 0
        self._near, self._far = _Samples(NEAR_M), _Samples(FAR_M)
        self._is_known = False

    def add(self, ranges: FloatArray, min_range: float, no_return_range: float) -> None:
        """Measure the noise of a scan, if it is not known yet.

        Parameters
        ----------
        ranges : float64, shape (num_beams,) [m].
        min_range, no_return_range : a range in [min_range, no_return_range) is a return [m].
        """
        if self._is_known:
            return
        self._num_scans += 1
        if self._num_scans % EVERY_NTH_SCAN:
            return
        is_return = (ranges >= max(min_range, SHORTEST_M)) & (ranges < no_return_range)
        middle, shares = noise_shares(np.where(is_return, ranges, np.nan), self._step)
        self._near.add(middle, shares)
        self._far.add(middle, shares)
        self._is_known = self._near.are_enough and self._far.are_enough
        if self._is_known:
            near, far = self._near.median, self._far.median
            if far >= MIN_SHARE and near <= MAX_RATIO * far:
                self.useful_range, self.share = MAX_NOISE_M / far, far


class _Samples:
    """Samples of the noise within some ranges [m], until there are enough."""

    def __init__(self, ranges: tuple[float, float]) -> None:
        self._first, self._last = ranges
        self._shares: list[FloatArray] = []
        self._count = 0

    @property
    def are_enough(self) -> bool:
        return self._count >= MIN_SAMPLES

    @property
    def median(self) -> float:
        return float(np.median(np.concatenate(self._shares)))

    def add(self, middle: FloatArray, shares: FloatArray) -> None:
        """Add those of a scan."""
        chosen = shares[(middle >= self._first) & (middle < self._last)]
        if len(chosen) and not self.are_enough:
            self._shares.append(chosen)
            self._count += len(chosen)


def noise_shares(ranges: FloatArray, step: float) -> tuple[FloatArray, FloatArray]:
    """Return ranges on walls, and samples of their noise as a share of them, shapes (k,).

    The median of the samples is the standard deviation.

    Parameters
    ----------
    ranges : float64, shape (n,), NaN without a return [m].
    step : angle between two beams [rad].

    Notes
    -----
    On a straight wall the reciprocal u of the range is a sinusoid of the angle, so that of three
    neighbours u[i-1] + u[i+1] - 2 cos(step) u[i] is 0, and otherwise the noise of all three.
    """
    before, middle, after = ranges[:-2], ranges[1:-1], ranges[2:]
    limit = EDGE_M + EDGE_SHARE * middle
    # NaN is near to none
    is_wall: BoolArray = (np.abs(before - middle) <= limit) & (np.abs(after - middle) <= limit)
    before, middle, after = before[is_wall], middle[is_wall], after[is_wall]
    cos = math.cos(step)
    apart = np.abs(1.0 / before + 1.0 / after - 2.0 * cos / middle) * middle
    return middle, apart / (MEDIAN_OF_NORMAL * math.sqrt(2.0 + 4.0 * cos**2))
