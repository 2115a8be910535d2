# SPDX-License-Identifier: Apache-2.0
"""The correlative matcher against an exhaustive search written plainly."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cartoloop.kernels.correlative import match_correlative, window_sums
from tests.reference.naive_correlative import naive_scores, nearest_probability

UNKNOWN, RESOLUTION = 0.1, 0.05
ORIGIN = (-0.4, 0.25)

seeds = st.integers(0, 2**32 - 1)


def random_grid(rng, shape=(14, 17)):
    grid = rng.uniform(0.1, 0.9, shape)
    grid[rng.random(shape) < 0.4] = 0.0
    return grid.astype(np.float32)


def match(grid, points, estimate, half_width, half_turns, step, weights=(0.0, 0.0)):
    pose = np.full(3, np.nan)
    score = match_correlative(
        grid,
        UNKNOWN,
        *ORIGIN,
        RESOLUTION,
        np.array(points, dtype=np.float64),
        np.array(estimate, dtype=np.float64),
        half_width,
        half_turns,
        step,
        *weights,
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


@settings(deadline=None, max_examples=40)
@given(
    seed=seeds,
    cells=st.lists(st.tuples(st.integers(-9, 25), st.integers(-9, 22)), max_size=12),
    half_width=st.integers(0, 4),
)
def test_the_sums_of_a_window_equal_one_look_up_after_the_other(seed, cells, half_width):
    grid = random_grid(np.random.default_rng(seed))
    steps = range(-half_width, half_width + 1)
    expected = [
        [sum(nearest_probability(grid, UNKNOWN, c + dx, r + dy) for c, r in cells) for dx in steps]
        for dy in steps
    ]
    sums = np.full((2 * half_width + 1,) * 2, np.nan, dtype=np.float32)
    cols, rows = np.array(cells, dtype=np.int64).reshape(-1, 2).T.copy()
    window_sums(grid, np.float32(UNKNOWN), cols, rows, half_width, sums)
    assert sums == pytest.approx(np.array(expected), rel=1e-5)


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


def test_where_nothing_is_known_the_estimate_itself_is_the_match():
    grid = np.zeros((5, 5), dtype=np.float32)
    pose, score = match(grid, [(0.1, 0.2)], (3.0, 4.0, 0.5), 2, 2, 0.1, (0.1, 0.1))
    assert pose == pytest.approx((3.0, 4.0, 0.5))
    assert score == pytest.approx(UNKNOWN)
