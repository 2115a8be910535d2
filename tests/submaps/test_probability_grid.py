# SPDX-License-Identifier: Apache-2.0
"""A grid that grows keeps what it holds, where it holds it."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cartoloop.submaps.finished_grid import PROBABILITY_STEP
from cartoloop.submaps.probability_grid import ProbabilityGrid

lattice = st.integers(-300, 300)
boxes = st.tuples(lattice, lattice, st.integers(0, 150), st.integers(0, 150)).map(
    lambda box: (box[0], box[1], box[0] + box[2], box[1] + box[3])
)


def write(grid, col, row, probability):
    grid.cover(col, row, col, row)
    grid.cells[row - grid.first_row, col - grid.first_col] = probability


def read(grid, col, row):
    return grid.cells[row - grid.first_row, col - grid.first_col]


@settings(deadline=None, max_examples=60)
@given(st.lists(boxes, min_size=1, max_size=8))
def test_all_requested_cells_are_within_the_grid(boxes):
    grid = ProbabilityGrid(0.05)
    for first_col, first_row, last_col, last_row in boxes:
        grid.cover(first_col, first_row, last_col, last_row)
        num_rows, num_cols = grid.cells.shape
        assert grid.first_col <= first_col <= last_col < grid.first_col + num_cols
        assert grid.first_row <= first_row <= last_row < grid.first_row + num_rows


@settings(deadline=None, max_examples=60)
@given(st.lists(st.tuples(lattice, lattice), min_size=1, max_size=12, unique=True))
def test_growth_keeps_known_cells_and_adds_unknown_ones(places):
    grid = ProbabilityGrid(0.05)
    written = {}
    for k, (col, row) in enumerate(places):
        write(grid, col, row, 0.1 + 0.05 * k)
        written[col, row] = np.float32(0.1 + 0.05 * k)
        assert all(read(grid, *place) == p for place, p in written.items())
        assert np.count_nonzero(grid.cells) == len(written)


def test_a_grid_that_is_large_enough_does_not_grow():
    grid = ProbabilityGrid(0.05)
    grid.cover(-10, -10, 50, 50)
    cells = grid.cells
    grid.cover(0, 0, 20, 20)
    assert grid.cells is cells


def test_growth_adds_a_margin():
    grid = ProbabilityGrid(0.05)
    reallocations = 0
    for col in range(1000):
        cells = grid.cells
        grid.cover(col, 0, col, 0)
        reallocations += grid.cells is not cells
    assert reallocations < 30


@pytest.mark.parametrize("place", [(0, 0), (-70, 12), (500, -500)])
def test_a_finished_grid_is_cropped_to_its_known_cells(place):
    grid = ProbabilityGrid(0.1)
    col, row = place
    write(grid, col, row, 0.9)
    write(grid, col + 3, row + 1, 0.2)

    finished = grid.finish()

    assert finished.cells.shape == (2, 4)
    assert finished.cells.dtype == np.uint8
    assert (finished.origin_x, finished.origin_y) == pytest.approx((col * 0.1, row * 0.1))
    assert finished.resolution == 0.1
    known = finished.probabilities()
    assert known[0, 0] == pytest.approx(0.9, abs=PROBABILITY_STEP)
    assert known[1, 3] == pytest.approx(0.2, abs=PROBABILITY_STEP)
    assert np.count_nonzero(known) == 2


@pytest.mark.parametrize("covered", [False, True])
def test_a_grid_without_known_cells_finishes_empty(covered):
    grid = ProbabilityGrid(0.1)
    if covered:
        grid.cover(0, 0, 5, 5)
    finished = grid.finish()
    assert finished.cells.shape == (0, 0)
    assert finished.probabilities().shape == (0, 0)


def test_finishing_does_not_change_the_grid():
    grid = ProbabilityGrid(0.1)
    write(grid, 2, 3, 0.7)
    grid.finish()
    write(grid, 4, 3, 0.6)
    assert np.count_nonzero(grid.cells) == 2


def test_the_origin_is_the_centre_of_the_first_cell():
    grid = ProbabilityGrid(0.25)
    grid.cover(8, -12, 9, -11)
    assert (grid.origin_x, grid.origin_y) == (grid.first_col * 0.25, grid.first_row * 0.25)
