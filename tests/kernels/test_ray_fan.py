# SPDX-License-Identifier: Apache-2.0
"""The pixels that rays from one point intersect, against exact geometry and against each other."""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cartoloop.kernels.pixel_rows import list_runs, words_across
from cartoloop.kernels.ray_fan import SUBPIXELS, mark_rays
from tests.reference.naive_ray_casting import naive_ray

NUM_PIXELS = 8

anywhere = st.integers(SUBPIXELS, (NUM_PIXELS - 1) * SUBPIXELS - 1)
# Halves of pixels meet borders and corners all the time, where traversals go wrong.
half_pixels = st.integers(2, 2 * NUM_PIXELS - 3).map(lambda halves: halves * SUBPIXELS // 2)
beside_half_pixels = st.tuples(half_pixels, st.integers(-1, 1)).map(sum)
subpixel = st.one_of(anywhere, half_pixels, beside_half_pixels).filter(lambda s: s >= SUBPIXELS)
subpixel_point = st.tuples(subpixel, subpixel)


def marked_rows(start, ends, num_pixels):
    """The kernel's set of pixels, and the number of spans that it reports."""
    rows = np.zeros((num_pixels, words_across(num_pixels)), dtype=np.uint32)
    return rows, mark_rays(*start, np.array(ends, dtype=np.int64).reshape(-1, 2), rows)


def ray_cells(start, ends, num_pixels=NUM_PIXELS):
    """The pixels (column, row) that the kernel marks for rays from one start."""
    rows, num_spans = marked_rows(start, ends, num_pixels)
    runs = np.empty((num_pixels * num_pixels, 3), dtype=np.int32)
    num_runs = list_runs(rows, runs)
    assert num_runs <= num_spans
    return {
        (col, row) for row, first, after in runs[:num_runs].tolist() for col in range(first, after)
    }


def in_pixels(point):
    return Fraction(point[0], SUBPIXELS), Fraction(point[1], SUBPIXELS)


def pixels(*coordinates):
    """Coordinates in pixels as whole subpixels."""
    return tuple(round(c * SUBPIXELS) for c in coordinates)


@settings(deadline=None, max_examples=300)
@given(start=subpixel_point, end=subpixel_point)
def test_a_ray_marks_each_pixel_that_it_intersects(start, end):
    assert ray_cells(start, [end]) == naive_ray(in_pixels(start), in_pixels(end))


@settings(deadline=None, max_examples=100)
@given(start=subpixel_point, end=subpixel_point)
def test_a_ray_marks_the_same_pixels_in_both_directions(start, end):
    assert ray_cells(start, [end]) == ray_cells(end, [start])


@pytest.mark.parametrize(
    ("start", "end", "expected"),
    [
        pytest.param((1.5, 1.5), (1.5, 1.5), {(1, 1)}, id="without length"),
        pytest.param((1.5, 1.5), (3.5, 3.5), {(1, 1), (2, 2), (3, 3)}, id="through corners"),
        pytest.param((1.5, 3.5), (3.5, 1.5), {(1, 3), (2, 2), (3, 1)}, id="through corners, down"),
        pytest.param((1.5, 2), (3.5, 2), {(1, 2), (2, 2), (3, 2)}, id="along a border"),
        pytest.param((2, 1.5), (2, 3.5), {(2, 1), (2, 2), (2, 3)}, id="up along a border"),
        pytest.param((1.5, 3.5), (3, 2), {(1, 3), (2, 2), (3, 2)}, id="ends in a corner"),
        pytest.param((3, 2), (1.5, 3.5), {(3, 2), (2, 2), (1, 3)}, id="starts in a corner"),
        pytest.param((1.5, 1.5), (3, 1.5), {(1, 1), (2, 1), (3, 1)}, id="ends on a border"),
        pytest.param((3.5, 1.5), (2, 1.5), {(3, 1), (2, 1)}, id="ends on its pixel's border"),
    ],
)
def test_borders_and_corners_are_as_defined(start, end, expected):
    assert ray_cells(pixels(*start), [pixels(*end)]) == expected


@settings(deadline=None, max_examples=100)
@given(start=subpixel_point, ends=st.lists(subpixel_point, max_size=8))
def test_rays_mark_what_each_of_them_intersects(start, ends):
    expected = set()
    for end in ends:
        expected |= naive_ray(in_pixels(start), in_pixels(end))
    assert ray_cells(start, ends) == expected


FAN_PIXELS = 100
FAN_REACH = FAN_PIXELS // 2 - 2


def fan(angles, ranges, start):
    """Ends of rays from a start, in subpixels; ranges in pixels."""
    ends = SUBPIXELS * np.column_stack((ranges * np.cos(angles), ranges * np.sin(angles)))
    return np.floor(np.array(start) + ends).astype(np.int64)


def each_alone(start, ends):
    """The pixels of rays that have no neighbours."""
    return set().union(*(ray_cells(start, [end], FAN_PIXELS) for end in ends))


@settings(deadline=None, max_examples=60)
@given(
    start=st.tuples(*[st.sampled_from((0, 1, 900, SUBPIXELS // 2, SUBPIXELS - 1))] * 2),
    first_deg=st.integers(0, 359),
    step_deg=st.floats(0.02, 12.0),
    num_rays=st.integers(2, 60),
    seed=st.integers(0, 99),
    order=st.sampled_from(("as turned", "backwards", "to and fro", "shuffled")),
)
def test_close_rays_mark_what_single_rays_mark(start, first_deg, step_deg, num_rays, seed, order):
    random = np.random.default_rng(seed)
    start = tuple(FAN_PIXELS // 2 * SUBPIXELS + offset for offset in start)
    angles = np.radians(first_deg + step_deg * np.arange(num_rays))
    jumps = random.uniform(0.0, FAN_REACH, num_rays)
    smooth = 0.5 * FAN_REACH * (1.0 + 0.9 * np.sin(7.0 * angles))
    ranges = np.where(random.uniform(size=num_rays) < random.choice((0.0, 0.1, 1.0)), jumps, smooth)
    ends = fan(angles, ranges, start)
    if order == "backwards":
        ends = ends[::-1]
    elif order == "to and fro":
        ends = np.concatenate((ends[::2], ends[1::2][::-1]))
    elif order == "shuffled":
        random.shuffle(ends)
    assert ray_cells(start, ends, FAN_PIXELS) == each_alone(start, ends)


def test_rays_that_reverse_their_order_are_all_marked():
    start = pixels(50.5, 2.5)
    ends = [pixels(50.5 + 0.02 * x, 42.5) for x in (0, 80, 80)] + [pixels(50.5, 42.5)]
    assert ray_cells(start, ends, FAN_PIXELS) == each_alone(start, ends)


def test_far_ends_of_close_rays_are_not_filled():
    """A pixel fits between two rays from just as far as they are a pixel apart."""
    start, reach = pixels(50.5, 1.5), 96
    gaps = 0
    for offset in np.linspace(0.5, 4.0, 40):
        ends = [pixels(50.5 - offset / 2, 1.5 + reach), pixels(50.5 + offset / 2, 1.5 + reach)]
        found = ray_cells(start, ends, FAN_PIXELS)
        assert found == each_alone(start, ends)
        gaps += any({(49, row), (51, row)} <= found and (50, row) not in found for row in range(99))
    assert gaps > 10


def test_rays_to_a_smooth_wall_are_traced_at_their_ends():
    start = pixels(FAN_PIXELS / 2, FAN_PIXELS / 2)
    angles = np.linspace(0.0, math.tau, 720, endpoint=False)
    ends = fan(angles, np.full(720, 45.0), start)
    _, num_spans = marked_rows(start, ends, FAN_PIXELS)
    rows_crossed = np.abs(ends[:, 1] - start[1]).sum() / SUBPIXELS
    assert num_spans < 0.25 * rows_crossed


def test_no_rays_mark_nothing():
    assert ray_cells(pixels(1.5, 1.5), []) == set()
