# SPDX-License-Identifier: Apache-2.0
"""Algorithm 3 of the paper: depth-first branch and bound for (BBS), exact.

A tree node is (sum, column, row, rotation, height, is_group): it stands for the translations of
the box of 2^height x 2^height cells that begins at (column, row), eq. (11), for one rotation, or,
where it is a group, for a run of neighbouring rotations. Neighbouring rotations move no point by
more than some cells, eq. (7), so grids whose boxes have that much slack bound all of them at once.
Sums of cell values are whole numbers: no rounding, and the same in any order.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from cartoloop._jit import kernel

FloatArray = NDArray[np.float64]
CellArray = NDArray[np.int32]
IntArray = NDArray[np.int64]

_SUM, _COL, _ROW, _ROTATION, _HEIGHT, _IS_GROUP = 0, 1, 2, 3, 4, 5
_FIELDS = 6
_BLOCK = 32


@kernel
def rotated_cells(
    points: FloatArray,
    x: float,
    y: float,
    theta: float,
    origin_x: float,
    origin_y: float,
    resolution: float,
    offset: int,
    out_cells: CellArray,
) -> None:
    """Write the cells of the points at a pose, plus `offset`, into `out_cells`.

    Parameters
    ----------
    points : float64, shape (n, 2), scan frame [m].
    x, y, theta : pose in the grid's frame.
    origin_x, origin_y, resolution : centre of cell (0, 0) and pixel edge [m].
    out_cells : int32, shape (2, n): columns, rows.
    """
    c = math.cos(theta)
    s = math.sin(theta)
    for k in range(points.shape[0]):
        px = x + c * points[k, 0] - s * points[k, 1]
        py = y + s * points[k, 0] + c * points[k, 1]
        out_cells[0, k] = np.int32(np.floor((px - origin_x) / resolution + 0.5)) + offset
        out_cells[1, k] = np.int32(np.floor((py - origin_y) / resolution + 0.5)) + offset


@kernel
def bounded_sum(level: NDArray[np.uint8], cells: CellArray, col: int, row: int, floor: int) -> int:
    """Return the sum of a grid's values at the cells moved by (col, row); less than `floor` if below it.

    Parameters
    ----------
    level : uint8, shape (num_rows, num_cols), with a border of zeros: cells outside count as 0.
    cells : int32, shape (2, n).
    floor : sums below it are of no interest: the count may end early, with any value below it.
    """
    num_rows, num_cols = level.shape
    last_col = num_cols - 1
    last_row = num_rows - 1
    num_points = cells.shape[1]
    total = 0
    first = 0
    while first < num_points:
        end = min(first + _BLOCK, num_points)
        for k in range(first, end):
            c = min(max(cells[0, k] + col, 0), last_col)
            r = min(max(cells[1, k] + row, 0), last_row)
            total += level[r, c]
        if total + 255 * (num_points - end) < floor:
            return -1
        first = end
    return total


@kernel
def is_better(
    total: int, col: int, row: int, rotation: int, best: IntArray, centre_rotation: int
) -> bool:
    """Return whether a leaf beats the best one: by its sum, and among equals by being less of a change.

    `best` : int64, (sum, column, row, rotation). Of equal sums the one with less rotation wins,
    then the nearer one, then the one with the lower rotation, row and column.
    """
    if total != best[_SUM]:
        return total > best[_SUM]
    turn = abs(rotation - centre_rotation)
    best_turn = abs(best[_ROTATION] - centre_rotation)
    if turn != best_turn:
        return turn < best_turn
    distance = col * col + row * row
    best_distance = best[_COL] * best[_COL] + best[_ROW] * best[_ROW]
    if distance != best_distance:
        return distance < best_distance
    if rotation != best[_ROTATION]:
        return rotation < best[_ROTATION]
    if row != best[_ROW]:
        return row < best[_ROW]
    return col < best[_COL]


@kernel
def push_sorted(stack: IntArray, base: int, top: int, node: IntArray) -> int:
    """Insert a node above `base` so that the largest sum is on top; return the new top."""
    place = top
    while place > base and stack[place - 1, _SUM] > node[_SUM]:
        stack[place] = stack[place - 1]
        place -= 1
    stack[place] = node
    return top + 1


@kernel
def search(
    levels: NDArray[np.uint8],
    slack_levels: NDArray[np.uint8],
    padding: int,
    points: FloatArray,
    estimate: FloatArray,
    origin_x: float,
    origin_y: float,
    resolution: float,
    half_width: int,
    half_num_rotations: int,
    rotation_step: float,
    half_group: int,
    split_height: int,
    top_height: int,
    min_sum: int,
    excluded: IntArray,
    out_best: IntArray,
) -> int:
    """Write the best leaf of the search window into `out_best`; return how many tree nodes were scored.

    Parameters
    ----------
    levels, slack_levels, padding : as :func:`precomputation_grid.build_pyramid` writes them.
    points : float64, shape (n, 2), scan frame [m]; n > 0.
    estimate : float64, shape (3,), centre of the window, pose in the grid's frame.
    origin_x, origin_y, resolution : centre of the grid's first cell and pixel edge [m].
    half_width, half_num_rotations, rotation_step : w_x = w_y, w_theta of eq. (8), delta of eq. (7).
    half_group : a group is a rotation and so many to each side; within it no point moves by more
        than the slack of `slack_levels`.
    split_height : groups are split into single rotations at this height.
    top_height : h0 of eq. (13).
    min_sum : leaves with a smaller sum are not wanted.
    excluded : int64, shape (5,): column, row, rotation, and how many cells and rotations around
        them leaves are not wanted; a negative number of cells excludes nothing.
    out_best : int64, shape (4,): sum, column, row [cells from the estimate], rotation [0 is the
        first]; the sum is `min_sum` - 1 where there is none.
    """
    num_points = points.shape[0]
    num_rotations = 2 * half_num_rotations + 1
    cells = np.empty((num_rotations, 2, num_points), dtype=np.int32)
    is_rotated = np.zeros(num_rotations, dtype=np.bool_)
    grouped = top_height >= split_height and half_group > 0
    group_size = 2 * half_group + 1 if grouped else 1
    num_groups = (num_rotations + group_size - 1) // group_size
    top_step = 1 << top_height
    num_top = 2 * half_width // top_step + 1
    stack = np.empty(
        (num_groups * num_top * num_top + 4 * (top_height + 1) + group_size + 4, _FIELDS), np.int64
    )
    top = 0
    num_scored = 0
    node = np.empty(_FIELDS, dtype=np.int64)
    out_best[_SUM] = min_sum - 1
    out_best[1:] = -(1 << 30)
    initial = np.empty((num_groups * num_top * num_top, _FIELDS), dtype=np.int64)
    num_initial = 0
    for group in range(num_groups):
        rotation = min(group * group_size + group_size // 2, num_rotations - 1)
        rotated_cells(
            points, estimate[0], estimate[1], estimate[2] + (rotation - half_num_rotations) * rotation_step,
            origin_x, origin_y, resolution, padding, cells[rotation],
        )  # fmt: skip
        is_rotated[rotation] = True
        level = slack_levels[top_height] if grouped else levels[top_height]
        for i in range(num_top):
            for j in range(num_top):
                col = -half_width + j * top_step
                row = -half_width + i * top_step
                total = bounded_sum(level, cells[rotation], col, row, min_sum)
                num_scored += 1
                if total >= min_sum:
                    initial[num_initial, _SUM] = total
                    initial[num_initial, _COL] = col
                    initial[num_initial, _ROW] = row
                    initial[num_initial, _ROTATION] = rotation
                    initial[num_initial, _HEIGHT] = top_height
                    initial[num_initial, _IS_GROUP] = 1 if grouped else 0
                    num_initial += 1
    order = np.argsort(initial[:num_initial, _SUM], kind="mergesort")
    for k in range(num_initial):
        stack[top] = initial[order[k]]
        top += 1
    while top > 0:
        top -= 1
        total = stack[top, _SUM]
        col = stack[top, _COL]
        row = stack[top, _ROW]
        rotation = stack[top, _ROTATION]
        height = stack[top, _HEIGHT]
        is_group = stack[top, _IS_GROUP] == 1
        floor = max(out_best[_SUM], min_sum)
        if total < floor:
            continue
        if excluded[3] >= 0 and not is_group:
            size = 1 << height
            if (
                abs(rotation - excluded[2]) <= excluded[4]
                and col >= excluded[0] - excluded[3]
                and row >= excluded[1] - excluded[3]
                and col + size - 1 <= excluded[0] + excluded[3]
                and row + size - 1 <= excluded[1] + excluded[3]
            ):
                continue
        if height == 0 and not is_group:
            if is_better(total, col, row, rotation, out_best, half_num_rotations):
                out_best[_SUM] = total
                out_best[_COL] = col
                out_best[_ROW] = row
                out_best[_ROTATION] = rotation
            continue
        base = top
        if is_group and height == split_height:
            first = (rotation // group_size) * group_size
            last = min(first + group_size, num_rotations)
            for single in range(first, last):
                if not is_rotated[single]:
                    theta = estimate[2] + (single - half_num_rotations) * rotation_step
                    rotated_cells(
                        points, estimate[0], estimate[1], theta,
                        origin_x, origin_y, resolution, padding, cells[single],
                    )  # fmt: skip
                    is_rotated[single] = True
                bound = bounded_sum(levels[height], cells[single], col, row, floor)
                num_scored += 1
                if bound >= floor:
                    node[_SUM] = bound
                    node[_COL] = col
                    node[_ROW] = row
                    node[_ROTATION] = single
                    node[_HEIGHT] = height
                    node[_IS_GROUP] = 0
                    top = push_sorted(stack, base, top, node)
            continue
        half = 1 << (height - 1)
        level = slack_levels[height - 1] if is_group else levels[height - 1]
        for i in range(2):
            for j in range(2):
                child_col = col + j * half
                child_row = row + i * half
                if child_col > half_width or child_row > half_width:
                    continue
                bound = bounded_sum(level, cells[rotation], child_col, child_row, floor)
                num_scored += 1
                if bound >= floor:
                    node[_SUM] = bound
                    node[_COL] = child_col
                    node[_ROW] = child_row
                    node[_ROTATION] = rotation
                    node[_HEIGHT] = height - 1
                    node[_IS_GROUP] = 1 if is_group else 0
                    top = push_sorted(stack, base, top, node)
    return num_scored
