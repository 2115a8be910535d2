# SPDX-License-Identifier: Apache-2.0
"""Inverse covariances of matches."""

from __future__ import annotations

from cartoloop._jit import kernel
from cartoloop.arrays import FloatArray


@kernel
def invert(matrix: FloatArray, least: FloatArray) -> None:
    """Invert a symmetric positive definite matrix, float64, shape (3, 3), in place.

    By Cholesky factorisation.

    Parameters
    ----------
    least : float64, shape (3,), the diagonal of a matrix that is no larger: no pivot is smaller
        except by rounding errors.
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
