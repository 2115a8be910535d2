# SPDX-License-Identifier: Apache-2.0
"""Small things that the steps of the factorization share."""

from __future__ import annotations

import numpy as np

from cartoloop._jit import kernel
from cartoloop.arrays import IntArray


@kernel
def filled(size: int, value: int) -> IntArray:
    """Return an int64 array of one value (np.full adds to the compile time of every kernel)."""
    array = np.empty(size, dtype=np.int64)
    for i in range(size):
        array[i] = value
    return array


@kernel
def padded(size: int) -> int:
    """Return the stored length of a row of `size` numbers: whole cache lines."""
    return (size + 7) // 8 * 8


@kernel
def both_halves(row_begin: IntArray, columns: IntArray) -> tuple[IntArray, IntArray]:
    """Return the neighbours of every vertex, from those above it: begin (n + 1,), neighbours."""
    n = row_begin.size - 1
    begin = np.zeros(n + 1, dtype=np.int64)
    for k in range(n):
        begin[k + 1] += row_begin[k + 1] - row_begin[k]
        for i in range(row_begin[k], row_begin[k + 1]):
            begin[columns[i] + 1] += 1
    for k in range(n):
        begin[k + 1] += begin[k]
    end = begin.copy()
    neighbours = np.empty(2 * columns.size, dtype=np.int64)
    for k in range(n):
        for i in range(row_begin[k], row_begin[k + 1]):
            other = columns[i]
            neighbours[end[k]] = other
            end[k] += 1
            neighbours[end[other]] = k
            end[other] += 1
    return begin, neighbours
