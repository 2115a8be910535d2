# SPDX-License-Identifier: Apache-2.0
"""The plain search is exact with each kind of bounds, and the bounds are upper bounds."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bench.matching.bounding_grids import halved, halved_and_joined, precomputed
from bench.matching.plain_search import bound_of, place_rotations, search_plainly
from cartoloop.kernels.search_window import SearchFrame, SearchWindow
from tests.reference.naive_bounds import naive_bound, naive_box, naive_halved, naive_joined
from tests.reference.naive_branch_and_bound import naive_best, naive_sums

KINDS = pytest.mark.parametrize(
    ("make_grids", "naive_value"),
    [(precomputed, naive_box), (halved, naive_halved), (halved_and_joined, naive_joined)],
)
RESOLUTION = 0.05


def random_case(seed, largest=255):
    rng = np.random.default_rng(seed)
    cells = rng.integers(0, largest + 1, rng.integers(1, 40, 2)).astype(np.uint8)
    cells[rng.random(cells.shape) < 0.6] = 0
    points = rng.normal(0.0, 0.6, (int(rng.integers(1, 25)), 2))
    position, theta = rng.uniform(-0.5, 2.0, 2).tolist(), float(rng.uniform(-3, 3))
    frame = SearchFrame(*position, theta, 0.1, -0.2, RESOLUTION, 0.03)
    return rng, cells, points, frame


@KINDS
@settings(deadline=None, max_examples=40)
@given(seed=st.integers(0, 2**32 - 1), top=st.integers(0, 5))
def test_bounds_equal_the_naive_ones_and_are_bounds(make_grids, naive_value, seed, top):
    rng, cells, points, frame = random_case(seed)
    grids = make_grids(cells, top)
    cols, rows = (np.empty((1, len(points)), dtype=np.int32) for _ in range(2))
    place_rotations(points, frame, SearchWindow(0, 0, 0), cols, rows)
    for height in range(top + 1):
        col, row = (int(value) for value in rng.integers(-50, 50, 2))
        bound = bound_of(grids.cells, grids.levels, height, cols, rows, 0, col, row)
        assert bound == naive_bound(naive_value, cells, cols[0], rows[0], col, row, height)
        for _ in range(10):
            x, y = (int(value) for value in rng.integers(0, 2**height, 2))
            candidate = bound_of(grids.cells, grids.levels, 0, cols, rows, 0, col + x, row + y)
            assert candidate <= bound


@KINDS
@settings(deadline=None, max_examples=40)
@given(
    seed=st.integers(0, 2**32 - 1),
    half_widths=st.tuples(st.integers(0, 9), st.integers(0, 9), st.integers(0, 4)),
    top=st.integers(0, 5),
    largest=st.sampled_from((1, 3, 255)),
    share=st.sampled_from((0.0, 0.2, 0.5)),
)
def test_equals_exhaustive_search(make_grids, naive_value, seed, half_widths, top, largest, share):
    _, cells, points, frame = random_case(seed, largest)
    grids, min_sum = make_grids(cells, top), int(share * largest * len(points))
    found, counts = np.empty(4, dtype=np.int64), np.empty(top + 1, dtype=np.int64)
    search_plainly(
        grids.cells, grids.levels, points, frame, SearchWindow(*half_widths), min_sum, found, counts
    )
    sums = naive_sums(
        cells, (frame[3], frame[4]), RESOLUTION, points, frame[:3], *half_widths, frame[6]
    )
    best = naive_best(sums)
    num_top = (2 * half_widths[2] + 1) * np.prod(
        [2 * half_width // 2**top + 1 for half_width in half_widths[:2]]
    )
    assert counts[top] == num_top
    if sums[best] < min_sum:
        assert found[0] == -1
    else:
        assert (found[0], *(found[1:] - half_widths)) == (sums[best], *best)


def test_bounds_of_the_paper_are_the_tightest():
    _, cells, points, frame = random_case(5)
    cols, rows = (np.empty((1, len(points)), dtype=np.int32) for _ in range(2))
    place_rotations(points, frame, SearchWindow(0, 0, 0), cols, rows)
    exact, met, joined = (make(cells, 3) for make in (precomputed, halved, halved_and_joined))

    def bounds(grids):
        return [
            bound_of(grids.cells, grids.levels, 3, cols, rows, 0, col, 0) for col in range(-8, 8)
        ]

    by_kind = np.array([bounds(grids) for grids in (exact, met, joined)])
    assert (np.diff(by_kind, axis=0) >= 0).all()
    assert (np.diff(by_kind, axis=0) > 0).any(axis=1).all()
