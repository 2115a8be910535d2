# SPDX-License-Identifier: Apache-2.0
"""Eq. (2) and (3) against a slow reference."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cartoloop.kernels.grid_update import MEMORY_SIZE, update_cells
from tests.reference.naive_ray_casting import naive_update

NO_HITS = np.zeros((0, 2), dtype=np.int32)
NO_RUNS = np.zeros((0, 3), dtype=np.int32)
FIRST_CELL = np.zeros((1, 2), dtype=np.int32)
FIRST_RUN = np.array([[0, 0, 1]], dtype=np.int32)

probability = st.one_of(st.just(0.0), st.floats(0.1, 0.9))


@settings(deadline=None, max_examples=60)
@given(
    grid=st.lists(st.lists(probability, min_size=4, max_size=4), min_size=3, max_size=3),
    cells=st.lists(st.tuples(st.integers(0, 3), st.integers(0, 2)), unique=True),
    hit_share=st.floats(0.0, 1.0),
    hit_probability=st.floats(0.51, 0.97),
    miss_probability=st.floats(0.03, 0.49),
)
def test_hits_and_misses_update_the_odds(grid, cells, hit_share, hit_probability, miss_probability):
    first_col, first_row = -7, 5
    num_hits = round(hit_share * len(cells))
    before = np.array(grid, dtype=np.float32)
    expected = before.copy()
    for k, (col, row) in enumerate(cells):
        observed = hit_probability if k < num_hits else miss_probability
        expected[row, col] = np.float32(naive_update(before[row, col], observed, 0.1, 0.9))
    lattice = np.array(cells, dtype=np.int32).reshape(-1, 2) + np.int32([first_col, first_row])
    free = lattice[num_hits:]
    runs = np.column_stack((free[:, 1], free[:, 0], free[:, 0] + 1)).astype(np.int32)

    after = before.copy()
    update_cells(
        after,
        first_col,
        first_row,
        lattice[:num_hits],
        runs,
        NO_HITS,
        hit_probability,
        miss_probability,
        0.1,
        0.9,
    )

    assert np.array_equal(after, expected)


def test_more_values_than_are_cached_are_all_updated():
    before = np.random.default_rng(3).uniform(0.1, 0.9, (8, MEMORY_SIZE)).astype(np.float32)
    before[::2] = before[1::2]  # each value comes again, after those that displaced it
    rows = np.arange(8)
    runs = np.column_stack((rows, 0 * rows, 0 * rows + MEMORY_SIZE)).astype(np.int32)
    after = before.copy()
    update_cells(after, 0, 0, NO_HITS, runs, NO_HITS, 0.6, 0.45, 0.1, 0.9)
    expected = [naive_update(p, 0.45, 0.1, 0.9) for p in before.ravel()]
    assert np.array_equal(after.ravel(), np.array(expected).astype(np.float32))


def test_the_first_observation_sets_its_probability():
    grid = np.zeros((1, 2), dtype=np.float32)
    runs = FIRST_RUN + np.int32([0, 1, 1])
    update_cells(grid, 0, 0, FIRST_CELL, runs, NO_HITS, 0.6, 0.45, 0.1, 0.9)
    assert grid[0].tolist() == pytest.approx([0.6, 0.45])


@pytest.mark.parametrize(
    ("hits", "free", "limit"), [(FIRST_CELL, NO_RUNS, 0.9), (NO_HITS, FIRST_RUN, 0.1)]
)
def test_repeated_observations_end_at_the_clamp(hits, free, limit):
    grid = np.zeros((1, 1), dtype=np.float32)
    for _ in range(100):
        update_cells(grid, 0, 0, hits, free, NO_HITS, 0.6, 0.45, 0.1, 0.9)
    assert grid[0, 0] == np.float32(limit)


def hide(grid, times):
    for _ in range(times):
        update_cells(grid, 0, 0, NO_HITS, NO_RUNS, FIRST_CELL, 0.6, 0.45, 0.1, 0.9)


@pytest.mark.parametrize("times", [1, 2, 100])
def test_a_hidden_cell_is_missed_but_not_observed(times):
    grid, missed = np.zeros((2, 1, 1), dtype=np.float32)
    hide(grid, times)
    for _ in range(times):
        update_cells(missed, 0, 0, NO_HITS, FIRST_RUN, NO_HITS, 0.6, 0.45, 0.1, 0.9)
    assert grid[0, 0] == -missed[0, 0]


@pytest.mark.parametrize(("hits", "free"), [(FIRST_CELL, NO_RUNS), (NO_HITS, FIRST_RUN)])
def test_an_observation_goes_on_from_what_was_hidden(hits, free):
    hidden, missed = np.full((2, 1, 1), 0.7, dtype=np.float32)
    hide(hidden, 3)
    for _ in range(3):
        update_cells(missed, 0, 0, NO_HITS, FIRST_RUN, NO_HITS, 0.6, 0.45, 0.1, 0.9)
    assert hidden[0, 0] == missed[0, 0]
    unknown = -missed
    for grid in (unknown, missed):
        update_cells(grid, 0, 0, hits, free, NO_HITS, 0.6, 0.45, 0.1, 0.9)
    assert unknown[0, 0] == missed[0, 0] > 0.0


def test_hidden_cells_outside_of_the_grid_change_nothing():
    grid = np.full((2, 2), 0.3, dtype=np.float32)
    outside = np.array([(-1, 0), (2, 1), (0, -1), (1, 2)], dtype=np.int32)
    update_cells(grid, 0, 0, NO_HITS, NO_RUNS, outside, 0.6, 0.45, 0.1, 0.9)
    assert (grid == np.float32(0.3)).all()
