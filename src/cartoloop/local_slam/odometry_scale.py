# SPDX-License-Identifier: Apache-2.0
"""Scale of the odometry's distances, from what scans alone measure of them."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from cartoloop.arrays import FloatArray
from cartoloop.local_slam.measured_distance import MeasuredDistance

NUM_DISTANCES = 600
"""Number of latest distances that are used: some 600 m."""

MIN_DISTANCES = 10
"""Number of distances needed for an estimate."""

MATCHED_ERROR = 0.005
"""Standard deviation of the scale that matched poses show: the less the scans determine, the more
they show what was assumed."""

MIN_KNOWN_ERROR = 0.002
"""Least standard deviation of a scale that is known from before, so that it may change."""

MIN_ERROR = 1e-3
"""Lower limit of a standard error: edges of walls are seen from two sides, and comparisons err by a
millimetre on a metre in the mean."""

MIN_LENGTH_M = 0.1
"""Shorter distances are taken to be so long when their noise is scaled to a metre [m]."""

MEDIAN_TO_SIGMA = 1.4826
"""Standard deviation over the median of the absolute value of normally distributed numbers."""

LOSS_SCALE = 3.5
"""Scale of Cauchy's loss as a multiple of the median error: for normal errors it is nearly as good
as least squares, and a metre on which wheels slip hardly counts."""

ROUNDS = 8
"""Rounds of reweighting, after which the estimate changes by less than its noise."""

MIN_TYPICAL_ERROR_M = 1e-4
"""Lower limit of the typical error [m], so that exact data do not divide by zero."""


def measured_ratio(
    distances: Sequence[MeasuredDistance], predicted: FloatArray
) -> tuple[float, float, float]:
    """Return measured over predicted distance, its standard error, and the noise of a metre.

    Parameters
    ----------
    distances : as measured, at least one.
    predicted : shape (n,), the same as odometry predicts them [m].

    Notes
    -----
    Reweighted least squares: where the wheels slip, odometry is far from what is measured. The
    error follows from the residuals. The noise of the odometry adds up like steps at random; that
    of the comparisons is in it, too. It is the standard deviation of a metre, from the median [m].
    """
    measured = np.array([one.distance for one in distances])
    information = np.array([one.information for one in distances])
    information /= float(np.median(information))
    ratio, weights = 1.0, information
    for _ in range(ROUNDS):
        squares = information * (measured - ratio * predicted) ** 2
        typical = max(math.sqrt(float(np.median(squares))), MIN_TYPICAL_ERROR_M)
        weights = information / (1.0 + squares / (LOSS_SCALE * typical) ** 2)
        sum_of_weights = float(weights @ predicted**2)
        if sum_of_weights <= 0.0:
            return 1.0, math.inf, math.nan
        ratio = float(weights @ (predicted * measured)) / sum_of_weights
    terms = weights * predicted * (measured - ratio * predicted)
    error = math.sqrt(float(terms @ terms)) / sum_of_weights
    lengths = np.maximum(np.abs(predicted), MIN_LENGTH_M)
    noise = MEDIAN_TO_SIGMA * float(np.median(np.abs(measured - ratio * predicted) / lengths**0.5))
    return ratio, max(error, MIN_ERROR), noise


def combined(estimates: Sequence[tuple[float, float]]) -> tuple[float, float]:
    """Return the mean of values with standard errors, weighted by these, and its own."""
    weights = [error**-2 for _, error in estimates if error < math.inf]
    values = [value for value, error in estimates if error < math.inf]
    total = math.fsum(weights)
    mean = math.fsum(w * value for w, value in zip(weights, values, strict=True)) / total
    return mean, total**-0.5
