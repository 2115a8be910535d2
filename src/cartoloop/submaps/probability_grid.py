# SPDX-License-Identifier: Apache-2.0
"""The probability grid of a submap that still grows (section IV-B)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cartoloop.submaps.finished_grid import FinishedGrid, quantize_probabilities

GROWTH_CELLS = 64
"""A grid that must grow does so by at least this much, so that it seldom must."""


class ProbabilityGrid:
    """A map from grid points to the probability that they are obstructed; grows as needed.

    Attributes
    ----------
    resolution : pixel edge r [m].
    cells : float32, shape (num_rows, num_cols); 0 where never observed, otherwise within
        [MIN_PROBABILITY, MAX_PROBABILITY].
    first_col, first_row : lattice coordinates of ``cells[0, 0]``, whose centre is at
        (first_col * r, first_row * r) in the grid's frame.
    """

    def __init__(self, resolution: float) -> None:
        self.resolution = resolution
        self.cells: NDArray[np.float32] = np.zeros((0, 0), dtype=np.float32)
        self.first_col = 0
        self.first_row = 0

    @property
    def origin_x(self) -> float:
        """Centre of the first column [m, grid frame]."""
        return self.first_col * self.resolution

    @property
    def origin_y(self) -> float:
        """Centre of the first row [m, grid frame]."""
        return self.first_row * self.resolution

    def cover(self, first_col: int, first_row: int, last_col: int, last_row: int) -> None:
        """Grow so that all lattice cells from first to last (inclusive) are within the grid."""
        num_rows, num_cols = self.cells.shape
        if num_rows == 0:
            self.first_col, self.first_row = first_col - GROWTH_CELLS, first_row - GROWTH_CELLS
            shape = (
                last_row - self.first_row + GROWTH_CELLS,
                last_col - self.first_col + GROWTH_CELLS,
            )
            self.cells = np.zeros(shape, dtype=np.float32)
            return
        left = _growth(self.first_col - first_col)
        below = _growth(self.first_row - first_row)
        right = _growth(last_col + 1 - self.first_col - num_cols)
        above = _growth(last_row + 1 - self.first_row - num_rows)
        if not (left or below or right or above):
            return
        grown = np.zeros((below + num_rows + above, left + num_cols + right), dtype=np.float32)
        grown[below : below + num_rows, left : left + num_cols] = self.cells
        self.cells = grown
        self.first_col -= left
        self.first_row -= below

    def finish(self) -> FinishedGrid:
        """Return the known part, quantised, for searches and maps."""
        known = self.cells > 0.0
        rows, cols = np.flatnonzero(known.any(axis=1)), np.flatnonzero(known.any(axis=0))
        if len(rows) == 0:
            return FinishedGrid(np.zeros((0, 0), dtype=np.uint8), 0.0, 0.0, self.resolution)
        box = (slice(rows[0], rows[-1] + 1), slice(cols[0], cols[-1] + 1))
        return FinishedGrid(
            quantize_probabilities(self.cells[box]),
            (self.first_col + int(cols[0])) * self.resolution,
            (self.first_row + int(rows[0])) * self.resolution,
            self.resolution,
        )


def _growth(shortfall: int) -> int:
    """Return by how many cells to grow at a side where so many are missing."""
    return shortfall + GROWTH_CELLS if shortfall > 0 else 0
