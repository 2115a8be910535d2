# SPDX-License-Identifier: Apache-2.0
"""The noise of a scanner's ranges, and up to where its returns are useful.

Far returns of cheap scanners, whose noise grows with the range, smear the walls of submaps, which
near ones show well.
"""

from __future__ import annotations

import itertools
import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from cartoloop.arrays import BoolArray, FloatArray

WINDOW = 7
"""Number of neighbouring returns to which a straight wall is fitted."""

QUANTILE, QUANTILE_OF_MEAN = 0.25, 0.5349
"""The noise is this quantile of the mean squared residuals, which is so much of their mean where
all are of walls (chi-squared with `WINDOW` - 2 degrees of freedom). Corners and what stands about
have larger ones."""

MAX_SLOPE = 1.0
"""Tangent of the steepest angle of incidence at which a wall shows the noise of a range."""

BANDS_M = (0.5, 1.0, 2.0, 4.0, 8.0, 16.0)
"""Limits of the bands of ranges in which the noise is measured [m]."""

MIN_SAMPLES = 200
"""Number of samples from which the noise in a band is known."""

ALL_UNTIL, EVERY_NTH_SCAN = 20, 5
"""The first scans are all measured, then one in five."""

TOGETHER = 10
"""Number of scans that are measured together, for a fraction of the time that each takes alone."""

ESTIMATED_AFTER = (10, 40, 160, 320)
"""Numbers of measured scans, each a multiple of `TOGETHER`, after which the noise is estimated, the
last time for good."""

MIN_NOISE_M = 0.015
"""A scanner with this noise or more at the median range is noisy [m]: that of others is lost in a
pixel. More than `MAX_NOISE_M` is none of a scanner: no walls are in sight, but bushes."""

MIN_SHARE = 0.0125
"""Noise that grows by this share of the range or more limits the range. Good scanners measure to
0.3 to 0.8%."""

MAX_NOISE_M = 0.15
"""Returns are useful up to where the noise has this standard deviation [m], three pixels."""

EDGE_M, EDGE_SHARE = 0.3, 0.1
"""Neighbouring ranges further apart than the first [m] and this share of them are not of one wall.
"""

SHORTEST_M = 0.1
"""Shorter ranges have no reciprocal that means anything [m]."""


class Noise(NamedTuple):
    """Standard deviation of the ranges of a scanner: the root of the sum of two squares.

    Attributes
    ----------
    constant : the same at all ranges [m].
    share : grows with the range, as a share of it.
    """

    constant: float = 0.0
    share: float = 0.0

    def at(self, ranges: FloatArray) -> FloatArray:
        """Return the standard deviations of ranges [m], any shape."""
        return np.hypot(self.constant, self.share * ranges)


NO_NOISE = Noise()


def no_noise() -> float:
    """Return the noise of a scanner that is not noisy [m]."""
    return 0.0


class RangeNoise:
    """Measures the noise of one scanner, until it is known.

    Parameters
    ----------
    step : angle between two beams [rad].

    Attributes
    ----------
    noise : as estimated so far, if the scanner is noisy; otherwise none.
    useful_range : returns farther away are too noisy [m]; infinite as long as that is not known.
    """

    def __init__(self, step: float) -> None:
        self.noise = NO_NOISE
        self.useful_range = math.inf
        self._step = step
        self._num_scans = self._num_measured = 0
        self._waiting: list[FloatArray] = []
        self._ranges: list[FloatArray] = []
        self._variances: list[FloatArray] = []

    @property
    def _is_known(self) -> bool:
        return self._num_measured >= ESTIMATED_AFTER[-1]

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
        if self._num_scans > ALL_UNTIL and self._num_scans % EVERY_NTH_SCAN:
            return
        is_return = (ranges >= max(min_range, SHORTEST_M)) & (ranges < no_return_range)
        self._waiting.append(np.where(is_return, ranges, np.nan))
        if len(self._waiting) < TOGETHER:
            return
        middle, variances = wall_residuals(np.stack(self._waiting), self._step)
        self._waiting.clear()
        self._ranges.append(middle)
        self._variances.append(variances)
        self._num_measured += TOGETHER
        if self._num_measured in ESTIMATED_AFTER:
            self._estimate()

    def _estimate(self) -> None:
        ranges, variances = np.concatenate(self._ranges), np.concatenate(self._variances)
        noise = fitted_noise(ranges, variances)
        usual = float(noise.at(np.median(ranges, keepdims=True))[0]) if len(ranges) else 0.0
        self.noise = noise if MIN_NOISE_M <= usual <= MAX_NOISE_M else NO_NOISE
        self.useful_range = math.inf
        if self.noise.share >= MIN_SHARE:
            growth = MAX_NOISE_M**2 - self.noise.constant**2
            self.useful_range = math.sqrt(growth) / self.noise.share
        if self._is_known:
            self._ranges, self._variances = [], []


