# SPDX-License-Identifier: Apache-2.0
"""Walls that are wider by a pixel."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays

from cartoloop.submaps.finished_grid import FinishedGrid
from cartoloop.submaps.widened_grid import widened


def widened_slowly(cells):
    rows, cols = cells.shape
    result = np.empty_like(cells)
    for row in range(rows):
        for col in range(cols):
            around = cells[max(row - 1, 0) : row + 2, max(col - 1, 0) : col + 2]
            result[row, col] = around.max()
    return result


@settings(deadline=None, max_examples=60)
@given(
    arrays(np.uint8, array_shapes(min_dims=2, max_dims=2, max_side=7), elements=st.integers(0, 255))
)
def test_each_cell_is_the_largest_around_it(cells):
    grid = widened(FinishedGrid(cells, 0.5, -1.5, 0.05))
    np.testing.assert_array_equal(grid.cells, widened_slowly(cells))
    assert (grid.origin_x, grid.origin_y, grid.resolution) == (0.5, -1.5, 0.05)


def test_a_grid_without_cells_remains_one():
    assert widened(FinishedGrid(np.zeros((0, 0), np.uint8), 0.0, 0.0, 0.05)).size == 0
