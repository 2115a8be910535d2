# SPDX-License-Identifier: Apache-2.0
"""Quantization of probabilities to bytes and back, and the box of known cells."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cartoloop._jit import kernel
from cartoloop.arrays import ByteArray

FloatCells = NDArray[np.float32]


@kernel
def known_box(cells: FloatCells) -> tuple[int, int, int, int]:
    """Return first row, first column, number of rows and columns of the box of cells above 0.

    Parameters
    ----------
    cells : float32, shape (num_rows, num_cols), C-contiguous.
    """
    num_rows, num_cols = cells.shape
    first_row, end_row, first_col, end_col = num_rows, 0, num_cols, 0
    for row in range(num_rows):
        line = cells[row]
        left = 0
        while left < num_cols and not line[left] > 0.0:
            left += 1
        if left == num_cols:
            continue
        right = num_cols
        while not line[right - 1] > 0.0:
            right -= 1
        first_row = min(first_row, row)
        end_row = row + 1
        first_col = min(first_col, left)
        end_col = max(end_col, right)
    if end_row == 0:
        return 0, 0, 0, 0
    return first_row, first_col, end_row - first_row, end_col - first_col


@kernel
def quantize_box(
    cells: FloatCells,
    first_row: int,
    first_col: int,
    lowest: float,
    step: float,
    out_values: ByteArray,
) -> None:
    """Write the values that stand for the probabilities in a box of cells into `out_values`.

    Parameters
    ----------
    cells : float32, shape (num_rows, num_cols), C-contiguous, probabilities; 0 or less where never
        observed.
    first_row, first_col : first cell of the box.
    lowest, step : probability of value 1, and its increase from one value to the next.
    out_values : uint8, of the shape of the box; 0 where never observed.
    """
    lowest_32, step_32 = np.float32(lowest), np.float32(step)
    one, zero = np.float32(1.0), np.float32(0.0)
    for row in range(out_values.shape[0]):
        line = cells[first_row + row, first_col:]
        values = out_values[row]
        for col in range(values.size):
            value = np.rint((line[col] - lowest_32) / step_32) + one
            values[col] = np.uint8(value if line[col] > zero else zero)


@kernel
def dequantize_box(
    values: ByteArray,
    first_row: int,
    first_col: int,
    lowest: float,
    step: float,
    out_cells: FloatCells,
) -> None:
    """Write the probabilities that the values in a box stand for into `out_cells`.

    Parameters
    ----------
    values : uint8, shape (num_rows, num_cols), C-contiguous; 0: never observed.
    first_row, first_col : first cell of the box.
    lowest, step : probability of value 1, and its increase from one value to the next.
    out_cells : float32, of the shape of the box, C-contiguous; 0 where never observed.
    """
    zero = np.float32(0.0)
    for row in range(out_cells.shape[0]):
        line = values[first_row + row, first_col:]
        cells = out_cells[row]
        for col in range(cells.size):
            probability = np.float32(lowest + (np.float64(line[col]) - 1.0) * step)
            cells[col] = probability if line[col] > 0 else zero
