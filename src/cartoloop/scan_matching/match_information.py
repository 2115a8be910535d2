# SPDX-License-Identifier: Apache-2.0
"""How certain a match is: the covariance of a constraint, from (CS) itself (section V-A)."""

from __future__ import annotations

import math

import numpy as np

from cartoloop.kernels.match_covariance import inverse_covariances
from cartoloop.scan_matching.least_squares import LeastSquaresMatch
from cartoloop.sensor.pose import FloatArray

MIN_SIGMA_M = 0.01
MIN_SIGMA_RAD = math.radians(0.1)
"""No match is trusted further than this: walls are not that straight, nor scanners that true."""

MIN_RESIDUAL = 0.03
"""A scan that fits better than this fits by chance."""

OPEN_INFORMATION = 1e-2
"""What is left along a direction that the scan leaves open [1/m^2], [1/rad^2]."""

_MIN_INFORMATIONS = np.full(3, OPEN_INFORMATION)
_MIN_VARIANCES = np.array((MIN_SIGMA_M, MIN_SIGMA_M, MIN_SIGMA_RAD)) ** 2


def match_information(match: LeastSquaresMatch) -> FloatArray:
    """Return the inverse covariance of a match, shape (3, 3), in the grid's axes."""
    information: FloatArray = match_informations(
        match.information[np.newaxis], np.array((match.residual,))
    )[0]
    return information


def match_informations(curvatures: FloatArray, residuals: FloatArray) -> FloatArray:
    """Return the inverse covariances of matches, shape (n, 3, 3), in the grid's axes.

    A corridor leaves its long direction open: there the curvature of (CS), and so the information,
    is small. `MIN_SIGMA_M` and `MIN_SIGMA_RAD` add to the covariance, and so bound the certainty.

    Parameters
    ----------
    curvatures : J^T J of the points' residuals, shape (n, 3, 3).
    residuals : root mean square of the points' residuals, shape (n,).
    """
    informations = np.empty(curvatures.shape)
    inverse_covariances(
        np.ascontiguousarray(curvatures),  # one memory layout, lest it be compiled for another
        residuals,
        MIN_RESIDUAL,
        _MIN_INFORMATIONS,
        _MIN_VARIANCES,
        informations,
    )
    return informations
