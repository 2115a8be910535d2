# SPDX-License-Identifier: Apache-2.0
"""Algorithm 3 of the paper as it is written, with any bounding grids, to compare them.

A node of the tree is a block of 2^h x 2^h translations at a single rotation, eq. (11). The search
is the same for all kinds of bounds: maxima over boxes that begin at every pixel, eq. (17), or grids
of successively halved resolution (the paper's [1]), in which a box meets up to 2 x 2 cells. There
are no blocks of points, no groups of rotations and no vector instructions.
"""

from __future__ import annotations

import numpy as np

from cartoloop._jit import kernel
from cartoloop.arrays import ByteArray, CellArray, FloatArray, IntArray
from cartoloop.kernels.node_bounds import COL, KEY, ROTATION, ROW, Places, place_candidate
from cartoloop.kernels.search_order import comes_first, node_key, order_by_key
from cartoloop.kernels.search_window import SearchFrame, SearchWindow

FIRST, ROW_LENGTH, NUM_ROWS, BEFORE, SHIFT, READS_FOUR = range(6)
"""Columns of `levels`, see :func:`search_plainly`."""

_HEIGHT = 4
"""Column of a node's height, after key, column, row and rotation."""
_NEAR = 28
"""Bits of a key that hold the distance from the estimate, see search_order.node_key()."""


@kernel
def bound_of(
    grids: ByteArray,
    levels: IntArray,
    height: int,
    cols: CellArray,
    rows: CellArray,
    rotation: int,
    col: int,
    row: int,
) -> int:
    """Return the upper bound of the sums of a node's candidates, eq. (16).

    Parameters
    ----------
    grids, levels : see :func:`search_plainly`.
    height : of the node.
    cols, rows : int32, shape (num_rotations, num_points), cells of the points by rotation.
    rotation : of the node.
    col, row : of its first translation [cells from the estimate].
    """
    first, row_length = levels[height, FIRST], levels[height, ROW_LENGTH]
    before, shift, last = levels[height, BEFORE], levels[height, SHIFT], (1 << height) - 1
    reads_four = levels[height, READS_FOUR]
    end_col, end_row = row_length - reads_four, levels[height, NUM_ROWS] - reads_four
    total = np.int64(0)
    for k in range(cols.shape[1]):
        x, y = cols[rotation, k] + col, rows[rotation, k] + row
        i, j = (x >> shift) + before, (y >> shift) + before
        if i < 0 or j < 0 or i >= end_col or j >= end_row:
            continue
        at = first + j * row_length + i
        value = np.int64(grids[at])
        if reads_four != 0:
            right = ((x + last) >> shift) - (x >> shift)
            above = (((y + last) >> shift) - (y >> shift)) * row_length
            value = max(value, np.int64(grids[at + right]))
            value = max(value, np.int64(grids[at + above]))
            value = max(value, np.int64(grids[at + above + right]))
        total += value
    return int(total)


@kernel
def place_rotations(
    points: FloatArray,
    frame: SearchFrame,
    window: SearchWindow,
    out_cols: CellArray,
    out_rows: CellArray,
) -> None:
    """Write the cells of the points at each rotation of the window into `out_cols`, `out_rows`.

    Parameters
    ----------
    points, frame, window : see :func:`branch_and_bound.search`.
    out_cols, out_rows : int32, shape (2 w_theta + 1, num_points).
    """
    unused = np.empty(points.shape[0], dtype=np.int32)
    for rotation in range(out_cols.shape[0]):
        theta = frame.theta + (rotation - window.half_rotations) * frame.step
        places = Places(out_cols[rotation], out_rows[rotation], unused)
        place_candidate(points, frame, theta, 0, 0, places)


@kernel
def score_top(
    grids: ByteArray,
    levels: IntArray,
    cols: CellArray,
    rows: CellArray,
    window: SearchWindow,
    min_sum: int,
    out_nodes: IntArray,
) -> int:
    """Write the nodes of C_0, eq. (13), that may reach `min_sum` into `out_nodes`; return how many.

    Parameters are those of :func:`search_plainly` and :func:`bound_of`; `out_nodes` has a row of
    key, column, row and rotation for each node of C_0.
    """
    top = levels.shape[0] - 1
    block, count = 1 << top, 0
    for rotation in range(cols.shape[0]):
        for row in range(0, 2 * window.half_rows + 1, block):
            for col in range(0, 2 * window.half_cols + 1, block):
                bound = bound_of(
                    grids,
                    levels,
                    top,
                    cols,
                    rows,
                    rotation,
                    col - window.half_cols,
                    row - window.half_rows,
                )
                if bound >= min_sum:
                    key = node_key(bound, col, row, rotation, block, 1, window)
                    out_nodes[count, KEY], out_nodes[count, COL] = key, col
                    out_nodes[count, ROW], out_nodes[count, ROTATION] = row, rotation
                    count += 1
    return count


