# SPDX-License-Identifier: Apache-2.0
"""The correlative matcher against an exhaustive search written plainly."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cartoloop.kernels.correlative import (
    CorrelativeScratch,
    CorrelativeWindow,
    match_correlative,
)
from cartoloop.kernels.smooth_map import SmoothMap
from cartoloop.kernels.window_bounds import (
    GridPart,
    box_sizes,
    index_points,
    keep_higher,
    least_byte,
    quantize_cells,
)
from tests.reference.naive_correlative import exhaustive_match, naive_scores, nearest_probability

UNKNOWN, RESOLUTION = 0.1, 0.05
ORIGIN = (-0.4, 0.25)

seeds = st.integers(0, 2**32 - 1)


def random_grid(rng, shape=(14, 17)):
    grid = rng.uniform(0.1, 0.9, shape)
    grid[rng.random(shape) < 0.4] = 0.0
    return grid.astype(np.float32)


def match(grid, points, estimate, half_width, half_turns, step, weights=(0.0, 0.0)):
    pose = np.full(3, np.nan)
    width = 2 * half_width + 1
    num_cells = (grid.shape[0] + 2 * width) * (grid.shape[1] + 2 * width)
    score = match_correlative(
        SmoothMap(grid, *ORIGIN, RESOLUTION),
        UNKNOWN,
        np.array(points, dtype=np.float64),
        np.array(estimate, dtype=np.float64),
        CorrelativeWindow(half_width, half_turns, step, *weights),
        CorrelativeScratch(
            np.empty(3 * len(points) * (2 * half_turns + 1), dtype=np.int32),
            np.empty(len(box_sizes(width)) * num_cells, dtype=np.uint8),
        ),
        pose,
    )
    return pose, score


@settings(deadline=None, max_examples=40)
@given(
    seed=seeds,
    # The grid is less than a metre wide: many windows lie partly or wholly outside of it.
    x=st.floats(-1.5, 1.5),
    y=st.floats(-1.0, 2.0),
    theta=st.floats(-4.0, 4.0),
    num_points=st.integers(1, 10),
    half_width=st.integers(0, 3),
    half_turns=st.integers(0, 2),
    weights=st.tuples(st.floats(0.0, 5.0), st.floats(0.0, 5.0)),
)
def test_the_best_candidate_equals_that_of_an_exhaustive_search(
    seed, x, y, theta, num_points, half_width, half_turns, weights
):
    rng = np.random.default_rng(seed)
    grid, points, step = random_grid(rng), rng.uniform(-0.5, 0.5, (num_points, 2)), 0.07
    rotations = {turn: turn * step for turn in range(-half_turns, half_turns + 1)}
    scores = naive_scores(
        grid, UNKNOWN, ORIGIN, RESOLUTION, points, (x, y, theta), half_width, rotations
    )
    weighted = {
        (dx, dy, turn): score
        * math.exp(
            -((weights[0] * RESOLUTION * math.hypot(dx, dy) + weights[1] * abs(turn) * step) ** 2)
        )
        for (dx, dy, turn), score in scores.items()
    }

    pose, score = match(grid, points, (x, y, theta), half_width, half_turns, step, weights)

    found = (
        round((pose[0] - x) / RESOLUTION),
        round((pose[1] - y) / RESOLUTION),
        round((pose[2] - theta) / step),
    )
    # Candidates may be equally good: the one found must be among the best.
    assert weighted[found] == pytest.approx(max(weighted.values()), rel=1e-5)
    assert score == pytest.approx(scores[found], rel=1e-5)
    steps = np.array(found) * (RESOLUTION, RESOLUTION, step)
    assert pose == pytest.approx(np.array((x, y, theta)) + steps, abs=1e-12)


def plateau_grid(rng, num_values):
    """A grid of few different values: many candidates are equally good."""
    values = rng.choice((0.0, 0.1, 0.3, 0.55, 0.9), num_values, replace=False)
    return rng.choice(values, (14, 17)).astype(np.float32)


@settings(deadline=None, max_examples=150)
@given(
    seed=seeds,
    x=st.floats(-1.5, 1.5),
    y=st.floats(-1.0, 2.0),
    theta=st.floats(-4.0, 4.0),
    num_points=st.integers(1, 40),
    half_width=st.integers(0, 6),
    half_turns=st.integers(0, 4),
    weights=st.just((0.0, 0.0)) | st.tuples(st.floats(0.0, 5.0), st.floats(0.0, 5.0)),
    num_values=st.integers(1, 5) | st.none(),
)
def test_match_is_the_first_best_candidate_to_the_last_bit(
    seed, x, y, theta, num_points, half_width, half_turns, weights, num_values
):
    rng = np.random.default_rng(seed)
    grid = random_grid(rng) if num_values is None else plateau_grid(rng, num_values)
    points, step, estimate = rng.uniform(-0.5, 0.5, (num_points, 2)), 0.07, (x, y, theta)

    pose, score = match(grid, points, estimate, half_width, half_turns, step, weights)

    expected, expected_score = exhaustive_match(
        grid, UNKNOWN, ORIGIN, RESOLUTION, points, estimate, half_width, half_turns, step, weights
    )
    assert tuple(pose) == expected
    assert score == expected_score


@settings(deadline=None, max_examples=60)
@given(
    seed=seeds,
    first_col=st.integers(-25, 25),
    first_row=st.integers(-25, 25),
    shape=st.tuples(st.integers(1, 20), st.integers(1, 20)),
)
def test_bytes_are_probabilities_rounded_up(seed, first_col, first_row, shape):
    grid = random_grid(np.random.default_rng(seed))
    cells = np.zeros(shape[0] * shape[1], dtype=np.uint8)
    quantize_cells(grid, UNKNOWN, GridPart(first_col, first_row, shape[1], shape[0]), cells)
    exact = np.array(
        [
            [
                nearest_probability(grid, UNKNOWN, first_col + c, first_row + r)
                for c in range(shape[1])
            ]
            for r in range(shape[0])
        ]
    )
    excess = cells.reshape(shape) - 255.0 * exact
    assert (excess >= -1e-4).all()
    assert (excess < 1.0 + 1e-4).all()


@given(values=st.lists(st.integers(26, 40), min_size=1, max_size=30), first=st.integers(0, 3))
def test_points_above_the_least_byte_are_moved_in_front(values, first):
    cells = np.array([0, *values], dtype=np.uint8)
    index = np.arange(1 - first, len(values) + 1, dtype=np.int32)
    least = least_byte(UNKNOWN)
    total, count = keep_higher(cells, index, first, len(values), least)
    assert total == sum(values)
    assert cells[index[first : first + count]].tolist() == [v for v in values if v > least]


@pytest.mark.parametrize("width", range(1, 30))
def test_boxes_shrink_to_single_cells_and_quarters_cover_them(width):
    sizes = box_sizes(width).tolist()
    assert sizes[0] == width
    assert sizes[-1] == 1
    assert all(half < size <= 2 * half for size, half in pairwise(sizes))


@settings(deadline=None, max_examples=60)
@given(
    cells=st.lists(st.tuples(st.integers(-40, 50), st.integers(-40, 50)), min_size=1, max_size=12),
    half_width=st.integers(0, 6),
)
def test_grid_part_holds_all_windows_that_touch_the_grid(cells, half_width):
    num_cols, num_rows, width = 17, 14, 2 * half_width + 1
    cols, rows = np.array(cells, dtype=np.int32).T.copy()
    index = np.full(len(cells), -1, dtype=np.int32)
    first_col, first_row, row_length, height = index_points(
        cols, rows, half_width, num_cols, num_rows, index
    )
    for (col, row), at in zip(cells, index.tolist(), strict=True):
        in_row, in_col = divmod(at, row_length)
        assert 0 <= in_col <= row_length - width
        assert 0 <= in_row <= height - width
        for first, begin, found, size in (
            (col, first_col, in_col, num_cols),
            (row, first_row, in_row, num_rows),
        ):
            wanted = first - half_width
            seen = begin + found
            is_outside = wanted + width <= 0 or wanted >= size
            assert (seen + width <= 0 or seen >= size) if is_outside else seen == wanted


def test_a_displaced_scan_is_found_to_the_pixel_and_the_step():
    rng = np.random.default_rng(2)
    points = rng.uniform(-0.3, 0.3, (12, 2))
    theta, step = 0.4, 0.05
    truth = (0.02, 0.55, theta + 2 * step)
    grid = np.full((14, 17), 0.1, dtype=np.float32)
    cos, sin = math.cos(truth[2]), math.sin(truth[2])
    seen = points @ np.array([[cos, sin], [-sin, cos]]) + truth[:2]
    cols, rows = np.floor((seen - ORIGIN) / RESOLUTION + 0.5).astype(int).T
    grid[rows, cols] = 0.9

    pose, score = match(
        grid, points, (truth[0] + 0.1, truth[1] - 0.05, theta), 3, 3, step, (0.1, 0.1)
    )

    assert pose == pytest.approx(truth, abs=1e-9)
    assert score == pytest.approx(0.9)


def test_in_unknown_space_the_estimate_is_the_match():
    grid = np.zeros((5, 5), dtype=np.float32)
    pose, score = match(grid, [(0.1, 0.2)], (3.0, 4.0, 0.5), 2, 2, 0.1, (0.1, 0.1))
    assert pose == pytest.approx((3.0, 4.0, 0.5))
    assert score == pytest.approx(UNKNOWN)
