# SPDX-License-Identifier: Apache-2.0
"""The meaning of each kind of range: a hit, free space, or nothing (REP 117)."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cartoloop.kernels.range_projection import (
    Position,
    RangeLimits,
    project_and_thin,
    project_ranges,
)
from cartoloop.kernels.voxel_filter import voxel_filter

MIN_RANGE, MAX_RANGE, NO_RETURN, FREE = 0.5, 10.0, 20.0, 4.0
AHEAD = np.array([[1.0, 0.0]])


def project(
    ranges,
    directions=None,
    no_return=NO_RETURN,
    no_return_is_free=True,
    free=FREE,
    origin=(0.0, 0.0),
    agreeing=0,
):
    ranges = np.array(ranges, dtype=np.float64)
    if directions is None:
        directions = np.repeat(AHEAD, len(ranges), axis=0)
    returns, misses = np.empty((len(ranges), 2)), np.empty((len(ranges), 2))
    num_returns, num_misses = project_ranges(
        ranges,
        directions,
        Position(*origin, 0.0),
        RangeLimits(MIN_RANGE, MAX_RANGE, no_return, no_return_is_free, free, agreeing),
        returns,
        misses,
    )
    return returns[:num_returns], misses[:num_misses]


@pytest.mark.parametrize("measured", [MIN_RANGE, 3.0, MAX_RANGE])
def test_a_range_within_the_limits_is_a_hit(measured):
    returns, misses = project([measured])
    assert returns.tolist() == [[measured, 0.0]]
    assert len(misses) == 0


@pytest.mark.parametrize(
    "measured", [math.nan, -math.inf, -3.0, 0.0, math.nextafter(MIN_RANGE, 0.0)]
)
@pytest.mark.parametrize("is_free", [True, False])
def test_invalid_ranges_are_ignored(measured, is_free):
    returns, misses = project([measured], no_return_is_free=is_free)
    assert len(returns) == len(misses) == 0


@pytest.mark.parametrize("no_return", [NO_RETURN, math.inf])
@pytest.mark.parametrize("is_free", [True, False])
def test_infinity_clears_free_space(no_return, is_free):
    returns, misses = project([math.inf], no_return=no_return, no_return_is_free=is_free)
    assert len(returns) == 0
    assert misses.tolist() == [[FREE, 0.0]]


@pytest.mark.parametrize("measured", [math.nextafter(MAX_RANGE, 11.0), 15.0])
@pytest.mark.parametrize("no_return", [NO_RETURN, math.inf])
@pytest.mark.parametrize("is_free", [True, False])
def test_a_hit_beyond_the_useful_range_clears_free_space(measured, no_return, is_free):
    returns, misses = project([measured], no_return=no_return, no_return_is_free=is_free)
    assert len(returns) == 0
    assert misses.tolist() == [[FREE, 0.0]]


@pytest.mark.parametrize("measured", [NO_RETURN, 81.91])
def test_the_no_return_value_clears_free_space(measured):
    returns, misses = project([measured])
    assert len(returns) == 0
    assert misses.tolist() == [[FREE, 0.0]]


@pytest.mark.parametrize("measured", [NO_RETURN, 81.91])
def test_the_no_return_value_is_ignored_if_it_is_not_free(measured):
    returns, misses = project([measured], no_return_is_free=False)
    assert len(returns) == len(misses) == 0


def test_a_no_return_value_below_the_useful_range_is_no_hit():
    returns, misses = project([5.0], no_return=5.0)
    assert len(returns) == 0
    assert misses.tolist() == [[FREE, 0.0]]


@pytest.mark.parametrize("measured", [15.0, 81.91, math.inf])
def test_a_free_ray_length_of_zero_clears_nothing(measured):
    returns, misses = project([measured], free=0.0)
    assert len(returns) == len(misses) == 0


def test_a_free_ray_is_no_longer_than_the_range():
    _, misses = project([11.0], free=15.0)
    assert misses.tolist() == [[11.0, 0.0]]


def test_beams_start_at_the_sensor_and_keep_their_order():
    directions = np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]])
    returns, misses = project([2.0, math.inf, 1.0, 50.0], directions, origin=(10.0, -5.0))
    assert returns.tolist() == [[12.0, -5.0], [9.0, -5.0]]
    assert misses.tolist() == [[10.0, -1.0], [10.0, -9.0]]


@pytest.mark.parametrize(
    ("ranges", "clear"),
    [
        ([2.0, NO_RETURN, 2.0], 0),
        ([NO_RETURN, NO_RETURN, 2.0], 1),
        ([2.0, NO_RETURN, NO_RETURN, 2.0], 0),
        ([2.0, NO_RETURN, math.inf, 81.9, 2.0], 1),
        ([FREE, NO_RETURN, 9.0], 1),
        ([2.0, 15.0, 2.0], 1),  # a return beyond the useful range is no missing one
        ([math.nan, NO_RETURN, NO_RETURN], 1),
        ([0.1, NO_RETURN, 0.1], 0),
        ([NO_RETURN], 1),
    ],
)
def test_a_missing_return_clears_what_its_neighbours_clear(ranges, clear):
    _, misses = project(ranges, agreeing=1)
    assert len(misses) == clear


def test_all_beams_within_the_angle_must_agree():
    ranges = [2.0] + [NO_RETURN] * 5 + [2.0]
    assert [len(project(ranges, agreeing=n)[1]) for n in range(4)] == [5, 3, 1, 0]


def naive_num_clear(ranges, agreeing, is_free):
    """Return how many beams clear space: a beam without a return only among those like it."""

    def agrees(r):
        missing = r >= NO_RETURN and (is_free or r == math.inf)
        return missing or FREE <= r < NO_RETURN

    num_clear = 0
    for k, r in enumerate(ranges):
        around = ranges[max(k - agreeing, 0) : k + agreeing + 1]
        num_clear += MAX_RANGE < r < NO_RETURN or (r >= NO_RETURN and all(map(agrees, around)))
    return num_clear


measured_ranges = st.one_of(
    st.floats(-1.0, 30.0), st.sampled_from((math.nan, math.inf, NO_RETURN, FREE, 2.0))
)


@settings(deadline=None, max_examples=100)
@given(
    ranges=st.lists(measured_ranges, min_size=1, max_size=30),
    agreeing=st.integers(0, 3),
    is_free=st.booleans(),
)
def test_missing_returns_equal_the_reference(ranges, agreeing, is_free):
    _, misses = project(ranges, no_return_is_free=is_free, agreeing=agreeing)
    assert len(misses) == naive_num_clear(ranges, agreeing, is_free)


@settings(deadline=None, max_examples=100)
@given(ranges=st.lists(st.floats(allow_nan=True, allow_infinity=True), max_size=30))
def test_points_are_within_the_limits_for_any_ranges(ranges):
    returns, misses = project(ranges)
    assert len(returns) + len(misses) <= len(ranges)
    assert ((returns[:, 0] >= MIN_RANGE) & (returns[:, 0] <= MAX_RANGE)).all()
    assert (misses[:, 0] == FREE).all()


@settings(deadline=None, max_examples=60)
@given(seed=st.integers(0, 2**32 - 1), num_beams=st.integers(0, 60), edge=st.floats(0.05, 2.0))
def test_one_call_projects_and_thins(seed, num_beams, edge):
    rng = np.random.default_rng(seed)
    angles = rng.uniform(-math.pi, math.pi, num_beams)
    ranges = rng.choice([0.1, 1.0, 3.0, 15.0, 25.0, math.inf, math.nan], num_beams)
    directions = np.column_stack((np.cos(angles), np.sin(angles)))
    origin = (0.3, -0.2, 0.0)
    limits = RangeLimits(MIN_RANGE, MAX_RANGE, NO_RETURN, True, FREE, 1)[:]
    ends = [np.empty((num_beams, 2)) for _ in range(4)]
    apart = project_ranges(ranges, directions, origin, limits, *ends[:2])
    kept = [
        voxel_filter(points, count, edge, points)
        for points, count in zip(ends[:2], apart, strict=True)
    ]
    assert list(project_and_thin(ranges, directions, origin, limits, edge, *ends[2:])) == kept
    for one, other, count in zip(ends[:2], ends[2:], kept, strict=True):
        assert one[:count].tolist() == other[:count].tolist()
