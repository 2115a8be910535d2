# SPDX-License-Identifier: Apache-2.0
"""Old submaps against what was seen later: what contradicts it fades, the rest is handed over."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cartoloop._jit import borrowing_kernel, kernel
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
    sure_free: float,
    sure_wall: float,
    out_faded: ByteArray,
    out_left: ByteArray,
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
    sure_free, sure_wall : log-odds up to which, and from which, the map needs no more evidence.
    out_faded : uint8, as cells: 0 for walls where the map is free, and for free cells where there
        is a wall; others are copied.
    out_left : uint8, as cells: those whose evidence the map needs are copied, 0 for others.

    Returns
    -------
    number of observed cells, and how many of them the map knows.

    Notes
    -----
    The map needs no evidence of cells that it is sure about, and of their neighbours: it is never
    sure beside walls. O(cells).
    """
    num_rows, num_cols = cells.shape
    observed = 0
    covered = 0
    for row in range(num_rows):
        for col in range(num_cols):
            value = cells[row, col]
            out_faded[row, col] = value
            out_left[row, col] = 0
            if value == 0:
                continue
            observed += 1
            map_col = int(np.floor(affine[0] + affine[1] * col + affine[2] * row))
            map_row = int(np.floor(affine[3] + affine[4] * col + affine[5] * row))
            inside = 0 <= map_row < known.shape[0] and 0 <= map_col < known.shape[1]
            if not inside or not known[map_row, map_col]:
                out_left[row, col] = value
                continue
            covered += 1
            if not _is_sure_near(total, map_row, map_col, sure_free, sure_wall):
                out_left[row, col] = value
            log_odds = total[map_row, map_col]
            if (value > NEUTRAL and log_odds <= free_below) or (
                value < NEUTRAL and log_odds >= wall_above
            ):
                out_faded[row, col] = 0
                out_left[row, col] = 0
    return observed, covered


@kernel
def review_walls(
    cells: ByteArray,
    affine: FloatArray,
    total: NDArray[np.float32],
    few_below: float,
    reach: int,
    behind_few: int,
    behind_many: int,
    out_faded: ByteArray,
    out_left: ByteArray,
) -> None:
    """Decide again about the walls of a submap where later sessions saw floor, in place.

    A wall that faded stays where the map neither holds a wall within `reach` nor floor on both
    sides of it. One that stays fades where the map holds no wall within `reach`, but floor on both
    sides, and where the evidence of the walls of the submap within `reach`, all taken together, is
    that of a few beams.

    Parameters
    ----------
    cells, affine, total : as of :func:`fade_submap`.
    few_below : sum of log-odds of a few beams.
    reach : in columns and rows [cells].
    behind_few, behind_many : how far on both sides there must be floor, for a wall that stayed and
        for one that faded, up to `reach` [cells].
    out_faded, out_left : as of :func:`fade_submap`, which has filled them.

    Notes
    -----
    O(cells + walls * reach^2).
    """
    num_rows, num_cols = cells.shape
    for row in range(num_rows):
        for col in range(num_cols):
            if cells[row, col] <= NEUTRAL:
                continue
            map_col = int(np.floor(affine[0] + affine[1] * col + affine[2] * row))
            map_row = int(np.floor(affine[3] + affine[4] * col + affine[5] * row))
            if not (0 <= map_row < total.shape[0] and 0 <= map_col < total.shape[1]):
                continue
            if total[map_row, map_col] >= 0.0 or _holds(total, map_row, map_col, reach, 1.0):
                continue
            if out_faded[row, col] == 0:
                if not _floor_beside(cells, affine, total, row, col, reach, behind_many):
                    out_faded[row, col] = cells[row, col]
                    out_left[row, col] = cells[row, col]
            elif _evidence_near(
                cells, affine, total, row, col, reach
            ) <= few_below and _floor_beside(cells, affine, total, row, col, reach, behind_few):
                out_faded[row, col] = 0
                out_left[row, col] = 0


@borrowing_kernel
def _holds(total: NDArray[np.float32], row: int, col: int, reach: int, sign: float) -> bool:
    """Return whether a map holds walls (sign 1) or floor (-1) within `reach` cells of a cell."""
    for near_row in range(max(row - reach, 0), min(row + reach + 1, total.shape[0])):
        for near_col in range(max(col - reach, 0), min(col + reach + 1, total.shape[1])):
            if sign * total[near_row, near_col] > 0.0:
                return True
    return False


