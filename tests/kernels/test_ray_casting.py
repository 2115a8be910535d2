# SPDX-License-Identifier: Apache-2.0
"""The hit and miss sets of a scan against exact geometry."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cartoloop.kernels.ray_casting import FARTHEST, fits, scan_cells
from cartoloop.kernels.ray_fan import SUBPIXELS
from tests.reference.naive_ray_casting import naive_scan_cells

# Coordinates within a few metres, many of them on borders of pixels.
coordinate = st.one_of(
    st.floats(-1.0, 1.0), st.integers(-20, 20).map(lambda halves: halves * 0.05), st.just(0.0)
)
points = st.lists(st.tuples(coordinate, coordinate), max_size=8)


NO_POINTS = np.empty((0, 2))


def as_array(rows):
    return np.array(rows, dtype=np.float64).reshape(-1, 2)


def all_cells(origin, returns, misses, resolution, uncertain=(0.0, 0.0)):
    """Hits and misses of the kernel as lists, and those expected as sets."""
    hits, free, _, *box = scan_cells(
        *origin, as_array(returns), as_array(misses), NO_POINTS, resolution, *uncertain
    )
    missed = [(col, row) for row, first, after in free.tolist() for col in range(first, after)]
    first_col, first_row, last_col, last_row = box
    hits = [tuple(cell) for cell in hits.tolist()]
    assert all(first_col <= c <= last_col and first_row <= r <= last_row for c, r in hits + missed)
    expected = naive_scan_cells(
        origin,
        returns,
        misses,
        resolution,
        first_col,
        first_row,
        SUBPIXELS,
        uncertain,
    )
    return hits, missed, expected


@settings(deadline=None, max_examples=60)
@given(
    origin=st.tuples(coordinate, coordinate),
    returns=points,
    misses=points,
    resolution=st.sampled_from((0.1, 0.25, 0.0625)),
    uncertain=st.tuples(st.sampled_from((0.0, 0.125, 1.0)), st.sampled_from((0.0, 0.25, 1.0))),
)
def test_hit_and_miss_sets_equal_exact_geometry(origin, returns, misses, resolution, uncertain):
    hits, missed, (expected_hits, expected_misses) = all_cells(
        origin, returns, misses, resolution, uncertain
    )
    assert len(set(hits)) == len(hits)
    assert len(set(missed)) == len(missed)
    assert set(hits) == expected_hits
    assert set(missed) == expected_misses


def test_a_hit_wins_over_rays_that_pass_through_its_pixel():
    hits, missed, _ = all_cells((0.0, 0.0), [(0.2, 0.0), (0.4, 0.0)], [(0.5, 0.0)], 0.1)
    assert hits == [(2, 0), (4, 0)]
    assert missed == [(0, 0), (1, 0), (3, 0), (5, 0)]


@settings(deadline=None, max_examples=60)
@given(returns=points, misses=points, behind=points)
def test_hidden_cells_are_neither_hit_nor_missed(returns, misses, behind):
    hits, free, hidden, *box = scan_cells(
        0.0, 0.0, as_array(returns), as_array(misses), as_array(behind), 0.1, 0.0, 0.0
    )
    without = scan_cells(0.0, 0.0, as_array(returns), as_array(misses), NO_POINTS, 0.1, 0.0, 0.0)
    assert np.array_equal(hits, without[0])
    assert np.array_equal(free, without[1])
    known = {tuple(cell) for cell in hits.tolist()}
    known |= {(col, row) for row, first, after in free.tolist() for col in range(first, after)}
    first_col, first_row, last_col, last_row = box
    cells = {tuple(cell) for cell in np.floor(as_array(behind) / 0.1 + 0.5).astype(int).tolist()}
    found = [tuple(cell) for cell in hidden.tolist()]
    assert len(set(found)) == len(found)
    # a little more than the box may be looked at
    assert set(found) <= cells - known
    assert set(found) >= {
        (col, row)
        for col, row in cells - known
        if first_col <= col <= last_col and first_row <= row <= last_row
    }


def test_an_empty_scan_has_no_cells():
    hits, missed, _ = all_cells((0.0, 0.0), [], [], 0.1)
    assert hits == missed == []


@pytest.mark.parametrize("far", [1e3, -1e8, 1e9, -1e12, 1e300, -1e300, np.inf, -np.inf, np.nan])
def test_a_scan_larger_than_any_submap_has_no_cells(far):
    near, wide = np.array([(1.0, 0.5)]), np.array([(1.0, far), (far, 1.0)])
    nothing = np.empty((0, 2))
    cases = [(far, far, near, nothing)]
    if not np.isnan(far):  # ends of rays are numbers, or poses are not
        cases += [(0.0, 0.0, wide, nothing), (0.0, 0.0, near, wide)]
    for x, y, returns, misses in cases:
        hits, free, hidden, *box = scan_cells(x, y, returns, misses, near, 0.05, 0.0, 0.0)
        assert len(hits) == len(free) == len(hidden) == 0
        assert not fits(*box)


def test_cells_far_from_the_origin_are_those_near_it_shifted():
    shift = np.array((1.0, -1.0)) * (FARTHEST - 100) * 0.125  # exact
    returns, misses = np.array([(1.0, 2.0), (-1.5, 0.25)]), np.array([(3.0, -1.0)])
    near = scan_cells(0.0, 0.0, returns, misses, NO_POINTS, 0.125, 0.0, 0.0)
    far = scan_cells(*shift, returns + shift, misses + shift, NO_POINTS, 0.125, 0.0, 0.0)
    cells = FARTHEST - 100
    assert (far[0] - (cells, -cells)).tolist() == near[0].tolist()
    assert (far[1] - (-cells, cells, cells)).tolist() == near[1].tolist()
