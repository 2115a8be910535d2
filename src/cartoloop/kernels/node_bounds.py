# SPDX-License-Identifier: Apache-2.0
"""Upper bounds for the nodes of the branch-and-bound tree, eq. (15) to (17).

While a group of neighbouring rotations turns the scan, a point moves over an arc whose length grows
with its range. The box of cells that it can meet, over all translations and rotations of a node, is
looked up in a grid of maxima over boxes just large enough for it: near points get small boxes and
far points large ones, so the bounds stay nearly as tight as those of single rotations, at a
fraction of their number.

Sums of bytes are whole numbers, exact in any order. Points are taken in blocks: once the sum so
far, plus all that the parent's bound leaves to the remaining points, is below the threshold, the
node is given up.

These functions count no references to arrays (`borrowing_kernel`): in the innermost loops that
would cost more than the sums. They take few arrays and no slices, which are passed faster.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cartoloop._jit import borrowing_kernel
from cartoloop.arrays import ByteArray, CellArray, FloatArray, IntArray
from cartoloop.kernels.search_window import SearchFrame, SearchWindow

Records = NDArray[np.void]

_GRID_FIELDS = [
    ("shift", np.int64),
    ("margin", np.int64),
    ("last_col", np.int64),
    ("last_row", np.int64),
    ("row_length", np.int64),
]

LEVEL = np.dtype(_GRID_FIELDS)
"""The precomputed grids for blocks of 2^level translations: binary logarithm of their stride
[cells]; zeros before the first column and row, last column, last row and length of a row
[strides]."""

HEIGHT = np.dtype(
    [("block", np.int64), ("group", np.int64), *_GRID_FIELDS, ("first_group", np.int64)]
)
"""The nodes of one height of the tree: edge of the block of translations [cells]; rotations in a
group; the grids that bound them, as in :data:`LEVEL`; number of groups at all lower heights."""

KEY, COL, ROW, ROTATION, REST = range(5)
"""Columns of `nodes`: key, column, row, group of rotations, and from REST on what the bound leaves
to the points of each block of points and of all later ones."""

_ROUNDING = 1e-6
"""More than rotating a point can be off by rounding [cells]."""


class Places(NamedTuple):
    """Where points look up their maxima, without the translation of a node.

    Attributes
    ----------
    cols, rows : int32, shape (n,): first column and row of the box of a point [cells].
    boxes : int32, shape (n,): where in `cells` the first cell of the grid is whose boxes are large
        enough for it.
    """

    cols: CellArray
    rows: CellArray
    boxes: CellArray


class PlacedScan(NamedTuple):
    """A scan, and where its points look up their maxima at each group of rotations.

    Attributes
    ----------
    num_points : n.
    points : float64, shape (n, 2), tracking frame [m].
    frame : of the search.
    move_boxes : int32, shape (num_heights, num_moves): by the number of cells that a point moves,
        where the grid of its box begins.
    places : shape (num_groups * num_places,).
    """

    num_points: int
    points: FloatArray
    frame: SearchFrame
    move_boxes: CellArray
    places: Places


class Children(NamedTuple):
    """Up to four nodes that differ in their translations alone.

    Attributes
    ----------
    parent : row of their parent in `nodes`.
    height : of the nodes.
    col, row : translation of the first [cells from the estimate].
    step : to the next block of translations [cells]; 0: there is only one.
    """

    parent: int
    height: int
    col: int
    row: int
    step: int


@borrowing_kernel
def place_candidate(
    points: FloatArray, frame: SearchFrame, theta: float, box: int, first: int, out_places: Places
) -> None:
    """Write the cells of the points at one rotation into `out_places`.

    The rounding of exactly these operations defines the candidates' cells; bounds allow for it.

    Parameters
    ----------
    points : float64, shape (n, 2), tracking frame [m].
    theta : rotation [rad].
    box : where the grid of single cells begins.
    first : index in `out_places` to write from.
    """
    if first < 0:  # the compiler then knows that no index counts from the end
        return
    cos, sin = math.cos(theta), math.sin(theta)
    x0, y0, origin_x, origin_y = frame.x, frame.y, frame.origin_x, frame.origin_y
    resolution = frame.resolution
    out_cols, out_rows, out_boxes = out_places.cols, out_places.rows, out_places.boxes
    flat = points.reshape(-1)  # vectorised only with a stride that is known
    for k in range(points.shape[0]):
        x = x0 + (cos * flat[2 * k] - sin * flat[2 * k + 1]) - origin_x
        y = y0 + (sin * flat[2 * k] + cos * flat[2 * k + 1]) - origin_y
        out_cols[first + k] = np.int32(np.floor(x / resolution + 0.5))
        out_rows[first + k] = np.int32(np.floor(y / resolution + 0.5))
        out_boxes[first + k] = box


@borrowing_kernel
def place_group(
    points: FloatArray,
    frame: SearchFrame,
    begin: float,
    end: float,
    boxes: CellArray,
    height: int,
    first: int,
    out_places: Places,
) -> None:
    """Write the boxes of cells that the points meet between two rotations into `out_places`.

    Parameters
    ----------
    points : float64, shape (n, 2), tracking frame [m].
    begin, end : first and last rotation of the group [rad], less than half a turn apart.
    boxes, height : int32, shape (num_heights, num_moves): by the number of cells that a point
        moves, where the grid of its box begins; and which row of that.
    first : index in `out_places` to write from.
    """
    if first < 0:  # the compiler then knows that no index counts from the end
        return
    out_cols, out_rows, out_boxes = out_places.cols, out_places.rows, out_places.boxes
    cos0, sin0, cos1, sin1 = math.cos(begin), math.sin(begin), math.cos(end), math.sin(end)
    # Between its ends an arc exceeds them by at most the sagitta, and only where it turns.
    sagitta = 1.0 - math.cos(0.5 * (end - begin))
    scale = 1.0 / frame.resolution
    x0 = (frame.x - frame.origin_x) * scale + 0.5
    y0 = (frame.y - frame.origin_y) * scale + 0.5
    flat = points.reshape(-1)  # vectorised only with a stride that is known
    for k in range(points.shape[0]):
        x, y = flat[2 * k] * scale, flat[2 * k + 1] * scale
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


@borrowing_kernel
def place_points(
    heights: Records, scan: PlacedScan, window: SearchWindow, height: int, group: int, first: int
) -> None:
    """Write where the points of a group of rotations look up their maxima into `scan.places`.

    Parameters
    ----------
    heights : of :data:`HEIGHT`, shape (num_heights,).
    height, group : which group of rotations.
    first : index in `scan.places` to write from.
    """
    points, frame, boxes, places = scan.points, scan.frame, scan.move_boxes, scan.places
    theta, step, size = frame.theta, frame.step, heights[height]["group"]
    half_rotations = window.half_rotations
    begin = group * size
    end = min(begin + size, 2 * half_rotations + 1) - 1
    begin_theta = theta + (begin - half_rotations) * step
    if height == 0:
        place_candidate(points, frame, begin_theta, boxes[0, 0], first, places)
    else:
        end_theta = theta + (end - half_rotations) * step
        place_group(points, frame, begin_theta, end_theta, boxes, height, first, places)


@borrowing_kernel
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
    if first < 0:  # the compiler then knows that no index counts from the end
        return
    low = np.int32(-margin)
    for k in range(out_index.size):
        x = min(max(np.int32((cols[first + k] + col) >> shift), low), last_col)
        y = min(max(np.int32((rows[first + k] + row) >> shift), low), last_row)
        out_index[k] = boxes[first + k] + y * row_length + x


@borrowing_kernel
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


@borrowing_kernel
def score_children(
    cells: ByteArray,
    heights: Records,
    cols: CellArray,
    rows: CellArray,
    boxes: CellArray,
    first: int,
    num_points: int,
    children: Children,
    min_sum: int,
    nodes: IntArray,
    indices: CellArray,
    out_sums: IntArray,
) -> bool:
    """Write the sums of up to four neighbouring nodes to `out_sums`; return whether to keep any.

    Parameters
    ----------
    cells : uint8, shape (n,), the precomputed grids.
    heights : of :data:`HEIGHT`, shape (num_heights,).
    cols, rows, boxes, first : of :class:`Places`; from `first` on what :func:`place_points` writes.
    children : the nodes.
    min_sum : nodes with a smaller sum are given up.
    nodes : int64, shape (m, REST + num_blocks + 1), with their parent.
    indices : int32, scratch, an entry for each point of a block.
    out_sums : int64, shape (num_blocks, 4): sums after each block of points.
    """
    height, parent = children.height, children.parent
    shift, row_length = heights[height]["shift"], heights[height]["row_length"]
    margin = heights[height]["margin"]
    last_col, last_row = heights[height]["last_col"], heights[height]["last_row"]
    right = children.step >> shift
    above = right * row_length
    a, b, c, d = np.int64(0), np.int64(0), np.int64(0), np.int64(0)
    for block in range(out_sums.shape[0]):
        begin = block * indices.size
        locate(
            cols, rows, boxes, first + begin, np.int32(children.col), np.int32(children.row),
            np.int32(shift), np.int32(margin), np.int32(last_col), np.int32(last_row),
            np.int32(row_length), indices,
        )  # fmt: skip
        da, db, dc, dd = sum_four(
            cells, indices, min(indices.size, num_points - begin), right, above
        )
        a, b, c, d = a + da, b + db, c + dc, d + dd
        out_sums[block, 0], out_sums[block, 1], out_sums[block, 2], out_sums[block, 3] = a, b, c, d
        if max(a, b, c, d) + nodes[parent, REST + block + 1] < min_sum:
            return False
    return True
