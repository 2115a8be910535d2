# SPDX-License-Identifier: Apache-2.0
"""Points as whole numbers of a unit."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cartoloop._jit import borrowing_kernel
from cartoloop.arrays import FloatArray


@borrowing_kernel
def pack_rows(
    points: FloatArray, least_unit: float, largest: int, out_numbers: NDArray[np.int16]
) -> float:
    """Write points as whole numbers of a unit; return the unit [m].

    Parameters
    ----------
    points : float64, shape (n, 2) [m]; finite.
    least_unit : of the numbers [m]; it is larger where a number would exceed `largest`.
    out_numbers : int16, shape (2, n), the nearest numbers, of two the even one.
    """
    furthest = 0.0
    for k in range(points.shape[0]):
        furthest = max(furthest, abs(points[k, 0]), abs(points[k, 1]))
    unit = max(least_unit, furthest / largest)
    for k in range(points.shape[0]):
        out_numbers[0, k] = np.int16(np.rint(points[k, 0] / unit))
        out_numbers[1, k] = np.int16(np.rint(points[k, 1] / unit))
    return unit
