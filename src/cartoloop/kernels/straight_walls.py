# SPDX-License-Identifier: Apache-2.0
"""Which walls of a map go on straight for a while: they look alike in many places."""

from __future__ import annotations

import numpy as np

from cartoloop._jit import borrowing_kernel, kernel
from cartoloop.arrays import ByteArray, FloatArray


@kernel
def mark_straight_walls(
    cells: ByteArray, wall: int, half_length: int, headings: FloatArray, out_straight: ByteArray
) -> None:
    """Mark the cells of walls that go on straight to both sides.

    A wall goes on straight in a heading if each of the cells on the line through its cell is a
    wall, or one of the eight around it is.

    Parameters
    ----------
    cells : uint8, shape (rows, cols).
    wall : least value of a cell that is a wall.
    half_length : number of cells of the line to each side.
    headings : float64, shape (k, 2), unit vectors along columns and rows; opposite ones are one.
    out_straight : uint8, shape of `cells`: 1 for straight walls, else 0.

    Notes
    -----
    O(cells + walls k half_length).
    """
    num_rows, num_cols = cells.shape
    near = _walls_and_neighbours(cells, wall)
    for row in range(num_rows):
        for col in range(num_cols):
            out_straight[row, col] = 0
            if cells[row, col] < wall:
                continue
            for k in range(headings.shape[0]):
                if _is_straight(near, row, col, headings[k, 0], headings[k, 1], half_length):
                    out_straight[row, col] = 1
                    break


@kernel
def _walls_and_neighbours(cells: ByteArray, wall: int) -> ByteArray:
    """Return 1 for walls and the cells around them, else 0."""
    num_rows, num_cols = cells.shape
    near = np.zeros((num_rows, num_cols), dtype=np.uint8)
    for row in range(num_rows):
        for col in range(num_cols):
            if cells[row, col] >= wall:
                for i in range(max(row - 1, 0), min(row + 2, num_rows)):
                    for j in range(max(col - 1, 0), min(col + 2, num_cols)):
                        near[i, j] = 1
    return near


@borrowing_kernel
def _is_straight(
    near: ByteArray, row: int, col: int, along_cols: float, along_rows: float, half_length: int
) -> bool:
    """Return whether the line through a cell has walls near all of its cells."""
    num_rows, num_cols = near.shape
    for step in range(1, half_length + 1):
        for side in (-step, step):
            i = np.int64(np.floor(row + side * along_rows + 0.5))
            j = np.int64(np.floor(col + side * along_cols + 0.5))
            if not (0 <= i < num_rows and 0 <= j < num_cols) or near[i, j] == 0:
                return False
    return True