@kernel
def push_children(
    grids: ByteArray,
    levels: IntArray,
    cols: CellArray,
    rows: CellArray,
    window: SearchWindow,
    node: IntArray,
    min_sum: int,
    least_key: int,
    stack: IntArray,
    first: int,
    out_counts: IntArray,
) -> int:
    """Branch, eq. (14): push a node's children, the largest key last; return the stack's new end.

    Parameters are those of :func:`search_plainly` and :func:`bound_of`; `least_key` is that of the
    best candidate so far, and the children go onto the stack from `first` on.
    """
    height, end = node[_HEIGHT] - 1, first
    block = 1 << height
    for child in range(4):
        col, row = node[COL] + block * (child & 1), node[ROW] + block * (child >> 1)
        if col > 2 * window.half_cols or row > 2 * window.half_rows:
            continue
        out_counts[height] += 1
        rotation = node[ROTATION]
        bound = bound_of(
            grids,
            levels,
            height,
            cols,
            rows,
            rotation,
            col - window.half_cols,
            row - window.half_rows,
        )
        key = node_key(bound, col, row, rotation, block, 1, window)
        if bound < min_sum or key < least_key:
            continue
        at = end
        while at > first and stack[at - 1, KEY] > key:
            stack[at] = stack[at - 1]
            at -= 1
        stack[at, KEY], stack[at, COL], stack[at, ROW] = key, col, row
        stack[at, ROTATION], stack[at, _HEIGHT] = rotation, height
        end += 1
    return end


@kernel
def search_plainly(
    grids: ByteArray,
    levels: IntArray,
    points: FloatArray,
    frame: SearchFrame,
    window: SearchWindow,
    min_sum: int,
    out_best: IntArray,
    out_counts: IntArray,
) -> None:
    """Write the best candidate of a window into `out_best`, the nodes scored into `out_counts`.

    Parameters
    ----------
    grids : uint8, shape (n,): the bounding grids of all heights, row after row.
    levels : int64, shape (h_0 + 1, 6): of the grid of each height, where in `grids` it begins;
        length and number of its rows; how many of its cells lie before the submap's first one;
        binary logarithm of its cells' edge [pixels]; 1 if a box is bounded by the up to four cells
        that it meets, 0 if by the cell it begins in. In the former case the last row and column are
        zero.
    points, frame, window, min_sum : see :func:`branch_and_bound.search`.
    out_best : int64, shape (4,): sum, column, row, rotation, from the window's first candidate on;
        the sum is -1 where there is none.
    out_counts : int64, shape (h_0 + 1,): nodes scored at each height.
    """
    num_rotations, top = 2 * window.half_rotations + 1, levels.shape[0] - 1
    cols = np.empty((num_rotations, points.shape[0]), dtype=np.int32)
    rows = np.empty((num_rotations, points.shape[0]), dtype=np.int32)
    place_rotations(points, frame, window, cols, rows)
    num_tiles = ((2 * window.half_cols >> top) + 1) * ((2 * window.half_rows >> top) + 1)
    nodes = np.empty((num_rotations * num_tiles, 4), dtype=np.int64)
    count = score_top(grids, levels, cols, rows, window, min_sum, nodes)
    out_counts[:] = 0
    out_counts[top] = nodes.shape[0]
    order = order_by_key(nodes, 0, count)
    stack = np.empty((4 * top + 1, 5), dtype=np.int64)
    node, best = np.empty(5, dtype=np.int64), np.full(4, -1, dtype=np.int64)
    for k in range(count):
        if nodes[order[k], KEY] < best[KEY]:
            break
        stack[0, :4], stack[0, _HEIGHT] = nodes[order[k]], top
        end = 1
        while end > 0:
            end -= 1
            node[:] = stack[end]
            if node[KEY] < best[KEY]:
                continue
            if node[_HEIGHT] == 0:
                if comes_first(node[KEY], node[COL], node[ROW], node[ROTATION], best):
                    best[:] = node[:4]
                continue
            end = push_children(
                grids, levels, cols, rows, window, node, min_sum, best[KEY], stack, end, out_counts
            )
    out_best[:] = best
    out_best[0] = best[KEY] >> _NEAR
