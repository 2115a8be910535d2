# SPDX-License-Identifier: Apache-2.0
"""Points behind the straight walls of a scan."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cartoloop.kernels.behind_walls import MAX_BEAMS, points_behind_walls
from tests.reference.naive_behind_walls import naive_points_behind_walls

REACH, STRAIGHTNESS, DEPTH = 0.3, 0.9, 0.05


def behind(returns, origin=(0.0, 0.0)):
    points = np.array(returns, dtype=np.float64).reshape(-1, 2)
    return points_behind_walls(*origin, points, REACH, STRAIGHTNESS, DEPTH)


def wall(spacing, number, noise=0.0):
    rng = np.random.default_rng(0)
    return [
        (3.0 + noise * rng.standard_normal(), spacing * (k - number // 2)) for k in range(number)
    ]


@settings(deadline=None, max_examples=100)
@given(
    seed=st.integers(0, 1 << 32),
    number=st.integers(0, 60),
    spacing=st.floats(0.005, 0.6),
    bend=st.floats(0.0, 0.5),
)
def test_equals_the_naive_points(seed, number, spacing, bend):
    rng = np.random.default_rng(seed)
    headings = np.cumsum(bend * rng.standard_normal(number))
    steps = np.column_stack((np.cos(headings), np.sin(headings))) * rng.uniform(
        0.5, 1.5, (number, 1)
    )
    returns, origin = spacing * np.cumsum(steps, axis=0), tuple(rng.uniform(-2.0, 2.0, 2))
    rows = [tuple(row) for row in returns.tolist()]
    expected = naive_points_behind_walls(origin, rows, REACH, STRAIGHTNESS, DEPTH, MAX_BEAMS)
    assert behind(returns, origin) == pytest.approx(np.array(expected).reshape(-1, 2), abs=1e-9)


@pytest.mark.parametrize("spacing", [0.02, 0.1, 0.25, 0.6])
def test_a_wall_has_points_behind_it_on_the_far_side(spacing):
    returns = wall(spacing, 9)
    found = behind(returns)
    assert found[:, 0] == pytest.approx(3.0 + DEPTH)
    assert found[:, 1] == pytest.approx([y for _, y in returns[1:-1]])
    assert behind(returns, origin=(5.0, 0.0))[:, 0] == pytest.approx(3.0 - DEPTH)


def test_noise_hardly_turns_the_wall():
    returns = wall(0.03, 40, noise=0.02)
    found = behind(returns)
    assert len(found) == len(returns) - 2
    assert found[:, 0] - np.array(returns)[1:-1, 0] == pytest.approx(DEPTH, abs=0.01)


def test_corners_and_returns_far_apart_are_no_walls():
    corner = [(2.0, 0.3), (2.0, 0.0), (1.7, 0.0)]
    assert len(behind(corner)) == 0
    assert len(behind(wall(1.0, 5))) == 0


@pytest.mark.parametrize("number", [0, 1, 2])
def test_few_returns_are_no_wall(number):
    assert behind(wall(0.1, number)).shape == (0, 2)


def test_near_a_corner_there_is_no_wall():
    returns = [(2.0, 0.1 * k) for k in range(-9, 1)] + [(2.0 - 0.1 * k, 0.0) for k in range(1, 10)]
    found = behind(returns)
    assert np.isclose(found[:, 0], 2.0 + DEPTH).sum() == 6
    assert np.isclose(found[:, 1], DEPTH).sum() == 6
