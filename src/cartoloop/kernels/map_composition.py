# SPDX-License-Identifier: Apache-2.0
"""One map of all submaps: their evidence is added, each submap at its optimised pose."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cartoloop._jit import kernel
from cartoloop.arrays import BoolArray, ByteArray, FloatArray, IntArray

NEUTRAL = 128
"""The cell value of probability 0.5, in the middle of 1...255: observed, with log-odds 0. Larger
values are walls, smaller ones free, 0 is never observed."""


@kernel
def abstain_beside_walls(cells: ByteArray, out_cells: ByteArray) -> None:
    """Write the cells into `out_cells`, free ones next to a wall as `NEUTRAL`.

    Parameters
    ----------
    cells : uint8, shape (rows, cols), of a finished submap; 0 never observed.
    out_cells : uint8, shape (rows, cols).

    Notes
    -----
    A cell beside one that was hit may be called free by rays that met the hit cell: submaps know
    walls to a pixel only. Such cells abstain, otherwise two submaps that place a wall a pixel
    apart would erase each other's wall. O(cells).
    """
    num_rows, num_cols = cells.shape
    for row in range(num_rows):
        for col in range(num_cols):
            out_cells[row, col] = cells[row, col]
    for row in range(num_rows):
        for col in range(num_cols):
            if cells[row, col] > NEUTRAL:
                for near_row in range(max(row - 1, 0), min(row + 2, num_rows)):
                    for near_col in range(max(col - 1, 0), min(col + 2, num_cols)):
                        if 0 < out_cells[near_row, near_col] < NEUTRAL:
                            out_cells[near_row, near_col] = NEUTRAL


@kernel
def cell_evidence(
    cells: ByteArray, log_odds: NDArray[np.float32], out_evidence: NDArray[np.float32]
) -> None:
    """Write the log-odds that each cell of a submap adds to a map into `out_evidence`.

    Parameters
    ----------
    cells : uint8, shape (rows, cols), 0 unknown.
    log_odds : float32, shape (256,), of a cell of each value; 0 for value 0 and for `NEUTRAL`.
    out_evidence : float32, shape (rows, cols).
    """
    voting = np.empty(cells.shape, dtype=np.uint8)
    abstain_beside_walls(cells, voting)
    for row in range(cells.shape[0]):
        for col in range(cells.shape[1]):
            out_evidence[row, col] = log_odds[voting[row, col]]


@kernel
def columns_within(start: float, step: float, end: float, first: int, last: int) -> tuple[int, int]:
    """Return the part of columns ``first <= col < last`` with ``0 <= start + step * col < end``.

    One more may be returned on either side, for rounding.
    """
    if abs(step) < 1e-9:  # parallel to the rows: all or none, which the caller checks
        return first, last
    enter = -start / step
    leave = (end - start) / step
    if step < 0.0:
        enter, leave = leave, enter
    enter = min(max(enter - 1.0, float(first)), float(last))
    leave = min(max(leave + 1.0, float(first)), float(last))
    return int(np.ceil(enter)), int(np.ceil(leave))


@kernel
def add_submap(
    cells: ByteArray,
    evidence: NDArray[np.float32],
    affine: FloatArray,
    window: IntArray,
    out_sum: NDArray[np.float32],
    out_known: BoolArray,
) -> None:
    """Add a submap's evidence to a map, in place: `out_sum` and `out_known`.

    Parameters
    ----------
    cells : uint8, shape (rows, cols), 0 unknown; the outermost rows and columns must be unknown.
    evidence : float32, shape (rows, cols), log-odds that each cell adds, 0 where unknown.
    affine : float64, shape (6,); map cell (row, col) lies at submap column
        ``affine[0] + affine[1] * col + affine[2] * row`` and row ``affine[3] + ...`` [cells].
    window : int64, shape (4,), first row, end row, first column, end column of the map cells that
        can lie in the submap.
    out_sum : float32, shape (map rows, map cols), sum of log-odds.
    out_known : bool, same shape, whether any submap has seen the cell.

    Notes
    -----
    Where the nearest submap cell has been seen, the log-odds are interpolated bilinearly, unknown
    neighbours adding zero: the nearest cell alone frays oblique walls, and interpolated
    probabilities would let an uncertain cell outweigh a certain one. O(cells of the window).
    """
    last_col = cells.shape[1] - 1
    last_row = cells.shape[0] - 1
    for row in range(window[0], window[1]):
        u_start = affine[0] + affine[2] * row
        v_start = affine[3] + affine[5] * row
        first, end = columns_within(u_start, affine[1], last_col, window[2], window[3])
        first, end = columns_within(v_start, affine[4], last_row, first, end)
        for col in range(first, end):
            u = u_start + affine[1] * col
            v = v_start + affine[4] * col
            if u < 0.0 or v < 0.0 or u >= last_col or v >= last_row:
                continue
            left = np.int64(u)  # floor, for none is negative
            below = np.int64(v)
            if cells[np.int64(v + 0.5), np.int64(u + 0.5)] == 0:
                continue
            u -= left
            v -= below
            lower = (1.0 - u) * evidence[below, left] + u * evidence[below, left + 1]
            upper = (1.0 - u) * evidence[below + 1, left] + u * evidence[below + 1, left + 1]
            out_sum[row, col] += np.float32((1.0 - v) * lower + v * upper)
            out_known[row, col] = True
