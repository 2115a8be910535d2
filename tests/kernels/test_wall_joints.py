# SPDX-License-Identifier: Apache-2.0
"""Points on straight walls between the returns of neighbouring beams."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from cartoloop.kernels.wall_joints import wall_joints
from tests.reference.naive_wall_joints import bend, naive_wall_joints

MAX_GAP, MAX_BEND, SPACING = 0.4, math.radians(15.0), 0.05
SURE = 1e-6

step = st.tuples(st.floats(0.0, 0.5), st.floats(-0.6, 0.6))
"""Length of a line, and by how much it is turned against the one before."""


def joints(returns):
    points = np.array(returns, dtype=np.float64).reshape(-1, 2)
    return wall_joints(points, MAX_GAP, math.cos(MAX_BEND), SPACING)


def path(steps):
    """Return the corners of a path of lines."""
    corners, heading = [(0.0, 0.0)], 0.0
    for length, turn in steps:
        heading += turn
        x, y = corners[-1]
        corners.append((x + length * math.cos(heading), y + length * math.sin(heading)))
    return corners


def wall(gap, number):
    return [(3.0, gap * k) for k in range(number)]


@settings(deadline=None, max_examples=200)
@given(steps=st.lists(step, max_size=12))
def test_equals_the_naive_joints(steps):
    returns = path(steps)
    lines = list(itertools.pairwise(returns))
    lengths = [math.dist(*line) for line in lines]
    bends = [bend(*pair) for pair in itertools.pairwise(lines)]
    assume(all(abs(length - MAX_GAP) > SURE for length in lengths))
    assume(all(abs(length / SPACING - round(length / SPACING)) > SURE for length in lengths))
    assume(all(abs(angle - MAX_BEND) > SURE for angle in bends))
    assume(all(length > SURE for length in lengths))
    expected = naive_wall_joints(returns, MAX_GAP, MAX_BEND, SPACING)
    assert joints(returns) == pytest.approx(np.array(expected).reshape(-1, 2), abs=1e-12)


def test_a_wall_is_closed_between_its_inner_returns():
    found = joints(wall(0.14, 5))
    assert found[:, 0] == pytest.approx(3.0)
    third = 0.14 / 3
    expected = [0.14 + third, 0.14 + 2 * third, 0.28 + third, 0.28 + 2 * third]
    assert found[:, 1] == pytest.approx(expected)


@pytest.mark.parametrize("number", [0, 1, 2, 3])
def test_few_returns_have_no_joints(number):
    assert joints(wall(0.2, number)).shape == (0, 2)


def test_returns_a_pixel_apart_need_no_joints():
    assert len(joints(wall(0.04, 30))) == 0


def test_a_gap_too_wide_for_one_wall_stays_open():
    assert len(joints(wall(0.45, 30))) == 0


def test_a_door_between_two_walls_stays_open():
    walls = wall(0.1, 6) + [(3.0, 1.4 + 0.1 * k) for k in range(6)]
    found = joints(walls)
    assert not ((found[:, 1] > 0.5) & (found[:, 1] < 1.4)).any()
    assert len(found) > 0


def test_a_corner_stays_open():
    corner = [(0.2 * k, 0.0) for k in range(4)] + [(0.6, 0.2 * k) for k in range(1, 5)]
    found = joints(corner)
    assert len(found) > 0
    assert not ((found[:, 0] > 0.4) & (found[:, 1] < 0.2)).any()


def test_a_row_of_table_legs_is_no_wall():
    legs = [(0.0, 0.0), (0.25, 0.2), (0.5, -0.1), (0.75, 0.2), (1.0, 0.0)]
    assert len(joints(legs)) == 0
