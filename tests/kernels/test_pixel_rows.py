# SPDX-License-Identifier: Apache-2.0
"""Sets of pixels as rows of bits, against Python's sets."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cartoloop.kernels.pixel_rows import add_span, list_runs, remove_pixel, words_across

NUM_ROWS = 3
NUM_COLS = 130

span = st.tuples(
    st.integers(0, NUM_ROWS - 1), st.integers(0, NUM_COLS - 1), st.integers(0, NUM_COLS - 1)
).map(lambda drawn: (drawn[0], min(drawn[1:]), max(drawn[1:])))
pixel = st.tuples(st.integers(0, NUM_COLS - 1), st.integers(0, NUM_ROWS - 1))


def empty_rows():
    return np.zeros((NUM_ROWS, words_across(NUM_COLS)), dtype=np.uint32)


def runs_of(rows, at_most):
    runs = np.empty((at_most, 3), dtype=np.int32)
    return runs[: list_runs(rows, runs)].tolist()


@settings(deadline=None, max_examples=200)
@given(spans=st.lists(span, max_size=6), removed=st.lists(pixel, max_size=6))
def test_runs_are_what_was_added_and_not_removed(spans, removed):
    rows, pixels = empty_rows(), set()
    for row, first, last in spans:
        add_span(rows, row, first, last)
        pixels |= {(col, row) for col in range(first, last + 1)}
    for col, row in removed:
        assert remove_pixel(rows, col, row) == ((col, row) in pixels)
        pixels.discard((col, row))

    runs = runs_of(rows, len(spans) + len(removed))

    listed = [(col, row) for row, first, after in runs for col in range(first, after)]
    assert len(set(listed)) == len(listed)
    assert set(listed) == pixels
    assert all(first < after for _, first, after in runs)
    assert not {(after, row) for row, _, after in runs} & pixels, "a run ends too early"


@pytest.mark.parametrize("num_cols", [1, 31, 32, 33, 64])
def test_rows_have_room_for_all_columns_and_one_more_bit(num_cols):
    rows = np.zeros((1, words_across(num_cols)), dtype=np.uint32)
    add_span(rows, 0, 0, num_cols - 1)
    assert runs_of(rows, 1) == [[0, 0, num_cols]]
    assert 32 * rows.shape[1] > num_cols
