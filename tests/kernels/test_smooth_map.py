# SPDX-License-Identifier: Apache-2.0
"""M_smooth of (CS) and its derivatives at the points of a scan."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cartoloop.kernels.smooth_map import (
    D_ROW,
    NOWHERE,
    NUM_ROWS,
    PATCH_CELLS,
    VALUE,
    PointScratch,
    SmoothMap,
    point_scratch,
    sample_smooth_map,
    smooth_value,
)
from tests.reference.naive_scan_residuals import (
    central_differences,
    naive_smooth_probability,
    naive_smoothed_probability,
)

UNKNOWN = 0.1
ROWS, COLS = 7, 9

seeds = st.integers(0, 2**32 - 1)


def random_grid(seed, shape=(ROWS, COLS)):
    """Probabilities, a third of the cells never observed."""
    rng = np.random.default_rng(seed)
    grid = rng.uniform(0.1, 0.9, shape)
    grid[rng.random(shape) < 0.3] = 0.0
    return grid.astype(np.float32)


def sample(grid, points, pose=(0.0, 0.0, 0.0), origin=(0.0, 0.0), resolution=1.0, smoothing=0.0):
    """Value and derivatives along columns and rows at each point, shape (n, 3)."""
    points = np.array(points, dtype=np.float64).reshape(-1, 2)
    scratch = PointScratch(
        np.empty((2, len(points)), dtype=np.int64),
        np.full((2, len(points)), NOWHERE, dtype=np.int64),
        np.full((PATCH_CELLS, len(points)), np.nan, dtype=np.float32),
        np.full((NUM_ROWS, len(points)), np.nan),
    )
    smooth_map = SmoothMap(grid, *origin, resolution, smoothing)
    sample_smooth_map(smooth_map, UNKNOWN, points, *pose, scratch)
    return scratch.samples[VALUE : D_ROW + 1].T


def smooth_probability(grid, col, row, smoothing=0.0):
    """Value and derivatives at a place in cells."""
    pose = (float(col), float(row), 0.0)
    return tuple(sample(grid, (0.0, 0.0), pose, smoothing=smoothing)[0].tolist())


# From well outside of the grid on one side to well outside on the other.
col_places = st.floats(-4.0, COLS + 3.0)
row_places = st.floats(-4.0, ROWS + 3.0)


@settings(deadline=None, max_examples=150)
@given(seed=seeds, col=col_places, row=row_places)
def test_the_smooth_map_equals_plain_bicubic_interpolation(seed, col, row):
    grid = random_grid(seed)
    expected = naive_smooth_probability(grid, UNKNOWN, col, row)
    assert smooth_probability(grid, col, row)[0] == pytest.approx(expected, abs=1e-12)


@settings(deadline=None, max_examples=200)
@given(seed=seeds, x=st.floats(-1.0, 3.0), y=st.floats(-1.0, 3.0), smoothing=st.floats(0.0, 1.0))
def test_a_single_value_is_the_same_to_the_last_bit(seed, x, y, smoothing):
    grid, origin, resolution = random_grid(seed), (0.3, -0.2), 0.25
    among_many = sample(grid, (0.0, 0.0), (x, y, 0.0), origin, resolution, smoothing)[0, 0]
    smooth_map = SmoothMap(grid, *origin, resolution, smoothing)
    assert smooth_value(smooth_map, UNKNOWN, x, y) == among_many


@settings(deadline=None, max_examples=100)
@given(seed=seeds, col=col_places, row=row_places, smoothing=st.floats(0.0, 1.0))
def test_in_full_smoothing_is_a_b_spline(seed, col, row, smoothing):
    grid = random_grid(seed)
    smoothed = naive_smoothed_probability(grid, UNKNOWN, col, row)
    assert smooth_probability(grid, col, row, 1.0)[0] == pytest.approx(smoothed, abs=1e-12)

    def value(at):
        return smooth_probability(grid, at[0], at[1], smoothing)[0]

    _, *slopes = smooth_probability(grid, col, row, smoothing)
    assert slopes == pytest.approx(central_differences(value, (col, row), 1e-6), abs=1e-5)


@settings(deadline=None, max_examples=150)
@given(seed=seeds, col=col_places, row=row_places)
def test_the_smooth_map_s_gradient_equals_finite_differences(seed, col, row):
    grid = random_grid(seed)

    def value(at):
        return naive_smooth_probability(grid, UNKNOWN, at[0], at[1])

    numeric = central_differences(value, (col, row), 1e-6)
    assert smooth_probability(grid, col, row)[1:] == pytest.approx(numeric, abs=1e-5)


@settings(deadline=None, max_examples=100)
@given(seed=seeds, border=st.integers(-3, COLS + 2), along=row_places, transposed=st.booleans())
def test_value_and_gradient_are_continuous_between_pixels(seed, border, along, transposed):
    grid = random_grid(seed, (COLS, ROWS) if transposed else (ROWS, COLS))
    places = [(border + off, along) for off in (-1e-9, 0.0, 1e-9)]
    if transposed:
        places = [place[::-1] for place in places]
    before, at, after = (smooth_probability(grid, *place) for place in places)
    assert before == pytest.approx(at, abs=1e-7)
    assert after == pytest.approx(at, abs=1e-7)


def test_the_smooth_map_goes_through_the_centres_of_cells():
    grid = random_grid(3)
    for row in range(ROWS):
        for col in range(COLS):
            expected = float(grid[row, col]) or UNKNOWN
            assert smooth_probability(grid, col, row)[0] == pytest.approx(expected)


@settings(deadline=None, max_examples=60)
@given(seed=seeds, num_points=st.integers(1, 40), reach=st.sampled_from((0.01, 0.1, 2.0)))
def test_poses_in_turn_are_sampled_as_if_alone(seed, num_points, reach):
    rng = np.random.default_rng(seed)
    grid, origin, resolution = random_grid(seed, (20, 24)), (-1.0, -1.1), 0.1
    points = rng.uniform(-1.5, 1.5, (num_points, 2))
    scratch = point_scratch(num_points)
    for pose in rng.uniform(-reach, reach, (6, 3)).tolist():
        sample_smooth_map(SmoothMap(grid, *origin, resolution), UNKNOWN, points, *pose, scratch)
        alone = sample(grid, points, pose, origin, resolution)
        assert scratch.samples[VALUE : D_ROW + 1].T.tolist() == alone.tolist()


@settings(deadline=None, max_examples=60)
@given(
    seed=seeds,
    num_points=st.integers(0, 40),
    x=st.floats(-1.5, 1.5),
    y=st.floats(-1.5, 1.5),
    theta=st.floats(-7.0, 7.0),
)
def test_each_point_of_a_scan_is_sampled_as_if_it_were_alone(seed, num_points, x, y, theta):
    grid, origin, resolution = random_grid(seed, (20, 24)), (-1.0, -1.1), 0.1
    points = np.random.default_rng(seed).uniform(-1.5, 1.5, (num_points, 2))
    together = sample(grid, points, (x, y, theta), origin, resolution)
    for point, found in zip(points, together, strict=True):
        alone = sample(grid, point, (x, y, theta), origin, resolution)[0]
        assert found.tolist() == alone.tolist()
        cos, sin = math.cos(theta), math.sin(theta)
        col = (x + cos * point[0] - sin * point[1] - origin[0]) / resolution
        row = (y + sin * point[0] + cos * point[1] - origin[1]) / resolution
        expected = naive_smooth_probability(grid, UNKNOWN, col, row)
        assert found[0] == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize("place", [(-100.0, 2.0), (3.0, -3.5), (COLS + 1.5, 2.0), (3.0, 1e6)])
def test_far_outside_the_map_is_flat(place):
    assert smooth_probability(random_grid(5), *place) == (UNKNOWN, 0.0, 0.0)
