# SPDX-License-Identifier: Apache-2.0
"""Grids whose walls are wider, so that walls of few returns have no holes."""

from __future__ import annotations

import numpy as np

from cartoloop.arrays import ByteArray
from cartoloop.submaps.finished_grid import FinishedGrid


def widened(grid: FinishedGrid) -> FinishedGrid:
    """Return a grid each of whose cells is the largest among it and its eight neighbours."""
    cells = _largest_of_three(_largest_of_three(grid.cells).T).T
    return FinishedGrid(np.ascontiguousarray(cells), grid.origin_x, grid.origin_y, grid.resolution)


def _largest_of_three(cells: ByteArray) -> ByteArray:
    """Return the largest of each cell and those in the rows before and after it."""
    largest = cells.copy()
    np.maximum(largest[1:], cells[:-1], out=largest[1:])
    np.maximum(largest[:-1], cells[1:], out=largest[:-1])
    return largest
