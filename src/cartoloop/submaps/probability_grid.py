# SPDX-License-Identifier: Apache-2.0
"""The probability grid of a growing submap (section IV-B)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cartoloop.kernels.cell_values import known_box
from cartoloop.submaps.finished_grid import FinishedGrid, quantize_part

GROWTH_CELLS = 64
"""Least growth of a grid, so that it seldom grows [cells]: 3.2 m at 0.05 m."""


class Extent(NamedTuple):
    """The cells of a grid and their position, replaced together since other threads may read them.

    Attributes
    ----------
    cells : float32, shape (num_rows, num_cols); 0 where never observed, otherwise within
        [MIN_PROBABILITY, MAX_PROBABILITY].
    first_col, first_row : lattice coordinates of ``cells[0, 0]``, whose centre is at
        (first_col * r, first_row * r) in the grid's frame.
    """

    cells: NDArray[np.float32]
    first_col: int
    first_row: int


class ProbabilityGrid:
    """A map from grid points to the probability that they are obstructed; grows as needed.

    Attributes
    ----------
    resolution : pixel edge r [m].
    extent : its cells and their position.
    """

    def __init__(self, resolution: float) -> None:
        self.resolution = resolution
        self.extent = Extent(np.zeros((0, 0), dtype=np.float32), 0, 0)

    @property
    def cells(self) -> NDArray[np.float32]:
        """The cells; see :class:`Extent`."""
        return self.extent.cells

    @property
    def first_col(self) -> int:
        """Lattice coordinate of the first column."""
        return self.extent.first_col

    @property
    def first_row(self) -> int:
        """Lattice coordinate of the first row."""
        return self.extent.first_row

    @property
    def origin_x(self) -> float:
        """Centre of the first column [m, grid frame]."""
        return self.extent.first_col * self.resolution

    @property
    def origin_y(self) -> float:
        """Centre of the first row [m, grid frame]."""
        return self.extent.first_row * self.resolution

    def cover(self, first_col: int, first_row: int, last_col: int, last_row: int) -> None:
        """Grow so that all lattice cells from first to last (inclusive) are within the grid."""
        cells, own_col, own_row = self.extent
        num_rows, num_cols = cells.shape
        if num_rows == 0:
            own_col, own_row = first_col - GROWTH_CELLS, first_row - GROWTH_CELLS
            shape = (last_row - own_row + GROWTH_CELLS, last_col - own_col + GROWTH_CELLS)
            self.extent = Extent(np.zeros(shape, dtype=np.float32), own_col, own_row)
            return
        left = _growth(own_col - first_col)
        below = _growth(own_row - first_row)
        right = _growth(last_col + 1 - own_col - num_cols)
        above = _growth(last_row + 1 - own_row - num_rows)
        if not (left or below or right or above):
            return
        grown = np.zeros((below + num_rows + above, left + num_cols + right), dtype=np.float32)
        grown[below : below + num_rows, left : left + num_cols] = cells
        self.extent = Extent(grown, own_col - left, own_row - below)

    def finish(self) -> FinishedGrid:
        """Return the known part, quantized, for searches and maps."""
        cells, first_col, first_row = self.extent
        row, col, *shape = known_box(cells)
        return FinishedGrid(
            quantize_part(cells, row, col, (shape[0], shape[1])),
            (first_col + col) * self.resolution,
            (first_row + row) * self.resolution,
            self.resolution,
        )


def _growth(shortfall: int) -> int:
    """Return the growth at a side where `shortfall` cells are missing [cells]."""
    return shortfall + GROWTH_CELLS if shortfall > 0 else 0
