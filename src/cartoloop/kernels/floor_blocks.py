# SPDX-License-Identifier: Apache-2.0
"""Floor and walls of a map in square blocks of cells: how much of each is known, and how surely."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cartoloop._jit import kernel
from cartoloop.arrays import ByteArray, IntArray

WALL = np.float32(0.5)
"""Cells more probably occupied than this are walls."""


@kernel
def count_in_blocks(
    probability: NDArray[np.float32], edge: int, limits: NDArray[np.float32]
) -> IntArray:
    """Return how many cells of each block are wall, or free by each of some limits.

    Parameters
    ----------
    probability : float32, shape (rows, columns), of being occupied; negative: unknown.
    edge : of a block [cells]; those at the last rows and columns may be smaller.
    limits : float32, shape (k,): cells less probably occupied are free.

    Returns
    -------
    int64, shape (block rows, block columns, k).
    """
    num_rows, num_cols = probability.shape
    num_limits = limits.shape[0]
    counts = np.zeros((-(-num_rows // edge), -(-num_cols // edge), num_limits), dtype=np.int64)
    for row in range(num_rows):
        for block in range(counts.shape[1]):
            for col in range(block * edge, min((block + 1) * edge, num_cols)):
                value = probability[row, col]
                if value < 0.0:
                    continue
                for k in range(num_limits):
                    if value < limits[k] or value > WALL:
                        counts[row // edge, block, k] += 1
    return counts


@kernel
def floor_in_blocks(
    probability: NDArray[np.float32], edge: int, limits: NDArray[np.float32], kinds: ByteArray
) -> tuple[int, int, int, int, int]:
    """Return the number of free cells in blocks, and the box around what counts there.

    Parameters
    ----------
    probability, edge, limits : as for :func:`count_in_blocks`. By the last limit cells are floor.
    kinds : uint8, shape (block rows, block columns): 0 where nothing counts, else one more than the
        row of the limit from which on cells count, besides walls.

    Returns
    -------
    The number, then first row, first column, last row and last column of the box; the last row is
    before the first if no cell counts.
    """
    num_rows, num_cols = probability.shape
    floor = limits[limits.shape[0] - 1]
    num_free = 0
    first_row, first_col, last_row, last_col = num_rows, num_cols, -1, -1
    for row in range(num_rows):
        for block in range(kinds.shape[1]):
            kind = kinds[row // edge, block]
            if kind == 0:
                continue
            limit = limits[kind - 1]
            for col in range(block * edge, min((block + 1) * edge, num_cols)):
                value = probability[row, col]
                if value < 0.0:
                    continue
                num_free += value < floor
                if value < limit or value > WALL:
                    first_row, last_row = min(first_row, row), row
                    first_col, last_col = min(first_col, col), max(last_col, col)
    return num_free, first_row, first_col, last_row, last_col
