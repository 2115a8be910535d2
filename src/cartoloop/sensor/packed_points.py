# SPDX-License-Identifier: Apache-2.0
"""The points of a scan as 16-bit numbers, as files keep them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cartoloop.arrays import FloatArray
from cartoloop.kernels.packed_points import pack_rows

POINT_UNIT = 0.001
"""Points are kept to a millimetre, or where they lie further than 32 m, as finely as they fit."""

_MAX_INT16 = 32767
_MAX_UNIT = 1e300  # [m]: times 2^15 still a number


def pack_points(points: NDArray[np.floating]) -> tuple[float, bytes]:
    """Return the unit [m] of points (n, 2) and their whole numbers of it.

    They are not compressed: noise does not compress.
    """
    numbers = np.empty((2, len(points)), dtype=np.int16)
    exact = np.ascontiguousarray(points, dtype=np.float64)
    unit = pack_rows(exact, POINT_UNIT, _MAX_INT16, numbers)
    return unit, numbers.astype("<i2", copy=False).tobytes()


def unpack_points(num_points: int, unit: float, numbers_of_unit: bytes | memoryview) -> FloatArray:
    """Return points, shape (num_points, 2) [m], given what `pack_points` returned.

    Raises
    ------
    ValueError
        There are more or fewer numbers, or the unit is impossible.
    """
    if not 0.0 <= float(unit) <= _MAX_UNIT:
        raise ValueError(f"points are in units of {unit} m")
    numbers = np.frombuffer(numbers_of_unit, dtype="<i2")
    return numbers.reshape(2, num_points).T * float(unit)
