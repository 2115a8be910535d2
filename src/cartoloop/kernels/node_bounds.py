# SPDX-License-Identifier: Apache-2.0
"""Upper bounds for the nodes of the branch-and-bound tree, eq. (15) to (17).

While a group of neighbouring rotations turns the scan, a point moves over an arc whose length grows
with its range. The box of cells that it can meet, over all translations and rotations of a node, is
looked up in a grid of maxima over boxes just large enough for it: near points get small boxes and
far points large ones, so the bounds stay nearly as tight as those of single rotations, at a
fraction of their number.

Sums of bytes are whole numbers, exact in any order. Points are taken in blocks: once the sum so
far, plus all that the parent's bound leaves to the points to come, is below what is sought, the
node is given up.

Numba counts references to arrays around every call that it cannot inline; these functions are small
and take no slices because in the innermost loops that would cost more than the sums.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from cartoloop._jit import kernel

ByteArray = NDArray[np.uint8]
CellArray = NDArray[np.int32]
FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

# Columns of `heights`, see branch_and_bound.search().
BLOCK, GROUP, SHIFT, MARGIN, LAST_COL, LAST_ROW, ROW_LENGTH, FIRST_GROUP = range(8)
# Entries of `frame`, see there.
X, Y, THETA, ORIGIN_X, ORIGIN_Y, RESOLUTION, STEP = range(7)
# Columns of a node: key, column, row, group of rotations, and from REST on what the bound leaves to
# the points of each block and of all later ones.
KEY, COL, ROW, ROTATION, REST = range(5)

_ROUNDING = 1e-6  # cells; far more than rotating a point can be off by rounding


@kernel
def scan_range(points: FloatArray) -> tuple[float, float]:
    """Return the mean and the maximum, eq. (6), of the points' distances from the scan's origin.

    Parameters
    ----------
    points : float64, shape (n, 2), n > 0.
    """
    total, largest = 0.0, 0.0
    for k in range(points.shape[0]):
        distance = math.hypot(points[k, 0], points[k, 1])
        total += distance
        largest = max(largest, distance)
    return total / points.shape[0], largest


@kernel
def place_candidate(
    points: FloatArray,
    frame: FloatArray,
    theta: float,
    box: int,
    first: int,
    out_cols: CellArray,
    out_rows: CellArray,
    out_boxes: CellArray,
) -> None:
    """Write the cells of the points at one rotation into the `out_` arrays.

    The rounding of exactly these operations defines the candidates' cells; bounds allow for it.

    Parameters
    ----------
    points : float64, shape (n, 2).
    frame : see :func:`branch_and_bound.search`.
    theta : rotation [rad].
    box : where the grid of single cells begins.
    first, out_cols, out_rows, out_boxes : int32; where to write columns, rows, and `box`.
    """
    if first < 0:  # tells the compiler that no index counts from the end
        return
    cos, sin = math.cos(theta), math.sin(theta)
    x0, y0, origin_x, origin_y = frame[X], frame[Y], frame[ORIGIN_X], frame[ORIGIN_Y]
    resolution = frame[RESOLUTION]
    for k in range(points.shape[0]):
        x = x0 + (cos * points[k, 0] - sin * points[k, 1]) - origin_x
        y = y0 + (sin * points[k, 0] + cos * points[k, 1]) - origin_y
        out_cols[first + k] = np.int32(np.floor(x / resolution + 0.5))
        out_rows[first + k] = np.int32(np.floor(y / resolution + 0.5))
        out_boxes[first + k] = box


@kernel
def place_group(
    points: FloatArray,
    frame: FloatArray,
    begin: float,
    end: float,
    boxes: CellArray,
    height: int,
    first: int,
    out_cols: CellArray,
    out_rows: CellArray,
    out_boxes: CellArray,
) -> None:
    """Write the boxes of cells that the points meet between two rotations into the `out_` arrays.

    Parameters
    ----------
    points, frame : see :func:`place_candidate`.
    begin, end : first and last rotation of the group [rad], less than half a turn apart.
    boxes, height : int32, shape (num_heights, num_moves): by the number of cells that a point
        moves, where the grid of its box begins; and which row of that.
    first, out_cols, out_rows, out_boxes : int32; where to write the boxes' first columns and rows,
        and where their grids begin.
    """
    if first < 0:  # tells the compiler that no index counts from the end
        return
    cos0, sin0, cos1, sin1 = math.cos(begin), math.sin(begin), math.cos(end), math.sin(end)
    # Between its ends an arc goes beyond them by the sagitta at the most, and only where it turns.
    sagitta = 1.0 - math.cos(0.5 * (end - begin))
    scale = 1.0 / frame[RESOLUTION]
    x0 = (frame[X] - frame[ORIGIN_X]) * scale + 0.5
    y0 = (frame[Y] - frame[ORIGIN_Y]) * scale + 0.5
    for k in range(points.shape[0]):
        x, y = points[k, 0] * scale, points[k, 1] * scale
        begin_x, begin_y = cos0 * x - sin0 * y, sin0 * x + cos0 * y
        end_x, end_y = cos1 * x - sin1 * y, sin1 * x + cos1 * y
        beyond = math.sqrt(x * x + y * y) * sagitta
        beyond_x = _ROUNDING + (beyond if begin_y * end_y <= 0.0 else 0.0)
        beyond_y = _ROUNDING + (beyond if begin_x * end_x <= 0.0 else 0.0)
        low_col = np.floor(x0 + min(begin_x, end_x) - beyond_x)
        low_row = np.floor(y0 + min(begin_y, end_y) - beyond_y)
        num_cols = np.floor(x0 + max(begin_x, end_x) + beyond_x) - low_col
        num_rows = np.floor(y0 + max(begin_y, end_y) + beyond_y) - low_row
        out_cols[first + k] = np.int32(low_col)
        out_rows[first + k] = np.int32(low_row)
        out_boxes[first + k] = np.int32(max(num_cols, num_rows))
    for k in range(first, first + points.shape[0]):
        out_boxes[k] = boxes[height, out_boxes[k]]


@kernel
def place_points(
    heights: IntArray,
    boxes: CellArray,
    points: FloatArray,
    frame: FloatArray,
    window: IntArray,
    height: int,
    group: int,
    first: int,
    out_cols: CellArray,
    out_rows: CellArray,
    out_boxes: CellArray,
) -> None:
    """Write where the points of a group of rotations look up their maxima into the `out_` arrays.

    Parameters are those of :func:`branch_and_bound.search` and :func:`place_group`.
    """
    theta, step, size = frame[THETA], frame[STEP], heights[height, GROUP]
    begin = group * size
    end = min(begin + size, 2 * window[2] + 1) - 1
    if height == 0:
        place_candidate(
            points,
            frame,
            theta + (begin - window[2]) * step,
            boxes[0, 0],
            first,
            out_cols,
            out_rows,
            out_boxes,
        )
    else:
        place_group(
            points, frame, theta + (begin - window[2]) * step, theta + (end - window[2]) * step,
            boxes, height, first, out_cols, out_rows, out_boxes,
        )  # fmt: skip


@kernel
def locate(
    cols: CellArray,
    rows: CellArray,
    boxes: CellArray,
    first: int,
    col: np.int32,
    row: np.int32,
    shift: np.int32,
    margin: np.int32,
    last_col: np.int32,
    last_row: np.int32,
    row_length: np.int32,
    out_index: CellArray,
) -> None:
    """Write where a block of points looks up its maxima, moved by (col, row), into `out_index`.

    Far outside the grid all is zero, so positions are clamped to where that begins.
    """
    if first < 0:  # tells the compiler that no index counts from the end
        return
    low = np.int32(-margin)
    for k in range(out_index.size):
        x = min(max(np.int32((cols[first + k] + col) >> shift), low), last_col)
        y = min(max(np.int32((rows[first + k] + row) >> shift), low), last_row)
        out_index[k] = boxes[first + k] + y * row_length + x


@kernel
def sum_four(
    cells: ByteArray, index: CellArray, num_points: int, right: int, above: int
) -> tuple[np.int64, np.int64, np.int64, np.int64]:
    """Return the sums of the cells at `index` and of those to the right, above, and above right."""
    a, b, c, d = np.int64(0), np.int64(0), np.int64(0), np.int64(0)
    for k in range(num_points):
        i = np.uint64(index[k])  # unsigned: no test for indices that count from the end
        a += np.int64(cells[i])
        b += np.int64(cells[i + np.uint64(right)])
        c += np.int64(cells[i + np.uint64(above)])
        d += np.int64(cells[i + np.uint64(above + right)])
    return a, b, c, d


@kernel
def score_children(
    cells: ByteArray,
    heights: IntArray,
    height: int,
    cols: CellArray,
    rows: CellArray,
    grids: CellArray,
    first: int,
    num_points: int,
    col: int,
    row: int,
    step: int,
    nodes: IntArray,
    parent: int,
    least: int,
    index: CellArray,
    out_sums: IntArray,
) -> bool:
    """Write the sums of four neighbouring nodes into `out_sums`; return whether to keep any.

    Parameters
    ----------
    cells, heights : see :func:`branch_and_bound.search`.
    height : of the four nodes.
    cols, rows, grids, first : int32: from `first` on what :func:`place_points` writes.
    col, row : of the first of the nodes [cells from the estimate].
    step : to the next [cells]; 0 where there is but one.
    nodes, parent : int64, nodes, and which of them is the parent.
    least : sums below it are not sought.
    index : int32, scratch, an entry for each point of a block.
    out_sums : int64, shape (num_blocks, 4): sums after each block of points.
    """
    shift, row_length = heights[height, SHIFT], heights[height, ROW_LENGTH]
    margin, last_col, last_row = (
        heights[height, MARGIN],
        heights[height, LAST_COL],
        heights[height, LAST_ROW],
    )
    right = step >> shift
    above = right * row_length
    a, b, c, d = np.int64(0), np.int64(0), np.int64(0), np.int64(0)
    for block in range(out_sums.shape[0]):
        begin = block * index.size
        locate(
            cols, rows, grids, first + begin, np.int32(col), np.int32(row), np.int32(shift),
            np.int32(margin), np.int32(last_col), np.int32(last_row), np.int32(row_length), index,
        )  # fmt: skip
        da, db, dc, dd = sum_four(cells, index, min(index.size, num_points - begin), right, above)
        a, b, c, d = a + da, b + db, c + dc, d + dd
        out_sums[block, 0], out_sums[block, 1], out_sums[block, 2], out_sums[block, 3] = a, b, c, d
        if max(a, b, c, d) + nodes[parent, REST + block + 1] < least:
            return False
    return True
