# SPDX-License-Identifier: Apache-2.0
"""Voxel filters: one point a cell, the middle one; and the coarsest that keeps enough."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cartoloop.kernels.voxel_filter import adaptive_voxel_filter, voxel_filter
from tests.reference.naive_voxel_filter import naive_voxel_filter

coordinate = st.one_of(st.floats(-3.0, 3.0), st.integers(-6, 6).map(lambda halves: halves / 2))
point_lists = st.lists(st.tuples(coordinate, coordinate), max_size=60)
NO_LIMIT = 1e3


def thinned(points, edge):
    points = np.array(points, dtype=np.float64).reshape(-1, 2)
    out = np.empty_like(points)
    return out[: voxel_filter(points, len(points), edge, out)]


def adaptively_thinned(points, max_length, min_num_points, max_range=NO_LIMIT):
    points = np.array(points, dtype=np.float64).reshape(-1, 2)
    out = np.empty_like(points)
    return out[: adaptive_voxel_filter(points, max_length, min_num_points, max_range, out)]


@settings(deadline=None, max_examples=100)
@given(points=point_lists, edge=st.sampled_from((0.025, 0.3, 0.5, 2.0)))
def test_equals_the_middle_point_of_each_cell(points, edge):
    assert [tuple(point) for point in thinned(points, edge).tolist()] == naive_voxel_filter(
        points, edge
    )


def test_thinning_does_not_turn_noisy_walls():
    angles = np.radians(np.arange(-60.0, 60.0, 0.25))
    ranges = 3.0 / np.cos(angles)
    beams = np.column_stack((np.cos(angles), np.sin(angles)))
    rng = np.random.default_rng(5)
    turns = []
    for _ in range(300):
        shift = rng.uniform(0.0, 0.1, 2)
        noisy = (ranges + 0.02 * rng.standard_normal(len(ranges)))[:, np.newaxis] * beams + shift
        kept = thinned(noisy, 0.1)
        turns.append(np.polyfit(kept[:, 1], kept[:, 0], 1)[0])
    # The first points of the cells turn it by tens of times this.
    assert abs(np.mean(turns)) < 3.0 * np.std(turns) / np.sqrt(len(turns))


@settings(deadline=None, max_examples=30)
@given(points=point_lists)
def test_filtering_works_in_place(points):
    expected = thinned(points, 0.5)
    in_place = np.array(points, dtype=np.float64).reshape(-1, 2)
    kept = voxel_filter(in_place, len(in_place), 0.5, in_place)
    assert np.array_equal(in_place[:kept], expected)


def test_points_beyond_the_number_given_do_not_count():
    points = np.array([[0.0, 0.0], [1.0, 0.0], [2.0, 0.0]])
    out = np.empty((3, 2))
    assert voxel_filter(points, 2, 0.5, out) == 2


def test_cells_either_side_of_zero_are_two():
    assert len(thinned([(0.01, 0.01), (-0.01, 0.01), (0.01, -0.01), (-0.01, -0.01)], 0.5)) == 4


def test_cells_whose_keys_fall_into_one_slot_are_kept_apart():
    rows = np.arange(4096)
    points = np.column_stack((rows % 64, rows // 64)) * 16.0 + 0.5
    assert len(thinned(points, 1.0)) == 4096


def test_points_kilometres_away_are_distinguished():
    far = 5e5
    points = [(far, far), (far + 0.03, far), (far, -far), (-far, far), (far, far)]
    assert len(thinned(points, 0.025)) == 4


@settings(deadline=None, max_examples=100)
@given(
    points=point_lists,
    max_length=st.sampled_from((0.5, 3.0)),
    min_num_points=st.integers(1, 60),
    max_range=st.sampled_from((1.0, 2.5, NO_LIMIT)),
)
def test_the_adaptive_filter_keeps_enough_points(points, max_length, min_num_points, max_range):
    near = [(x, y) for x, y in points if x * x + y * y <= max_range * max_range]
    kept = [
        tuple(point)
        for point in adaptively_thinned(points, max_length, min_num_points, max_range).tolist()
    ]
    assert len(kept) >= min(min_num_points, len(near))
    remaining = iter(near)
    assert all(point in remaining for point in kept), "not a subset in the points' order"


def test_the_adaptive_filter_is_as_coarse_as_allowed():
    points = np.random.default_rng(5).uniform(-4.0, 4.0, (500, 2))
    coarsest = thinned(points, 0.5)
    assert np.array_equal(adaptively_thinned(points, 0.5, len(coarsest)), coarsest)


@pytest.mark.parametrize("wanted", [35, 60, 100, 170, 300])
def test_the_adaptive_filter_keeps_few_points_too_many(wanted):
    points = np.random.default_rng(5).uniform(-1.0, 1.0, (2000, 2))
    assert wanted <= len(adaptively_thinned(points, 1.0, wanted)) <= 1.35 * wanted + 5


@pytest.mark.parametrize("spread", [1e-3, 0.0])
def test_the_adaptive_filter_keeps_enough_close_points(spread):
    points = np.random.default_rng(5).uniform(0.0, spread, (300, 2))
    assert len(adaptively_thinned(points, 0.5, 200)) >= 200
