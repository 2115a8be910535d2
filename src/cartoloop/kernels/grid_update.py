# SPDX-License-Identifier: Apache-2.0
"""Eq. (2) and (3) for the cells that a scan hits and misses (section IV-B)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cartoloop._jit import kernel
from cartoloop.arrays import CellArray

MEMORY_SIZE = 2048
"""Number of cached results of eq. (3): a power of two, many more than occur in one scan."""


@kernel
def update_cells(
    grid: NDArray[np.float32],
    first_col: int,
    first_row: int,
    hits: CellArray,
    free: CellArray,
    hidden: CellArray,
    hit_probability: float,
    miss_probability: float,
    min_probability: float,
    max_probability: float,
) -> None:
    """Write hits and misses into a probability grid by eq. (2) and (3).

    Parameters
    ----------
    grid : float32, shape (num_rows, num_cols), C order, probabilities, 0 where never observed, and
        negative where only hidden: what the probability is once observed; changed in place.
    first_col, first_row : lattice coordinates of ``grid[0, 0]``.
    hits : int32, shape (h, 2), lattice (column, row) of the cells that are hit.
    free : int32, shape (f, 3), runs of cells that are missed: lattice row, first column, column
        after the last. No cell is in two of them, nor also hit.
    hidden : int32, shape (b, 2), lattice (column, row) of cells just behind walls, which are
        neither hit nor missed. They count as missed, but are not observed thereby; they may lie
        outside of the grid.

    Notes
    -----
    Most cells of a scan are free space, and differ mainly in how often they were observed: some
    tens of values. The result of eq. (3) for each value is cached.
    """
    hit_odds = hit_probability / (1.0 - hit_probability)
    miss_odds = miss_probability / (1.0 - miss_probability)
    for k in range(hits.shape[0]):
        col, row = hits[k, 0] - first_col, hits[k, 1] - first_row
        p = _updated(grid[row, col], hit_probability, hit_odds)
        grid[row, col] = np.float32(min(max(p, min_probability), max_probability))
    num_rows, num_cols = grid.shape
    for k in range(hidden.shape[0]):
        col, row = hidden[k, 0] - first_col, hidden[k, 1] - first_row
        if 0 <= row < num_rows and 0 <= col < num_cols:
            p = _updated(grid[row, col], miss_probability, miss_odds)
            value = np.float32(min(max(p, min_probability), max_probability))
            grid[row, col] = value if grid[row, col] > 0.0 else -value
    grid_bits = grid.view(np.int32)
    known = np.full(MEMORY_SIZE, -1, dtype=np.int32)  # the bits of no probability
    outcome = np.empty(MEMORY_SIZE, dtype=np.float32)
    for k in range(free.shape[0]):
        row = free[k, 0] - first_row
        run = slice(free[k, 1] - first_col, free[k, 2] - first_col)
        cells, bits = grid[row, run], grid_bits[row, run]
        for i in range(cells.shape[0]):
            place = (bits[i] >> 9) & (MEMORY_SIZE - 1)
            if known[place] != bits[i]:
                known[place] = bits[i]
                p = _updated(cells[i], miss_probability, miss_odds)
                outcome[place] = np.float32(min(max(p, min_probability), max_probability))
            cells[i] = outcome[place]


@kernel
def _updated(probability: np.float32, observed: float, observed_odds: float) -> float:
    """Return a cell's probability after an observation, before clamping."""
    p: float = abs(np.float64(probability))
    if p == 0.0:
        return observed
    odds = p / (1.0 - p) * observed_odds
    return odds / (1.0 + odds)
