# SPDX-License-Identifier: Apache-2.0
"""The walls of the first scans: which returns are joined, and for how long there is a grid."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cartoloop.config import LocalSlamConfig
from cartoloop.local_slam.first_map import (
    MAX_BEND_M,
    MAX_GAP_RAD,
    MAX_LENGTH_M,
    MIN_COSINE,
    FirstMap,
    joints,
)
from cartoloop.local_slam.outline import outline_of
from cartoloop.sensor.pose import IDENTITY, Pose
from cartoloop.sensor.range_filter import RangeData
from cartoloop.submaps.submap import ActiveSubmaps

CONFIG = LocalSlamConfig()
SPACING = 0.025


def slow_joints(outline, spacing):
    """Points on the lines that :func:`joints` is to fill, one line after the other."""
    bearings, points, found = outline.bearings, outline.points, []
    for k in range(len(points) - 1):
        start, step = points[k], points[k + 1] - points[k]
        length = math.hypot(*step)
        if not (0.0 < length <= MAX_LENGTH_M and bearings[k + 1] - bearings[k] < MAX_GAP_RAD):
            continue
        goes_on = False
        for a, b in ((k - 1, k), (k + 1, k + 2)):
            if a < 0 or b >= len(points) or bearings[b] - bearings[a] >= MAX_GAP_RAD:
                continue
            other = points[b] - points[a]
            if math.hypot(*other) == 0.0:
                continue
            cosine = step @ other / length / math.hypot(*other)
            bend = abs(step[0] * other[1] - step[1] * other[0]) / length
            goes_on |= cosine > MIN_COSINE and bend < MAX_BEND_M
        if goes_on:
            count = math.ceil(length / spacing)
            found += [start + j / count * step for j in range(1, count)]
    return np.array(found).reshape(-1, 2)


@given(
    ranges=st.lists(st.floats(0.2, 20.0), min_size=2, max_size=40),
    steps=st.lists(st.sampled_from((0.3, 0.5, 1.0, 2.9, 3.1)), min_size=40, max_size=40),
    smooth=st.booleans(),
)
@settings(deadline=None, max_examples=50)
def test_joints_are_those_of_a_slow_reference(ranges, steps, smooth):
    ranges = np.array(ranges)
    if smooth:  # most lines go on straight
        ranges = ranges[0] + 0.01 * np.cumsum(ranges)
    bearings = np.radians(np.cumsum(steps[: len(ranges)]) - 60.0)
    returns = ranges[:, np.newaxis] * np.column_stack((np.cos(bearings), np.sin(bearings)))
    outline = outline_of(returns, IDENTITY)
    found, expected = joints(outline, SPACING), slow_joints(outline, SPACING)
    assert found.shape == expected.shape
    np.testing.assert_allclose(found, expected, atol=1e-9)


def wall_returns(depth=2.0):
    """Returns of a long wall beside a scanner, a degree apart."""
    bearings = np.radians(np.arange(20.0, 161.0))
    return np.column_stack((depth / np.tan(bearings), np.full(len(bearings), depth)))


def test_gaps_of_a_wall_are_filled():
    filled = joints(outline_of(wall_returns(), IDENTITY), SPACING)
    np.testing.assert_allclose(filled[:, 1], 2.0)
    along = np.sort(np.concatenate((filled[:, 0], wall_returns()[:, 0])))
    assert np.diff(along).max() <= SPACING + 1e-9


def test_a_doorway_and_an_edge_in_front_are_not_filled():
    wall = wall_returns()
    opened = wall[np.abs(wall[:, 0]) > 0.6]
    assert not np.any(np.abs(joints(outline_of(opened, IDENTITY), SPACING)[:, 0]) < 0.59)
    before = wall.copy()
    before[wall[:, 0] < 0.0] *= 0.5  # a second wall in front of the first
    heights = joints(outline_of(before, IDENTITY), SPACING)[:, 1]
    assert np.all(np.isclose(heights, 1.0) | np.isclose(heights, 2.0))


@pytest.mark.parametrize("few", [0, 3])
def test_the_grid_lasts_for_the_first_scans(few):
    prediction = CONFIG.prediction.model_copy(update={"num_young_scans": few})
    config = CONFIG.model_copy(update={"prediction": prediction})
    walls, active = FirstMap(config), ActiveSubmaps(config.submaps, 7)
    returns, nothing = wall_returns(), np.zeros((0, 2))
    for number in range(1, 6):
        pose = Pose(0.3 * number, 0.0, 0.0)
        older = active.insert(pose, returns, nothing).submaps[0]
        walls.insert(pose, RangeData(IDENTITY, returns, nothing), older)
        assert (walls.submap is not None) == (number <= few)
        if walls.submap is not None:
            assert walls.submap.tf_local_submap == older.tf_local_submap
            assert walls.submap.num_scans == number
            assert not np.any((walls.submap.grid.cells > 0.0) & (walls.submap.grid.cells < 0.5))
