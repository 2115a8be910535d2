# SPDX-License-Identifier: Apache-2.0
"""Old submaps against what was seen later: what contradicts it fades, the rest is copied."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cartoloop._jit import kernel
from cartoloop.arrays import BoolArray, ByteArray, FloatArray
from cartoloop.kernels.map_composition import NEUTRAL


@kernel
def fade_submap(
    cells: ByteArray,
    affine: FloatArray,
    total: NDArray[np.float32],
    known: BoolArray,
    free_below: float,
    wall_above: float,
    out_faded: ByteArray,
    out_unseen: ByteArray,
) -> tuple[int, int]:
    """Compare a submap with a map of what was seen later.

    Parameters
    ----------
    cells : uint8, shape (rows, cols), 0 unknown.
    affine : float64, shape (6,); the cell (row, col) lies in the map cell whose column is the floor
        of ``affine[0] + affine[1] * col + affine[2] * row``, and row of ``affine[3] + ...``.
    total : float32, shape (map rows, map cols), log-odds of what was seen later.
    known : bool, same shape, whether anything was.
    free_below, wall_above : log-odds up to which a map cell is free, from which it is a wall.
    out_faded : uint8, as cells: 0 for walls where the map is free, and for free cells where there
        is a wall; others are copied.
    out_unseen : uint8, as cells: those that the map does not know are copied, 0 for others.

    Returns
    -------
    number of observed cells, and how many of them the map knows.

    Notes
    -----
    O(cells).
    """
    num_rows, num_cols = cells.shape
    observed = 0
    covered = 0
    for row in range(num_rows):
        for col in range(num_cols):
            value = cells[row, col]
            out_faded[row, col] = value
            out_unseen[row, col] = 0
            if value == 0:
                continue
            observed += 1
            map_col = int(np.floor(affine[0] + affine[1] * col + affine[2] * row))
            map_row = int(np.floor(affine[3] + affine[4] * col + affine[5] * row))
            inside = 0 <= map_row < known.shape[0] and 0 <= map_col < known.shape[1]
            if not inside or not known[map_row, map_col]:
                out_unseen[row, col] = value
                continue
            covered += 1
            log_odds = total[map_row, map_col]
            if (value > NEUTRAL and log_odds <= free_below) or (
                value < NEUTRAL and log_odds >= wall_above
            ):
                out_faded[row, col] = 0
    return observed, covered


@kernel
def copy_unknown(affine: FloatArray, source: ByteArray, out_cells: ByteArray) -> int:
    """Copy the cells of a submap into the unknown cells of another, in place.

    Parameters
    ----------
    affine : float64, shape (6,), as of :func:`fade_submap`, from cells of the target to cells of
        the source.
    source : uint8, shape (rows, cols), 0 where there is nothing to copy.
    out_cells : uint8, the cells of the target.

    Returns
    -------
    number of cells of the target that were set.

    Notes
    -----
    O(cells of the target).
    """
    num_set = 0
    for row in range(out_cells.shape[0]):
        for col in range(out_cells.shape[1]):
            if out_cells[row, col] != 0:
                continue
            from_col = int(np.floor(affine[0] + affine[1] * col + affine[2] * row))
            from_row = int(np.floor(affine[3] + affine[4] * col + affine[5] * row))
            if not (0 <= from_row < source.shape[0] and 0 <= from_col < source.shape[1]):
                continue
            value = source[from_row, from_col]
            if value != 0:
                out_cells[row, col] = value
                num_set += 1
    return num_set


@kernel
def clear_inside(affine: FloatArray, num_rows: int, num_cols: int, out_cells: ByteArray) -> None:
    """Set the cells of a submap to 0 that lie inside the grid of another.

    Parameters
    ----------
    affine : float64, shape (6,), as of :func:`fade_submap`, from these cells to those of the other.
    num_rows, num_cols : size of the other.
    out_cells : uint8.

    Notes
    -----
    O(cells).
    """
    for row in range(out_cells.shape[0]):
        for col in range(out_cells.shape[1]):
            if out_cells[row, col] == 0:
                continue
            in_col = int(np.floor(affine[0] + affine[1] * col + affine[2] * row))
            in_row = int(np.floor(affine[3] + affine[4] * col + affine[5] * row))
            if 0 <= in_row < num_rows and 0 <= in_col < num_cols:
                out_cells[row, col] = 0
