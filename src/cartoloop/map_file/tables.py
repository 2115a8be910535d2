# SPDX-License-Identifier: Apache-2.0
"""Rows of a table as arrays."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from cartoloop.arrays import FloatArray, IntArray

_MAX_INDEX = 2.0**31
_SYMMETRIC = np.array(((0, 1, 2), (1, 3, 4), (2, 4, 5)))


def numbers_of(rows: Sequence[tuple[Any, ...]], num_columns: int) -> FloatArray:
    """Return rows of numbers as an array, shape (n, num_columns); NULL becomes NaN."""
    return np.array(rows, dtype=np.float64).reshape(-1, num_columns)


def finite(numbers: FloatArray, what: str) -> FloatArray:
    """Return the numbers, if all are finite.

    Raises
    ------
    ValueError
        One is not.
    """
    if not np.isfinite(numbers).all():
        raise ValueError(f"{what} is not finite")
    return numbers


def indices(numbers: FloatArray, what: str, end: float = _MAX_INDEX) -> IntArray:
    """Return whole numbers from 0 on, below `end`.

    Raises
    ------
    ValueError
        One is not.
    """
    if not np.all((numbers >= 0.0) & (numbers < end) & (np.floor(numbers) == numbers)):
        raise ValueError(f"{what} is out of range")
    return numbers.astype(np.int64)


def symmetric(upper: FloatArray) -> FloatArray:
    """Return matrices, shape (n, 3, 3), given their upper triangles, shape (n, 6)."""
    matrices: FloatArray = upper[:, _SYMMETRIC]
    return matrices
