# SPDX-License-Identifier: Apache-2.0
"""Both exhaustive searches find the same candidate as the naive one, also among equal scores."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bench.matching.exhaustive_search import search_as_written, search_by_rows
from cartoloop.kernels.search_window import SearchFrame, SearchWindow
from tests.reference.naive_branch_and_bound import naive_best, naive_sums

SEARCHES = pytest.mark.parametrize("search", [search_as_written, search_by_rows])
RESOLUTION = 0.05


def found(search, cells, points, frame, half_widths):
    best = np.zeros(4, dtype=np.int64)
    search(cells, points, SearchFrame(*map(float, frame)), SearchWindow(*half_widths), best)
    total, *at = best.tolist()
    return total, tuple(i - half for i, half in zip(at, half_widths, strict=True))


def naively_found(cells, points, frame, half_widths):
    *estimate, origin_x, origin_y, resolution, step = frame
    sums = naive_sums(cells, (origin_x, origin_y), resolution, points, estimate, *half_widths, step)
    best = naive_best(sums)
    return sums[best], best


@SEARCHES
@settings(deadline=None, max_examples=40)
@given(
    seed=st.integers(0, 2**32 - 1),
    half_widths=st.tuples(*(st.integers(0, 6) for _ in range(3))),
    largest=st.sampled_from((1, 3, 255)),
)
def test_equals_naive_search(search, seed, half_widths, largest):
    rng = np.random.default_rng(seed)
    # Few different values, so that many candidates have equal scores.
    cells = rng.integers(0, largest + 1, rng.integers(1, 30, 2)).astype(np.uint8)
    points = rng.normal(0.0, 0.5, (int(rng.integers(1, 30)), 2))
    frame = (*rng.uniform(-0.5, 1.5, 2), rng.uniform(-3, 3), 0.1, -0.2, RESOLUTION, 0.03)
    assert found(search, cells, points, frame, half_widths) == naively_found(
        cells, points, frame, half_widths
    )


@SEARCHES
@pytest.mark.parametrize("num_points", [257, 258, 700])
def test_sums_of_many_bright_cells_do_not_overflow(search, num_points):
    cells = np.full((40, 40), 255, dtype=np.uint8)
    points = np.random.default_rng(0).uniform(-0.3, 0.3, (num_points, 2))
    frame = (1.0, 1.0, 0.0, 0.0, 0.0, RESOLUTION, 0.05)
    assert found(search, cells, points, frame, (2, 2, 1)) == (255 * num_points, (0, 0, 0))


@SEARCHES
def test_scan_outside_the_grid_scores_zero_at_its_estimate(search):
    cells, points = np.full((5, 5), 200, dtype=np.uint8), np.zeros((3, 2))
    frame = (50.0, -50.0, 0.0, 0.0, 0.0, RESOLUTION, 0.1)
    assert found(search, cells, points, frame, (3, 3, 2)) == (0, (0, 0, 0))
