# SPDX-License-Identifier: Apache-2.0
"""Single rays among walls."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cartoloop.kernels.ray_ranges import ray_ranges
from tests.reference.naive_wall_ranges import naive_wall_ranges

coordinate = st.integers(-60, 60).map(lambda tenth: tenth / 10)
place = st.integers(-60, 60).map(lambda tenth: tenth / 10 + 0.0371)


def cast(walls, rays, range_max=12.0):
    ranges = np.empty(len(rays))
    ray_ranges(np.array(walls, dtype=float), np.array(rays, dtype=float), range_max, ranges)
    return ranges


@settings(deadline=None, max_examples=100)
@given(
    walls=st.lists(st.tuples(*(coordinate,) * 4), min_size=1, max_size=10),
    # Neither on a line through a wall nor along one: there rounding decides what is met.
    x=place,
    y=place,
    angle=st.integers(-30, 30).map(lambda tenth: 0.1 * tenth + 0.0123),
)
def test_ranges_are_those_of_the_naive_intersection(walls, x, y, angle):
    walls = np.array(walls)
    along = walls[:, 2:] - walls[:, :2]
    ranges = cast(walls, [(x, y, math.cos(angle), math.sin(angle))])

    def longer(by):
        size = np.maximum(np.hypot(along[:, 0], along[:, 1]), 1e-3)[:, None]
        more = by * along / size
        return np.hstack((walls[:, :2] - more, walls[:, 2:] + more))

    pose = np.array([(x, y, angle)])
    # At a wall's very end rounding decides: longer walls bound the range below, shorter above.
    nearest = naive_wall_ranges(longer(1e-6), pose, np.zeros(1), 12.0 + 1e-6)[0]
    farthest = naive_wall_ranges(longer(-1e-6), pose, np.zeros(1), 12.0 - 1e-6)[0]
    assert nearest[0] - 1e-6 <= ranges[0] <= farthest[0] + 1e-6


def test_the_nearest_wall_ahead_is_hit_and_none_behind():
    walls = [(2.0, -1.0, 2.0, 1.0), (5.0, -1.0, 5.0, 1.0), (-1.0, -1.0, -1.0, 1.0)]
    assert cast(walls, [(0.0, 0.0, 1.0, 0.0), (3.0, 0.0, 1.0, 0.0)]).tolist() == [2.0, 2.0]


def test_walls_beyond_the_maximum_range_are_not_hit():
    assert cast([(13.0, -1.0, 13.0, 1.0)], [(0.0, 0.0, 1.0, 0.0)]) == pytest.approx([np.inf])
