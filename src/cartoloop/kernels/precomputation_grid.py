# SPDX-License-Identifier: Apache-2.0
"""The precomputed grids of branch and bound, eq. (17): maxima over boxes of pixels."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cartoloop._jit import kernel


@kernel
def shifted_maximum(
    grid: NDArray[np.uint8], shift_low: int, shift_high: int, out_grid: NDArray[np.uint8]
) -> None:
    """Write the maximum of the four cells that lie at both shifts, in both axes, into `out_grid`.

    ``out[y, x] = max(grid[y + sy, x + sx])`` over sx, sy in {shift_low, shift_high}; cells outside
    count as 0. Where `grid` holds maxima over boxes of s cells from the cell on, and
    ``shift_high - shift_low <= s``, the result holds maxima over boxes of s + shift_high - shift_low
    cells, from shift_low on.

    Parameters
    ----------
    grid, out_grid : uint8, shape (num_rows, num_cols).
    shift_low, shift_high : in cells; shift_low <= 0 <= shift_high.

    Notes
    -----
    Two passes, O(n), on whole rows so that the compiler turns them into vector instructions.
    """
    num_rows, num_cols = grid.shape
    along = np.zeros((num_rows, num_cols), dtype=np.uint8)
    for row in range(num_rows):
        for col in range(num_cols - shift_high):
            along[row, col] = grid[row, col + shift_high]
        for col in range(-shift_low, num_cols):
            along[row, col] = max(along[row, col], grid[row, col + shift_low])
    for row in range(num_rows):
        if row + shift_high < num_rows:
            out_grid[row, :] = along[row + shift_high, :]
        else:
            out_grid[row, :] = 0
        if row + shift_low >= 0:
            for col in range(num_cols):
                out_grid[row, col] = max(out_grid[row, col], along[row + shift_low, col])


@kernel
def build_pyramid(
    cells: NDArray[np.uint8],
    padding: int,
    slack: int,
    out_levels: NDArray[np.uint8],
    out_slack_levels: NDArray[np.uint8],
) -> None:
    """Write the precomputed grids of a grid, plain and with slack, into the `out_` arrays.

    Parameters
    ----------
    cells : uint8, shape (num_rows, num_cols).
    padding : ``out[h, row + padding, col + padding]`` belongs to ``cells[row, col]``.
    slack : how much larger the boxes with slack are on each side, in cells.
    out_levels : uint8, shape (heights, num_rows + 2 padding, num_cols + 2 padding): at height h the
        maximum over the box of 2^h x 2^h cells that begins at the cell, eq. (17).
    out_slack_levels : like `out_levels`, the boxes larger by `slack` on each side; meaningful from
        the height h with 2^h >= 2 slack on, zero below.

    Notes
    -----
    Each level is made of the one below it, as the paper does; since the boxes are powers of two,
    the maximum of two of them, shifted, takes the place of the paper's deque. O(n) per level.
    """
    num_rows, num_cols = cells.shape
    out_levels[0] = 0
    for row in range(num_rows):
        out_levels[0, row + padding, padding : padding + num_cols] = cells[row]
    for height in range(1, out_levels.shape[0]):
        shifted_maximum(out_levels[height - 1], 0, 1 << (height - 1), out_levels[height])
    for height in range(out_levels.shape[0]):
        if (1 << height) >= 2 * slack:
            shifted_maximum(out_levels[height], -slack, slack, out_slack_levels[height])
        else:
            out_slack_levels[height] = 0
