# SPDX-License-Identifier: Apache-2.0
"""The precomputed grids of branch and bound, eq. (17): maxima over boxes of cells.

A grid of maxima is kept row after row in one dimension, with a margin of zeros around it that is
wider than its boxes. Running over the end of a row then leads into the margin of the next row, and
a whole grid can be treated as one long row, which compilers turn into vector instructions.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cartoloop._jit import kernel
from cartoloop.arrays import ByteArray, CellArray, IntArray
from cartoloop.kernels.node_bounds import Records


class GridArrays(NamedTuple):
    """The precomputed grids of a submap.

    Attributes
    ----------
    cells : uint8, shape (n,): all grids, one after the other.
    levels : of :data:`node_bounds.LEVEL`, shape (num_levels,), for blocks of 1, 2, 4, ...
        translations.
    boxes : int32, shape (num_levels, num_moves): where in `cells` the first cell of the grid is
        whose boxes are large enough for the block if a point moves by this number of cells.
    """

    cells: ByteArray
    levels: Records
    boxes: CellArray


@kernel
def halve(cells: ByteArray, out_cells: ByteArray) -> None:
    """Write the maximum of each 2 x 2 block of cells into `out_cells`.

    Parameters
    ----------
    cells : uint8, shape (num_rows, num_cols).
    out_cells : uint8, shape (ceil(num_rows / 2), ceil(num_cols / 2)).
    """
    num_rows, num_cols = cells.shape
    for row in range(out_cells.shape[0]):
        upper = cells[2 * row]
        lower = cells[min(2 * row + 1, num_rows - 1)]
        for col in range(num_cols // 2):
            left = max(upper[2 * col], lower[2 * col])
            right = max(upper[2 * col + 1], lower[2 * col + 1])
            out_cells[row, col] = max(left, right)
        if num_cols % 2 == 1:
            out_cells[row, num_cols // 2] = max(upper[num_cols - 1], lower[num_cols - 1])


@kernel
def surround(cells: ByteArray, margin: int, row_length: int, out_grid: ByteArray) -> None:
    """Write the cells and the zeros around them into `out_grid`.

    Parameters
    ----------
    cells : uint8, shape (num_rows, num_cols).
    margin : zeros before the first column and the first row.
    row_length : of a row with its margins; at least margin + num_cols.
    out_grid : uint8, shape (n,); cell (row, col) goes to
        (row + margin) * row_length + col + margin.
    """
    for k in range(out_grid.size):
        out_grid[k] = 0
    for row in range(cells.shape[0]):
        target = out_grid[(row + margin) * row_length + margin :]
        for col in range(cells.shape[1]):
            target[col] = cells[row, col]


@kernel
def widen_boxes(boxes: ByteArray, growth: int, row_length: int, out_boxes: ByteArray) -> None:
    """Write the maxima over boxes that are wider and higher by `growth` into `out_boxes`.

    Parameters
    ----------
    boxes : uint8, shape (n,): at each cell the maximum of the box of size x size cells that begins
        there; rows of `row_length`, margins of zeros wider than size + growth before and after.
    growth : cells, at most the size of the boxes.
    row_length : cells.
    out_boxes : uint8, shape (n,).

    Notes
    -----
    The wider box is the union of four boxes, so that each level of the pyramid is made of the one
    below it with three comparisons a cell, where the paper keeps a deque. O(n).
    """
    n = boxes.size
    up = growth * row_length
    # Slices, not offsets, so that the compiler sees four plain arrays.
    right, above, corner = boxes[growth:], boxes[up:], boxes[up + growth :]
    for k in range(n - up - growth):
        out_boxes[k] = max(boxes[k], right[k], above[k], corner[k])
    # The last rows, above which there is nothing.
    for k in range(max(n - up - growth, 0), n - growth):
        out_boxes[k] = max(boxes[k], right[k])
    for k in range(max(n - growth, 0), n):
        out_boxes[k] = boxes[k]


@kernel
def grow_boxes(
    cells: ByteArray, edges: IntArray, margin: int, row_length: int, out_grids: ByteArray
) -> None:
    """Write the maxima over boxes of several sizes into `out_grids`.

    Parameters
    ----------
    cells : uint8, shape (num_rows, num_cols).
    edges : int64, shape (k,), ascending: of the boxes of each grid [cells].
    margin, row_length : as in :func:`surround`; the margin is wider than the largest box.
    out_grids : uint8, shape (k, n): at (row + margin) * row_length + col + margin the maximum of
        the box that begins at (row, col).
    """
    size = out_grids.shape[1]
    boxes = out_grids[0] if edges[0] == 1 else np.empty(size, dtype=np.uint8)
    surround(cells, margin, row_length, boxes)
    edge = 1
    for number in range(edges.size):
        while edges[number] > 2 * edge:
            wider = np.empty(size, dtype=np.uint8)
            widen_boxes(boxes, edge, row_length, wider)
            boxes, edge = wider, 2 * edge
        if edges[number] > edge:
            widen_boxes(boxes, edges[number] - edge, row_length, out_grids[number])
        boxes, edge = out_grids[number], edges[number]
