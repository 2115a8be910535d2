# SPDX-License-Identifier: Apache-2.0
"""How certain a match is: the covariance of a constraint, from (CS) itself (section V-A)."""

from __future__ import annotations

import math

import numpy as np

from cartoloop.arrays import FloatArray
from cartoloop.kernels.match_covariance import inverse_covariances
from cartoloop.scan_matching.least_squares import LeastSquaresMatch

MIN_SIGMA_M = 0.01
"""Smallest standard deviation of a match's position [m]: walls are not straighter than this."""

MIN_SIGMA_RAD = math.radians(0.1)
"""Smallest standard deviation of a match's angle [rad]: scanners are not more accurate."""

MIN_RESIDUAL = 0.03
"""Smallest root mean square of 1 - M that is not by chance [probability]: cell values are clamped
to 0.9, so that a residual below 0.1 is due to interpolation."""

OPEN_INFORMATION = 1e-2
"""Information along a degenerate direction [1/m^2], [1/rad^2]: a standard deviation of 10 m or
10 rad, which keeps the matrix invertible."""

_MIN_INFORMATIONS = np.full(3, OPEN_INFORMATION)
_MIN_VARIANCES = np.array((MIN_SIGMA_M, MIN_SIGMA_M, MIN_SIGMA_RAD)) ** 2


def match_information(match: LeastSquaresMatch) -> FloatArray:
    """Return the inverse covariance of a match, shape (3, 3), in the submap's axes."""
    information: FloatArray = match_informations(
        match.information[np.newaxis], np.array((match.residual,))
    )[0]
    return information


def match_informations(curvatures: FloatArray, residuals: FloatArray) -> FloatArray:
    """Return the inverse covariances of matches, shape (n, 3, 3), in the submap's axes.

    Along a corridor, a degenerate direction, the curvature of (CS) and so the information is small.
    The variances of `MIN_SIGMA_M` and `MIN_SIGMA_RAD` are added to the covariance.

    Parameters
    ----------
    curvatures : J^T J of the points' residuals, shape (n, 3, 3).
    residuals : root mean square of the points' residuals, shape (n,).
    """
    informations = np.empty(curvatures.shape)
    inverse_covariances(
        np.ascontiguousarray(curvatures),  # one memory layout, so that only one is compiled
        residuals,
        MIN_RESIDUAL,
        _MIN_INFORMATIONS,
        _MIN_VARIANCES,
        informations,
    )
    return informations
