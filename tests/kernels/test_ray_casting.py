# SPDX-License-Identifier: Apache-2.0
"""Hit and miss sets against exact geometry, eq. (2) and (3) against a slow reference."""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cartoloop.kernels.ray_casting import SUBPIXELS, mark_ray, scan_cells, update_cells
from tests.reference.naive_ray_casting import naive_ray, naive_scan_cells, naive_update

NUM_PIXELS = 8
UNMARKED = np.uint8(0)

anywhere = st.integers(SUBPIXELS, (NUM_PIXELS - 1) * SUBPIXELS - 1)
# Halves of pixels meet borders and corners all the time, where traversals go wrong.
half_pixels = st.integers(2, 2 * NUM_PIXELS - 3).map(lambda halves: halves * SUBPIXELS // 2)
beside_half_pixels = st.tuples(half_pixels, st.integers(-1, 1)).map(sum)
subpixel = st.one_of(anywhere, half_pixels, beside_half_pixels).filter(lambda s: s >= SUBPIXELS)
subpixel_point = st.tuples(subpixel, subpixel)


def ray_cells(start, end):
    """The cells that the kernel lists for one ray, in its order."""
    marks = np.zeros((NUM_PIXELS, NUM_PIXELS), dtype=np.uint8)
    cells = np.empty((NUM_PIXELS**2, 2), dtype=np.int32)
    num_cells = mark_ray(*start, *end, marks, cells, 0)
    return [(int(col), int(row)) for col, row in cells[:num_cells]]


def in_pixels(point):
    return Fraction(point[0], SUBPIXELS), Fraction(point[1], SUBPIXELS)


def pixels(*coordinates):
    """Coordinates in pixels as whole subpixels."""
    return tuple(round(c * SUBPIXELS) for c in coordinates)


@settings(deadline=None, max_examples=300)
@given(start=subpixel_point, end=subpixel_point)
def test_a_ray_lists_each_pixel_that_it_intersects_once(start, end):
    listed = ray_cells(start, end)
    assert len(set(listed)) == len(listed)
    assert set(listed) == naive_ray(in_pixels(start), in_pixels(end))


@settings(deadline=None, max_examples=100)
@given(start=subpixel_point, end=subpixel_point)
def test_a_ray_goes_from_its_start_to_its_end_by_neighbours(start, end):
    listed = np.array(ray_cells(start, end))
    assert listed[0].tolist() == [start[0] // SUBPIXELS, start[1] // SUBPIXELS]
    assert listed[-1].tolist() == [end[0] // SUBPIXELS, end[1] // SUBPIXELS]
    assert np.abs(np.diff(listed, axis=0)).max(initial=0) <= 1


@settings(deadline=None, max_examples=100)
@given(start=subpixel_point, end=subpixel_point)
def test_a_ray_lists_the_same_pixels_in_both_directions(start, end):
    assert set(ray_cells(start, end)) == set(ray_cells(end, start))


@pytest.mark.parametrize(
    ("start", "end", "expected"),
    [
        pytest.param((1.5, 1.5), (1.5, 1.5), [(1, 1)], id="without length"),
        pytest.param((1.5, 1.5), (3.5, 3.5), [(1, 1), (2, 2), (3, 3)], id="through corners"),
        pytest.param((1.5, 3.5), (3.5, 1.5), [(1, 3), (2, 2), (3, 1)], id="through corners, down"),
        pytest.param((1.5, 2), (3.5, 2), [(1, 2), (2, 2), (3, 2)], id="along a border"),
        pytest.param((2, 1.5), (2, 3.5), [(2, 1), (2, 2), (2, 3)], id="up along a border"),
        pytest.param((1.5, 3.5), (3, 2), [(1, 3), (2, 2), (3, 2)], id="ends in a corner"),
        pytest.param((3, 2), (1.5, 3.5), [(3, 2), (2, 2), (1, 3)], id="starts in a corner"),
        pytest.param((1.5, 1.5), (3, 1.5), [(1, 1), (2, 1), (3, 1)], id="ends on a border"),
        pytest.param((3.5, 1.5), (2, 1.5), [(3, 1), (2, 1)], id="ends on its pixel's border"),
    ],
)
def test_borders_and_corners_are_as_defined(start, end, expected):
    assert ray_cells(pixels(*start), pixels(*end)) == expected


def test_a_ray_leaves_out_what_is_marked_already():
    marks = np.zeros((NUM_PIXELS, NUM_PIXELS), dtype=np.uint8)
    marks[1, 2] = 1
    cells = np.empty((NUM_PIXELS**2, 2), dtype=np.int32)
    num_cells = mark_ray(*pixels(1.5, 1.5), *pixels(3.5, 1.5), marks, cells, 0)
    assert cells[:num_cells].tolist() == [[1, 1], [3, 1]]


# Of the scan: coordinates within a few metres, many of them on borders of pixels.
coordinate = st.one_of(
    st.floats(-1.0, 1.0), st.integers(-20, 20).map(lambda halves: halves * 0.05), st.just(0.0)
)
points = st.lists(st.tuples(coordinate, coordinate), max_size=8)


def all_cells(origin, returns, misses, resolution):
    """Hits and misses of the kernel as lists, after it was seen to leave the marks clean."""
    reach = math.ceil(1.0 / resolution) + 2
    first_col, first_row = -reach, -reach - 1
    shape = (2 * reach + 2, 2 * reach + 1)
    marks = np.zeros(shape, dtype=np.uint8)
    cells = np.empty((marks.size, 2), dtype=np.int32)
    num_hits, num_cells = scan_cells(
        *origin,
        np.array(returns).reshape(-1, 2),
        np.array(misses).reshape(-1, 2),
        resolution,
        marks,
        first_col,
        first_row,
        cells,
    )
    assert (marks == UNMARKED).all()
    listed = [(int(col), int(row)) for col, row in cells[:num_cells]]
    expected = naive_scan_cells(
        origin, returns, misses, resolution, first_col, first_row, SUBPIXELS
    )
    return listed[:num_hits], listed[num_hits:], expected


@settings(deadline=None, max_examples=60)
@given(
    origin=st.tuples(coordinate, coordinate),
    returns=points,
    misses=points,
    resolution=st.sampled_from((0.1, 0.25, 0.0625)),
)
def test_hit_and_miss_sets_equal_exact_geometry(origin, returns, misses, resolution):
    hits, missed, (expected_hits, expected_misses) = all_cells(origin, returns, misses, resolution)
    assert len(set(hits)) == len(hits)
    assert len(set(missed)) == len(missed)
    assert set(hits) == expected_hits
    assert set(missed) == expected_misses


def test_a_hit_wins_over_rays_that_pass_through_its_pixel():
    hits, missed, _ = all_cells((0.0, 0.0), [(0.2, 0.0), (0.4, 0.0)], [(0.5, 0.0)], 0.1)
    assert hits == [(2, 0), (4, 0)]
    assert missed == [(0, 0), (1, 0), (3, 0), (5, 0)]


def test_a_scan_of_nothing_has_no_cells():
    hits, missed, _ = all_cells((0.0, 0.0), [], [], 0.1)
    assert hits == missed == []


probability = st.one_of(st.just(0.0), st.floats(0.1, 0.9))


@settings(deadline=None, max_examples=60)
@given(
    grid=st.lists(st.lists(probability, min_size=4, max_size=4), min_size=3, max_size=3),
    cells=st.lists(st.tuples(st.integers(0, 3), st.integers(0, 2)), unique=True),
    hit_share=st.floats(0.0, 1.0),
    hit_probability=st.floats(0.51, 0.97),
    miss_probability=st.floats(0.03, 0.49),
)
def test_hits_and_misses_update_the_odds(grid, cells, hit_share, hit_probability, miss_probability):
    first_col, first_row = -7, 5
    num_hits = round(hit_share * len(cells))
    before = np.array(grid, dtype=np.float32)
    expected = before.astype(np.float64)
    for k, (col, row) in enumerate(cells):
        observed = hit_probability if k < num_hits else miss_probability
        expected[row, col] = naive_update(before[row, col], observed, 0.1, 0.9)
    lattice = np.array(cells, dtype=np.int32).reshape(-1, 2) + np.int32([first_col, first_row])

    after = before.copy()
    update_cells(
        after,
        first_col,
        first_row,
        lattice,
        num_hits,
        len(cells),
        hit_probability,
        miss_probability,
        0.1,
        0.9,
    )

    assert after == pytest.approx(expected, abs=1e-6)


def test_the_first_observation_is_the_hit_or_miss_probability_itself():
    grid = np.zeros((1, 2), dtype=np.float32)
    update_cells(grid, 0, 0, np.array([[0, 0], [1, 0]], dtype=np.int32), 1, 2, 0.6, 0.45, 0.1, 0.9)
    assert grid[0].tolist() == pytest.approx([0.6, 0.45])


@pytest.mark.parametrize(("num_hits", "limit"), [(1, 0.9), (0, 0.1)])
def test_repeated_observations_end_at_the_clamp(num_hits, limit):
    grid = np.zeros((1, 1), dtype=np.float32)
    for _ in range(100):
        update_cells(grid, 0, 0, np.zeros((1, 2), np.int32), num_hits, 1, 0.6, 0.45, 0.1, 0.9)
    assert grid[0, 0] == np.float32(limit)