def fitted_noise(ranges: FloatArray, variances: FloatArray) -> Noise:
    """Return the noise that mean squared residuals of walls show; none where they are too few.

    Parameters
    ----------
    ranges, variances : float64, shapes (n,), as of :func:`wall_residuals`.
    """
    rows = []
    for first, last in itertools.pairwise(BANDS_M):
        is_within = (ranges >= first) & (ranges < last)
        count = np.count_nonzero(is_within)
        if count >= MIN_SAMPLES:
            variance = np.quantile(variances[is_within], QUANTILE) / QUANTILE_OF_MEAN
            rows.append((np.mean(ranges[is_within] ** 2), variance, count))
    if not rows:
        return NO_NOISE
    squared_ranges, observed, counts = np.array(rows).T
    # the relative error of a variance falls with the root of the number of samples
    weights = np.sqrt(counts) / np.maximum(observed, 1e-12)
    design = np.column_stack((np.ones(len(rows)), squared_ranges)) * weights[:, np.newaxis]
    constant, growth = np.linalg.lstsq(design, weights * observed, rcond=None)[0]
    if len(rows) == 1 or growth <= 0.0:
        return Noise(math.sqrt(np.average(observed, weights=counts)))
    if constant <= 0.0:
        return Noise(0.0, math.sqrt(np.average(observed / squared_ranges, weights=counts)))
    return Noise(math.sqrt(constant), math.sqrt(growth))


def wall_residuals(ranges: FloatArray, step: float) -> tuple[FloatArray, FloatArray]:
    """Return ranges of walls, and mean squared residuals of the returns about them, shapes (k,).

    The mean of these is the variance of a range where all neighbouring returns are of one wall.

    Parameters
    ----------
    ranges : float64, shape (n,) or, of several scans, (m, n), NaN without a return [m].
    step : angle between two beams [rad].

    Notes
    -----
    On a straight wall the reciprocal of the range is a sinusoid of the angle, a cos + b sin: a
    linear least squares problem, the same for each `WINDOW` of neighbouring returns.
    """
    if ranges.shape[-1] < WINDOW:
        return np.empty(0), np.empty(0)
    windows = np.lib.stride_tricks.sliding_window_view(ranges, WINDOW, axis=-1)
    middle = windows[..., WINDOW // 2]
    changes = np.abs(np.diff(ranges))
    number = middle.shape[-1]
    largest = np.max([changes[..., k : k + number] for k in range(WINDOW - 1)], axis=0)
    # NaN is near to none
    is_wall: BoolArray = largest <= EDGE_M + EDGE_SHARE * middle
    basis, solve = _sinusoids(step)
    middle, reciprocals = middle[is_wall], 1.0 / windows[is_wall]
    along, across = solve @ reciprocals.T
    is_facing = np.abs(across) <= MAX_SLOPE * np.abs(along)
    residuals = (reciprocals - reciprocals @ solve.T @ basis.T) * middle[:, np.newaxis] ** 2
    variances = np.sum(residuals**2, axis=1) / (WINDOW - 2)
    return middle[is_facing], variances[is_facing]


@lru_cache(maxsize=8)
def _sinusoids(step: float) -> tuple[FloatArray, FloatArray]:
    """Return cosine and sine at the beams of a window, shape (WINDOW, 2), and the pseudoinverse."""
    angles = step * (np.arange(WINDOW) - WINDOW // 2)
    basis = np.column_stack((np.cos(angles), np.sin(angles)))
    return basis, np.linalg.pinv(basis)
