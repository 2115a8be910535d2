# SPDX-License-Identifier: Apache-2.0
"""Upper bounds for boxes of translations of a scan at one rotation, for the correlative matcher.

Probabilities rounded up to bytes, and the maxima of these over boxes of several sizes, bound the
scores of all translations in a box by one look-up for each point. Sums of bytes are whole numbers,
exact in any order. Points that have the least byte in the whole window have it in each box as well:
most of them, where a scan shows a new place.

A node of the tree is one number, so that nodes are in the order of their sums: ::

    bit 62           35 34          30 29         15 14          0
        [ sum of bytes ][ tree level ][ window row ][ window column ]

The translation of its box's first cell is counted from that of the window [cells].
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cartoloop._jit import borrowing_kernel, kernel
from cartoloop.arrays import ByteArray, CellArray, IntArray
from cartoloop.kernels.precomputation_grid import widen_boxes

MAX_BYTE = 255.0
"""The byte of probability 1, as a float: sums are divided by it."""

_PLACE_BITS, _LEVEL_BITS = 15, 5
"""Bits of a node that hold a column or a row, and its level. No memory holds a wider window."""


@kernel
def box_sizes(width: int) -> IntArray:
    """Return the widths of the boxes of each level: `width`, half of it rounded up, ..., 1."""
    num_levels = 1
    size = width
    while size > 1:
        size = (size + 1) // 2
        num_levels += 1
    sizes = np.empty(num_levels, dtype=np.int64)
    size = width
    for level in range(num_levels):
        sizes[level] = size
        size = (size + 1) // 2
    return sizes


class GridPart(NamedTuple):
    """A part of a grid, which may reach beyond the grid.

    Attributes
    ----------
    first_col, first_row : of the grid [cells].
    row_length, num_rows : size of the part [cells].
    """

    first_col: int
    first_row: int
    row_length: int
    num_rows: int


@borrowing_kernel
def index_points(
    cols: CellArray,
    rows: CellArray,
    half_width: int,
    num_cols: int,
    num_rows: int,
    out_index: CellArray,
) -> GridPart:
    """Write where the points look up their windows' first cells; return the part of the grid.

    Parameters
    ----------
    cols, rows : int32, shape (n,), cells of the points without translation.
    half_width : w of eq. (8), in cells.
    num_cols, num_rows : size of the grid.
    out_index : int32, shape (n,), into the part of the grid.

    Returns
    -------
    The part of the grid that all windows together meet. Of windows wholly outside, those next to
    the grid are taken.
    """
    width = 2 * half_width + 1
    shift, outside = np.int32(half_width), np.int32(-width)
    last_col, last_row = np.int32(num_cols), np.int32(num_rows)
    min_col, max_col, min_row, max_row = last_col, outside, last_row, outside
    for k in range(cols.size):
        col = min(max(np.int32(cols[k] - shift), outside), last_col)
        row = min(max(np.int32(rows[k] - shift), outside), last_row)
        min_col, max_col = min(min_col, col), max(max_col, col)
        min_row, max_row = min(min_row, row), max(max_row, row)
    row_length = np.int32(max_col - min_col + width)
    for k in range(cols.size):
        col = min(max(np.int32(cols[k] - shift), outside), last_col)
        row = min(max(np.int32(rows[k] - shift), outside), last_row)
        out_index[k] = (row - min_row) * row_length + (col - min_col)
    return GridPart(
        int(np.int64(min_col)),
        int(np.int64(min_row)),
        int(np.int64(row_length)),
        int(np.int64(max_row - min_row + width)),
    )


@borrowing_kernel
def least_byte(unknown: float) -> int:
    """Return the least byte of :func:`quantize_cells`, that of a cell never observed."""
    return int(np.uint8(np.ceil(np.float32(unknown) * np.float32(MAX_BYTE))))


@borrowing_kernel
def quantize_cells(
    grid: NDArray[np.float32], unknown: float, part: GridPart, out_cells: ByteArray
) -> None:
    """Write a part of a grid, probabilities rounded up to bytes, into `out_cells`.

    Parameters
    ----------
    grid : float32, shape (num_rows, num_cols), probabilities; 0 or less where never observed.
    unknown : the value of cells never observed or outside.
    part : of the grid.
    out_cells : uint8, shape (n,), row after row.
    """
    first_col, first_row, row_length = part.first_col, part.first_row, part.row_length
    num_rows, num_cols = grid.shape
    scale = np.float32(MAX_BYTE)
    least = np.float32(unknown)
    out_cells[:] = least_byte(unknown)
    begin = max(-first_col, 0)
    end = min(num_cols - first_col, row_length)
    if begin >= end:
        return
    for row in range(max(-first_row, 0), min(num_rows - first_row, out_cells.size // row_length)):
        source = grid[first_row + row, first_col + begin : first_col + end]
        target = out_cells[row * row_length + begin : row * row_length + end]
        for k in range(source.size):
            target[k] = np.uint8(np.int32(np.ceil(max(source[k], least) * scale)))


@kernel
def bounding_grids(
    grid: NDArray[np.float32],
    unknown: float,
    part: GridPart,
    sizes: IntArray,
    out_cells: ByteArray,
) -> None:
    """Write the maxima over the boxes of each level, one grid after the other, into `out_cells`.

    Parameters
    ----------
    grid, unknown, part : as in :func:`quantize_cells`.
    sizes : int64, shape (num_levels,), see :func:`box_sizes`. A box begins at its cell; those that
        reach beyond the part are not used.
    out_cells : uint8, shape (num_levels * row_length * num_rows,).
    """
    row_length = part.row_length
    area = row_length * part.num_rows
    last = sizes.size - 1
    quantize_cells(grid, unknown, part, out_cells[last * area :])
    for level in range(last - 1, -1, -1):
        begin = level * area
        growth = sizes[level] - sizes[level + 1]
        boxes, wider = out_cells[begin + area : begin + 2 * area], out_cells[begin : begin + area]
        widen_boxes(boxes, growth, row_length, wider)


@borrowing_kernel
def keep_higher(
    cells: ByteArray, index: CellArray, first: int, num_points: int, least: int
) -> tuple[np.int64, np.int64]:
    """Move the points whose cells are higher than the least value to the front, in their order.

    The others have the least value in every box within that of their cell.

    Parameters
    ----------
    cells : grid of maxima over the largest boxes.
    index : int32, shape (n,): where points look up; of these the points to look at are `num_points`
        from `first` on. The places behind those moved to the front remain of no use.
    least : the least value of any cell.

    Returns
    -------
    The sum of the cells of all points, and the number of those moved to the front.
    """
    total, num_kept = np.int64(0), np.int64(0)
    for k in range(first, first + num_points):
        at = index[k]
        value = np.int64(cells[np.uint64(at)])
        index[first + num_kept] = at
        num_kept += value > least
        total += value
    return total, num_kept


@borrowing_kernel
def sum_quarters(
    cells: ByteArray,
    index: CellArray,
    first: int,
    num_points: int,
    shift: int,
    right: int,
    above: int,
) -> tuple[np.int64, np.int64, np.int64, np.int64]:
    """Return the sums of the cells at ``index[first : first + num_points] + shift``.

    Also of those to the right, above, and above right.
    """
    a, b, c, d = np.int64(0), np.int64(0), np.int64(0), np.int64(0)
    for k in range(first, first + num_points):
        i = np.uint64(index[np.uint64(k)] + shift)  # unsigned: no test for counts from the end
        a += np.int64(cells[i])
        b += np.int64(cells[i + np.uint64(right)])
        c += np.int64(cells[i + np.uint64(above)])
        d += np.int64(cells[i + np.uint64(above + right)])
    return a, b, c, d


@borrowing_kernel
def packed_node(total: np.int64, level: int, row: int, col: int) -> np.int64:
    """Return a node as one number."""
    return (((((total << _LEVEL_BITS) | level) << _PLACE_BITS) | row) << _PLACE_BITS) | col


@borrowing_kernel
def unpacked_node(node: int) -> tuple[int, int, int, int]:
    """Return sum, level, row and column of a node."""
    places, level = (1 << _PLACE_BITS) - 1, (1 << _LEVEL_BITS) - 1
    row, higher = (node >> _PLACE_BITS) & places, node >> (2 * _PLACE_BITS)
    return higher >> _LEVEL_BITS, higher & level, row, node & places


@borrowing_kernel
def push_quarters(
    cells: ByteArray,
    index: CellArray,
    first: int,
    num_points: int,
    area: int,
    row_length: int,
    sizes: IntArray,
    others: int,
    node: int,
    stack: IntArray,
    top: int,
) -> int:
    """Push the quarters of a node on the stack, the best uppermost; return its new height.

    Parameters
    ----------
    cells, area, row_length : grids of maxima over the boxes of each level, `area` bytes each.
    index, first, num_points : where the points at the rotation look up the window's first cell.
    sizes : int64, shape (num_levels,), see :func:`box_sizes`.
    others : what further points add to each sum.
    node : it is not of the last level.
    stack : int64, shape (m,): nodes.
    top : height of the stack.
    """
    _, parent_level, row, col = unpacked_node(node)
    level = parent_level + 1
    step = sizes[level - 1] - sizes[level]
    shift = level * area + row * row_length + col
    here, right, above, corner = sum_quarters(
        cells, index, first, num_points, shift, step, step * row_length
    )
    a = packed_node(here + others, level, row, col)
    b = packed_node(right + others, level, row, col + step)
    c = packed_node(above + others, level, row + step, col)
    d = packed_node(corner + others, level, row + step, col + step)
    a, b, c, d = min(a, b), max(a, b), min(c, d), max(c, d)
    a, b, c, d = min(a, c), min(b, d), max(a, c), max(b, d)
    stack[top], stack[top + 1], stack[top + 2], stack[top + 3] = a, min(b, c), max(b, c), d
    return top + 4
