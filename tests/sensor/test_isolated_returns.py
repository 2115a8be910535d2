# SPDX-License-Identifier: Apache-2.0
"""Returns with no neighbour near."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cartoloop.sensor.isolated_returns import (
    MIN_RETURNS,
    NEAR_M,
    NEAR_SPACINGS,
    without_isolated,
)


def wall(num_beams=181, distance=4.0):
    """Returns of a wall straight ahead, beams over 120 degrees."""
    angles = np.radians(np.linspace(-60.0, 60.0, num_beams))
    return np.column_stack((np.full(num_beams, distance), distance * np.tan(angles)))


def slowly_without_isolated(returns):
    """The same, each return compared with its neighbours in turn."""
    order = sorted(range(len(returns)), key=lambda i: math.atan2(returns[i][1], returns[i][0]))
    angles = [math.atan2(returns[i][1], returns[i][0]) for i in order]
    spacing = float(np.median([b - a for a, b in itertools.pairwise(angles)]))
    kept = []
    for k, i in enumerate(order):
        limit = NEAR_M + NEAR_SPACINGS * spacing * math.hypot(*returns[i])
        neighbours = [order[j] for j in (k - 1, k + 1) if 0 <= j < len(order)]
        if any(math.dist(returns[i], returns[j]) <= limit for j in neighbours):
            kept.append(i)
    return [returns[i].tolist() for i in sorted(kept)]


@given(st.integers(0, 1000), st.integers(MIN_RETURNS, 60))
def test_each_return_is_compared_with_its_neighbours(seed, count):
    returns = np.random.default_rng(seed).normal(0.0, 5.0, (count, 2))
    assert without_isolated(returns).tolist() == slowly_without_isolated(returns)


@pytest.mark.parametrize("num_beams", [31, 181, 721])
def test_a_wall_is_kept(num_beams):
    assert len(without_isolated(wall(num_beams))) == num_beams


def test_a_wall_with_missing_returns_is_kept():
    points = wall()[np.random.default_rng(1).random(181) > 0.15]
    assert len(without_isolated(points)) == len(points)


def test_returns_before_a_wall_are_left_out():
    points = wall()
    is_wrong = np.zeros(len(points), dtype=bool)
    is_wrong[10::30] = True
    points[is_wrong] *= 0.4
    assert np.array_equal(without_isolated(points), points[~is_wrong])


def test_a_post_that_two_beams_meet_is_kept():
    points = wall()
    points[90:92] *= 0.5
    assert len(without_isolated(points)) == len(points)


def test_of_few_returns_none_is_left_out():
    points = np.random.default_rng(2).normal(0.0, 9.0, (MIN_RETURNS - 1, 2))
    assert without_isolated(points) is points
