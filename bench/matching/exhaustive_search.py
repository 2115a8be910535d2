# SPDX-License-Identifier: Apache-2.0
"""Exhaustive search, algorithm 1 of the paper: the reference for branch and bound.

It scores the same candidates, in the same cells, and decides between equal scores in the same
manner, so both must find the same candidate. There are two versions: one as the paper writes it,
and a fast one.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cartoloop._jit import kernel
from cartoloop.arrays import ByteArray, FloatArray, IntArray
from cartoloop.kernels.node_bounds import COL, KEY, ROTATION, ROW, Places, place_candidate
from cartoloop.kernels.search_order import comes_first, node_key
from cartoloop.kernels.search_window import SearchFrame, SearchWindow

SUM, BEST_COL, BEST_ROW, BEST_ROTATION = range(4)
"""Entries of `out_best`."""

_SHORT_SUM = 257
"""Number of bytes whose sum always fits into 16 bits: 257 * 255 = 2^16 - 1."""


@kernel
def take_if_first(
    total: int, col: int, row: int, rotation: int, window: SearchWindow, best: IntArray
) -> None:
    """Make a candidate the best one, (key, column, row, rotation), if it beats that one."""
    key = node_key(total, col, row, rotation, 1, 1, window)
    if comes_first(key, col, row, rotation, best):
        best[KEY], best[COL], best[ROW], best[ROTATION] = key, col, row, rotation


@kernel
def search_as_written(
    cells: ByteArray,
    points: FloatArray,
    frame: SearchFrame,
    window: SearchWindow,
    out_best: IntArray,
) -> None:
    """Write the best candidate of a window into `out_best`: one candidate after the other.

    Only the points' cells are found once for each rotation rather than for each candidate.

    Parameters
    ----------
    cells : uint8, shape (num_rows, num_cols), of the submap; outside, all is zero.
    points, frame, window : see :func:`branch_and_bound.search`.
    out_best : int64, shape (4,): sum, column, row, rotation, from the window's first candidate on.
    """
    num_points = points.shape[0]
    cols, rows = np.empty(num_points, dtype=np.int32), np.empty(num_points, dtype=np.int32)
    unused = np.empty(num_points, dtype=np.int32)
    num_rows, num_cols = cells.shape
    best = np.full(4, -1, dtype=np.int64)
    largest = -1
    for rotation in range(2 * window.half_rotations + 1):
        theta = frame.theta + (rotation - window.half_rotations) * frame.step
        place_candidate(points, frame, theta, 0, 0, Places(cols, rows, unused))
        for row in range(2 * window.half_rows + 1):
            for col in range(2 * window.half_cols + 1):
                total = np.int64(0)
                for k in range(num_points):
                    x, y = cols[k] + col - window.half_cols, rows[k] + row - window.half_rows
                    if x >= 0 and y >= 0 and x < num_cols and y < num_rows:
                        total += np.int64(cells[y, x])
                if total >= largest:
                    largest = int(total)
                    take_if_first(largest, col, row, rotation, window, best)
    out_best[SUM] = largest
    for k in range(1, 4):
        out_best[k] = best[k]


@kernel
def add_row(cells: ByteArray, row: int, col: int, sums: NDArray[np.uint16]) -> None:
    """Add the cells of a row from a column on to the sums; outside the grid all is zero."""
    if row < 0 or row >= cells.shape[0]:
        return
    begin, end = max(0, -col), min(sums.size, cells.shape[1] - col)
    if begin >= end:
        return
    # Slices, so that the compiler sees plain arrays: it makes vector instructions of the loop.
    source, target = cells[row, col + begin : col + end], sums[begin:end]
    for k in range(target.size):
        target[k] += source[k]


@kernel
def search_by_rows(
    cells: ByteArray,
    points: FloatArray,
    frame: SearchFrame,
    window: SearchWindow,
    out_best: IntArray,
) -> None:
    """Write the best candidate of a window into `out_best`: a row of candidates at once.

    The cells that a point meets in a row of candidates are neighbours: they are read and added as
    whole vectors. This is the fastest known search on one core that scores every candidate.

    Parameters are those of :func:`search_as_written`.
    """
    num_points = points.shape[0]
    cols, rows = np.empty(num_points, dtype=np.int32), np.empty(num_points, dtype=np.int32)
    unused = np.empty(num_points, dtype=np.int32)
    width = 2 * window.half_cols + 1
    sums, short_sums = np.empty(width, dtype=np.int32), np.empty(width, dtype=np.uint16)
    best = np.full(4, -1, dtype=np.int64)
    largest = -1
    for rotation in range(2 * window.half_rotations + 1):
        theta = frame.theta + (rotation - window.half_rotations) * frame.step
        place_candidate(points, frame, theta, 0, 0, Places(cols, rows, unused))
        for row in range(2 * window.half_rows + 1):
            sums[:] = 0
            for begin in range(0, num_points, _SHORT_SUM):
                short_sums[:] = 0
                for k in range(begin, min(begin + _SHORT_SUM, num_points)):
                    add_row(
                        cells,
                        rows[k] + row - window.half_rows,
                        cols[k] - window.half_cols,
                        short_sums,
                    )
                for col in range(width):
                    sums[col] += short_sums[col]
            for col in range(width):
                if sums[col] >= largest:
                    largest = int(sums[col])
                    take_if_first(largest, col, row, rotation, window, best)
    out_best[SUM] = largest
    for k in range(1, 4):
        out_best[k] = best[k]