@borrowing_kernel
def _evidence_near(
    cells: ByteArray,
    affine: FloatArray,
    total: NDArray[np.float32],
    row: int,
    col: int,
    reach: int,
) -> float:
    """Return the sum of a map's log-odds at the walls of a submap within `reach` of a cell."""
    evidence = 0.0
    for near_row in range(max(row - reach, 0), min(row + reach + 1, cells.shape[0])):
        for near_col in range(max(col - reach, 0), min(col + reach + 1, cells.shape[1])):
            if cells[near_row, near_col] <= NEUTRAL:
                continue
            map_col = int(np.floor(affine[0] + affine[1] * near_col + affine[2] * near_row))
            map_row = int(np.floor(affine[3] + affine[4] * near_col + affine[5] * near_row))
            if 0 <= map_row < total.shape[0] and 0 <= map_col < total.shape[1]:
                evidence += total[map_row, map_col]
    return evidence


@borrowing_kernel
def _floor_beside(
    cells: ByteArray,
    affine: FloatArray,
    total: NDArray[np.float32],
    row: int,
    col: int,
    reach: int,
    behind: int,
) -> bool:
    """Return whether a map holds floor `behind` cells off a wall on both sides, up to `reach`.

    The line of the wall is that of the wall cells of the submap within ``2 * reach``.
    """
    count = 0
    sum_x, sum_y, sum_xx, sum_yy, sum_xy = 0.0, 0.0, 0.0, 0.0, 0.0
    for y in range(max(-2 * reach, -row), min(2 * reach + 1, cells.shape[0] - row)):
        for x in range(max(-2 * reach, -col), min(2 * reach + 1, cells.shape[1] - col)):
            if cells[row + y, col + x] > NEUTRAL:
                count += 1
                sum_x += x
                sum_y += y
                sum_xx += x * x
                sum_yy += y * y
                sum_xy += x * y
    # The direction of the largest variance is half the angle of (difference, twice).
    difference = count * (sum_xx - sum_yy) - (sum_x * sum_x - sum_y * sum_y)
    twice = 2.0 * (count * sum_xy - sum_x * sum_y)
    length = np.sqrt(difference * difference + twice * twice)
    cos_twice = difference / length if length > 0.0 else 1.0
    cos, sin = np.sqrt(0.5 * (1.0 + cos_twice)), np.sqrt(0.5 * (1.0 - cos_twice))
    if twice < 0.0:
        sin = -sin
    for side in (-behind, behind):
        at_col, at_row = col - side * sin, row + side * cos
        map_col = int(np.floor(affine[0] + affine[1] * at_col + affine[2] * at_row))
        map_row = int(np.floor(affine[3] + affine[4] * at_col + affine[5] * at_row))
        if not _holds(total, map_row, map_col, reach, -1.0):
            return False
    return True


@borrowing_kernel
def _is_sure_near(
    total: NDArray[np.float32], row: int, col: int, sure_free: float, sure_wall: float
) -> bool:
    """Return whether a map is sure about a cell or one of its eight neighbours."""
    for near_row in range(max(row - 1, 0), min(row + 2, total.shape[0])):
        for near_col in range(max(col - 1, 0), min(col + 2, total.shape[1])):
            log_odds = total[near_row, near_col]
            if log_odds <= sure_free or log_odds >= sure_wall:
                return True
    return False


@kernel
def hand_over(
    affine: FloatArray,
    source: ByteArray,
    sums: ByteArray,
    out_cells: ByteArray,
    out_taken: ByteArray,
) -> int:
    """Add the evidence in the cells of a submap to that in the cells of another, in place.

    Parameters
    ----------
    affine : float64, shape (6,), as of :func:`fade_submap`, from cells of the target to cells of
        the source.
    source : uint8, shape (rows, cols), 0 where there is nothing to add.
    sums : uint8, shape (256, 256), value of a cell with the evidence of two values.
    out_cells : uint8, the cells of the target.
    out_taken : uint8, same shape: the values that were added, 0 where none was.

    Returns
    -------
    number of cells of the target to which evidence was added.

    Notes
    -----
    O(cells of the target).
    """
    num_taken = 0
    for row in range(out_cells.shape[0]):
        for col in range(out_cells.shape[1]):
            out_taken[row, col] = 0
            from_col = int(np.floor(affine[0] + affine[1] * col + affine[2] * row))
            from_row = int(np.floor(affine[3] + affine[4] * col + affine[5] * row))
            if not (0 <= from_row < source.shape[0] and 0 <= from_col < source.shape[1]):
                continue
            value = source[from_row, from_col]
            if value != 0:
                out_cells[row, col] = sums[out_cells[row, col], value]
                out_taken[row, col] = value
                num_taken += 1
    return num_taken


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
