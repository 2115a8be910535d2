# SPDX-License-Identifier: Apache-2.0
"""Inverse covariances of matches."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cartoloop._jit import kernel

FloatArray = NDArray[np.float64]


@kernel
def invert(matrix: FloatArray, least: FloatArray) -> None:
    """Put the inverse of a symmetric positive definite matrix, float64, shape (3, 3), in its place.

    By Cholesky's factors.

    Parameters
    ----------
    least : float64, shape (3,), of a diagonal matrix that is no larger: no pivot is smaller, but
        for what rounding takes away.
    """
    a = max(matrix[0, 0], least[0])
    b, c = matrix[1, 0] / a, matrix[2, 0] / a
    d = max(matrix[1, 1] - b * matrix[1, 0], least[1])
    e = (matrix[2, 1] - c * matrix[1, 0]) / d
    f = max(matrix[2, 2] - c * matrix[2, 0] - e * (matrix[2, 1] - c * matrix[1, 0]), least[2])
    # L^-1 has the rows (1), (-b, 1), (b e - c, -e, 1).
    g = b * e - c
    matrix[0, 0] = 1.0 / a + b * b / d + g * g / f
    matrix[1, 0] = matrix[0, 1] = -b / d - e * g / f
    matrix[2, 0] = matrix[0, 2] = g / f
    matrix[1, 1] = 1.0 / d + e * e / f
    matrix[2, 1] = matrix[1, 2] = -e / f
    matrix[2, 2] = 1.0 / f


@kernel
def inverse_covariances(
    curvatures: FloatArray,
    residuals: FloatArray,
    min_residual: float,
    min_informations: FloatArray,
    min_variances: FloatArray,
    out_informations: FloatArray,
) -> None:
    """Write the inverse covariances of matches, shape (n, 3, 3), into `out_informations`.

    Parameters
    ----------
    curvatures : float64, shape (n, 3, 3), J^T J of the points' residuals, symmetric.
    residuals : float64, shape (n,), root mean square of the points' residuals.
    min_residual : those that are smaller count as this.
    min_informations, min_variances : float64, shape (3,), added to the diagonal of the information
        and of the covariance; positive.
    """
    for k in range(residuals.shape[0]):
        information = out_informations[k]
        variance = max(residuals[k], min_residual) ** 2
        for i in range(3):
            for j in range(3):
                information[i, j] = curvatures[k, i, j] / variance
            information[i, i] += min_informations[i]
        invert(information, min_informations)
        for i in range(3):
            information[i, i] += min_variances[i]
        invert(information, min_variances)
