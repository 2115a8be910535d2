# SPDX-License-Identifier: Apache-2.0
"""The directions of the straight walls that the points of a scan lie on."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cartoloop.kernels.wall_directions import (
    MAX_SPACING_RATIO,
    REACH_M,
    SPARSE_REACH_M,
    wall_directions,
)
from tests.reference.naive_wall_directions import naive_wall_directions


def directions_of(points):
    """The angle of the wall at each point, NaN where there is none."""
    double = np.full((2, len(points)), np.nan)
    wall_directions(np.asarray(points, dtype=np.float64), double)
    is_wall = np.hypot(*double) > 0.5
    return np.where(is_wall, 0.5 * np.arctan2(double[1], double[0]), np.nan)


def difference(angles, others):
    """The angle between directions without a sense."""
    return np.abs(np.remainder(angles - others + 0.5 * np.pi, np.pi) - 0.5 * np.pi)


@settings(deadline=None, max_examples=60)
@given(
    seed=st.integers(0, 2**32 - 1),
    num_points=st.integers(0, 40),
    spacing=st.floats(0.05, 0.6),
    noise=st.floats(0.002, 0.06),
)
def test_directions_equal_those_of_the_reference(seed, num_points, spacing, noise):
    rng = np.random.default_rng(seed)
    headings = np.cumsum(rng.choice([0.0, 0.0, 0.0, 1.2], num_points))
    steps = spacing * rng.uniform(0.5, 1.5, num_points)
    points = np.cumsum(np.stack((steps * np.cos(headings), steps * np.sin(headings)), -1), axis=0)
    points += rng.normal(0.0, noise, points.shape)
    found, expected = directions_of(points), naive_wall_directions(points)
    assert (np.isnan(found) == np.isnan(expected)).all()
    is_wall = ~np.isnan(expected)
    assert difference(found[is_wall], expected[is_wall]) == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("angle", [0.0, 0.7, 0.5 * math.pi, 3.0, -2.0])
def test_points_between_others_on_a_wall_have_its_direction(angle):
    along = np.linspace(-1.0, 1.0, 21)[:, None]
    found = directions_of(along * (math.cos(angle), math.sin(angle)) + (5.0, -3.0))
    assert np.isnan(found[[0, -1]]).all()
    assert difference(found[1:-1], angle) == pytest.approx(0.0, abs=1e-9)


def test_points_next_to_a_corner_lie_on_no_straight_wall():
    along = np.arange(0.05, 1.0, 0.1)
    points = np.concatenate(
        (np.stack((-along[::-1], 0.0 * along), -1), np.stack((0.0 * along, along), -1))
    )
    is_straight = ~np.isnan(directions_of(points))
    from_corner = np.linalg.norm(points, axis=1)
    assert not is_straight[from_corner < 0.5 * REACH_M].any()
    assert is_straight[(from_corner > REACH_M) & (from_corner < 0.9)].all()


@pytest.mark.parametrize(("spacing", "is_wall"), [(0.95, True), (1.05, False)])
def test_sparse_points_are_joined_up_to_a_limit(spacing, is_wall):
    points = spacing * SPARSE_REACH_M * np.stack((np.arange(5.0), np.zeros(5)), -1)
    assert (~np.isnan(directions_of(points)[1:-1]) == is_wall).all()


@pytest.mark.parametrize(("ratio", "is_wall"), [(0.95, True), (1.05, False)])
def test_points_beside_an_opening_lie_on_no_straight_wall(ratio, is_wall):
    x = np.array((-1.0, -0.5, 0.0, 0.5 * ratio * MAX_SPACING_RATIO))
    points = np.stack((x, np.zeros(4)), -1)
    assert ~np.isnan(directions_of(points)[2]) == is_wall


def test_equal_points_lie_on_no_wall():
    assert np.isnan(directions_of(np.ones((5, 2)))).all()
