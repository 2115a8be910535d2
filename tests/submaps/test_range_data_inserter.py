# SPDX-License-Identifier: Apache-2.0
"""A scan's hit and miss sets, and what inserting it does to a grid."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cartoloop.config import SubmapConfig
from cartoloop.errors import InputError
from cartoloop.kernels.ray_casting import SUBPIXELS
from cartoloop.sensor.pose import Pose
from cartoloop.submaps.finished_grid import MAX_PROBABILITY, MIN_PROBABILITY
from cartoloop.submaps.probability_grid import ProbabilityGrid, insert_cells, scan_cells
from tests.reference.naive_ray_casting import naive_scan_cells

RESOLUTION = 0.1
CONFIG = SubmapConfig(resolution=RESOLUTION, hit_probability=0.6, miss_probability=0.45)

offset = st.one_of(st.floats(-1.5, 1.5), st.integers(-30, 30).map(lambda halves: halves * 0.05))
point_lists = st.lists(st.tuples(offset, offset), max_size=6)


def points(rows):
    return np.array(rows, dtype=np.float64).reshape(-1, 2)


def probability(grid, col, row):
    return float(grid.cells[row - grid.first_row, col - grid.first_col])


def free_cells(cells):
    return [(col, row) for row, first, after in cells.free.tolist() for col in range(first, after)]


def insert(grid, sensor, returns, misses=()):
    cells = scan_cells(Pose(*sensor, 0.0), points(returns), points(misses), RESOLUTION)
    insert_cells(grid, cells, CONFIG)


@settings(deadline=None, max_examples=60)
@given(
    place=st.tuples(st.floats(-1e4, 1e4), st.floats(-1e4, 1e4)),
    offsets=st.tuples(point_lists, point_lists),
)
def test_the_sets_equal_exact_geometry_at_any_position(place, offsets):
    returns, misses = ([(place[0] + x, place[1] + y) for x, y in part] for part in offsets)
    found = scan_cells(Pose(*place, 0.7), points(returns), points(misses), RESOLUTION)
    all_points = points([place, *returns, *misses])
    first = np.floor(all_points.min(axis=0) / RESOLUTION).astype(int) - 1
    hits, missed = naive_scan_cells(place, returns, misses, RESOLUTION, *first.tolist(), SUBPIXELS)
    found_hits, found_missed = [tuple(cell) for cell in found.hits.tolist()], free_cells(found)
    assert len(set(found_hits)) == len(found_hits)
    assert set(found_hits) == hits
    assert len(set(found_missed)) == len(found_missed)
    assert set(found_missed) == missed


def test_cells_are_those_of_the_nearest_grid_points():
    found = scan_cells(Pose(0.0, 0.0, 0.0), points([(0.26, 0.0)]), points([]), RESOLUTION)
    assert found.hits.tolist() == [[3, 0]]
    assert found.free.tolist() == [[0, 0, 3]]


def test_a_first_scan_sets_hit_and_miss_probabilities():
    grid = ProbabilityGrid(RESOLUTION)
    insert(grid, (0.0, 0.0), [(0.3, 0.0)], [(0.0, 0.2)])
    assert probability(grid, 3, 0) == pytest.approx(0.6)
    for cell in ((0, 0), (1, 0), (2, 0), (0, 1), (0, 2)):
        assert probability(grid, *cell) == pytest.approx(0.45)
    assert np.count_nonzero(grid.cells) == 6


def test_a_later_scan_multiplies_the_odds_and_keeps_the_rest():
    grid = ProbabilityGrid(RESOLUTION)
    insert(grid, (0.0, 0.0), [(0.3, 0.0)])
    insert(grid, (20.0, 20.0), [(20.3, 20.0)])  # far off: the grid must grow
    insert(grid, (0.0, 0.0), [(0.3, 0.0)])
    assert probability(grid, 3, 0) == pytest.approx(0.36 / (0.36 + 0.16))
    assert probability(grid, 203, 200) == pytest.approx(0.6)


@pytest.mark.parametrize("times", [2, 4])
def test_a_weight_stands_for_that_many_scans(times):
    weighted, repeated = ProbabilityGrid(RESOLUTION), ProbabilityGrid(RESOLUTION)
    cells = scan_cells(Pose(0, 0, 0), points([(0.3, 0.0)]), points([(0.0, 0.2)]), RESOLUTION)
    insert_cells(weighted, cells, CONFIG, weight=float(times))
    for _ in range(times):
        insert_cells(repeated, cells, CONFIG)
    assert weighted.cells == pytest.approx(repeated.cells, abs=1e-6)


def test_contradicting_scans_cancel():
    grid = ProbabilityGrid(RESOLUTION)
    config = SubmapConfig(resolution=RESOLUTION, hit_probability=0.6, miss_probability=0.4)
    for returns, misses in ([(0.3, 0.0)], []), ([], [(0.5, 0.0)]):
        cells = scan_cells(Pose(0, 0, 0), points(returns), points(misses), RESOLUTION)
        insert_cells(grid, cells, config)
    assert probability(grid, 3, 0) == pytest.approx(0.5)


def test_probabilities_stay_within_the_clamp():
    grid = ProbabilityGrid(RESOLUTION)
    for _ in range(60):
        insert(grid, (0.0, 0.0), [(0.3, 0.0)])
    known = grid.cells[grid.cells > 0.0]
    assert known.min() == np.float32(MIN_PROBABILITY)
    assert known.max() == np.float32(MAX_PROBABILITY)


def test_a_scan_without_any_ray_changes_nothing():
    grid = ProbabilityGrid(RESOLUTION)
    insert(grid, (1.0, 2.0), [])
    assert grid.cells.size == 0


def test_a_full_scan_leaves_no_hole():
    angles = np.linspace(0.0, math.tau, 361)[:-1]
    circle = 2.0 * np.column_stack((np.cos(angles), np.sin(angles)))
    grid = ProbabilityGrid(RESOLUTION)
    insert(grid, (0.0, 0.0), circle)
    rows, cols = np.indices(grid.cells.shape)
    distance = RESOLUTION * np.hypot(cols + grid.first_col, rows + grid.first_row)
    assert (grid.cells[distance < 1.8] == np.float32(0.45)).all()
    assert (grid.cells[distance > 2.2] == 0.0).all()


@pytest.mark.parametrize("place", [(2e3, 2e3), (-2e3, 2e3), (1e12, 0.0), (0.0, -1e300)])
def test_a_grid_does_not_grow_beyond_the_largest_submap(place):
    grid = ProbabilityGrid(RESOLUTION)
    insert(grid, (0.0, 0.0), [(1.0, 0.0)])
    before = grid.cells.copy()
    with pytest.raises(InputError, match=r"start|a submap would be"):
        insert(grid, place, [place])
    assert np.array_equal(grid.cells, before)


def test_a_grid_grows_to_the_size_of_the_largest_submaps():
    grid = ProbabilityGrid(RESOLUTION)
    insert(grid, (0.0, 0.0), [(1.0, 0.0)])
    insert(grid, (500.0, 0.0), [(500.0, 30.0)])
    assert probability(grid, 5000, 300) == pytest.approx(0.6)
