# SPDX-License-Identifier: Apache-2.0
"""Bytes for probabilities, as NumPy makes them step by step."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays

from cartoloop.kernels.cell_values import dequantize_box, known_box, quantize_box

LOWEST, STEP = 0.1, 0.8 / 254.0

cells_of = arrays(
    np.float32,
    array_shapes(min_dims=2, max_dims=2, max_side=9),
    elements=st.just(0.0) | st.floats(np.float32(0.1), np.float32(0.9), width=32),
    fill=st.just(0.0),
)


def a_box(data, shape):
    """Draw first row, first column, number of rows and of columns of a box within a grid."""
    row, col = (data.draw(st.integers(0, size - 1)) for size in shape)
    height, width = (data.draw(st.integers(0, shape[i] - at)) for i, at in enumerate((row, col)))
    return row, col, height, width


def quantized(cells):
    values = np.rint((cells - np.float32(LOWEST)) / np.float32(STEP)) + np.float32(1.0)
    return np.where(cells > 0.0, values, 0.0).astype(np.uint8)


@settings(deadline=None, max_examples=100)
@given(cells_of)
def test_the_box_is_the_smallest_around_all_known_cells(cells):
    row, col, num_rows, num_cols = known_box(cells)
    known = cells > 0.0
    box = known[row : row + num_rows, col : col + num_cols]
    assert box.sum() == known.sum()
    if known.any():
        assert box[0].any() and box[-1].any() and box[:, 0].any() and box[:, -1].any()
    else:
        assert (num_rows, num_cols) == (0, 0)


@settings(deadline=None, max_examples=100)
@given(st.data(), cells_of)
def test_a_box_is_quantised_like_the_whole(data, cells):
    row, col, height, width = a_box(data, cells.shape)
    values = np.empty((height, width), dtype=np.uint8)
    quantize_box(cells, row, col, LOWEST, STEP, values)
    np.testing.assert_array_equal(values, quantized(cells)[row : row + height, col : col + width])


@settings(deadline=None, max_examples=60)
@given(st.data(), arrays(np.uint8, array_shapes(min_dims=2, max_dims=2, max_side=9)))
def test_dequantised_values_equal_a_table(data, values):
    table = (LOWEST + (np.arange(256) - 1) * STEP).astype(np.float32)
    table[0] = 0.0
    row, col, height, width = a_box(data, values.shape)
    cells = np.empty((height, width), dtype=np.float32)
    dequantize_box(values, row, col, LOWEST, STEP, cells)
    np.testing.assert_array_equal(cells, table[values][row : row + height, col : col + width])
