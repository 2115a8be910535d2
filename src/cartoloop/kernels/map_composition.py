# SPDX-License-Identifier: Apache-2.0
"""One map of many submaps: the evidence of all of them adds up, each at its optimised pose."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cartoloop._jit import kernel


@kernel
def cell_evidence(
    cells: NDArray[np.uint8], log_odds: NDArray[np.float32], out_evidence: NDArray[np.float32]
) -> None:
    """Write the log-odds that each cell of a submap adds to a map into `out_evidence`.

    Parameters
    ----------
    cells : uint8, shape (rows, cols), 0 unknown; the outermost rows and columns must be unknown.
    log_odds : float32, shape (256,), of a cell of each value; 0 for value 0.
    out_evidence : float32, shape (rows, cols).

    Notes
    -----
    A cell beside one that was hit may be called free by rays that met the hit cell: submaps know
    walls to a pixel only. Such cells abstain, otherwise two submaps that place a wall a pixel
    apart would wipe out each other's wall. O(cells).
    """
    for row in range(cells.shape[0]):
        for col in range(cells.shape[1]):
            out_evidence[row, col] = log_odds[cells[row, col]]
    for row in range(1, cells.shape[0] - 1):
        for col in range(1, cells.shape[1] - 1):
            if out_evidence[row, col] > 0.0:
                for near_row in range(row - 1, row + 2):
                    for near_col in range(col - 1, col + 2):
                        if out_evidence[near_row, near_col] < 0.0:
                            out_evidence[near_row, near_col] = 0.0


@kernel
def columns_within(start: float, step: float, end: float, first: int, last: int) -> tuple[int, int]:
    """Return the part of columns ``first <= col < last`` with ``0 <= start + step * col < end``.

    One more may be returned on either side, for rounding.
    """
    if abs(step) < 1e-9:  # the rows run along it: all or none, which the caller sees anyway
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
    cells: NDArray[np.uint8],
    evidence: NDArray[np.float32],
    affine: NDArray[np.float64],
    window: NDArray[np.int64],
    out_sum: NDArray[np.float32],
    out_known: NDArray[np.bool_],
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
    neighbours adding nothing: taking the nearest alone frays walls that stand oblique, and
    interpolating probabilities would let a doubt outweigh a certainty. O(cells of the window).
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
