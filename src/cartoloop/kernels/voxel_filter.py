# SPDX-License-Identifier: Apache-2.0
"""Voxel filters: one point in each cell of a grid, so that near walls do not outweigh far ones."""

from __future__ import annotations

import numpy as np

from cartoloop._jit import borrowing_kernel, inlined_kernel, kernel
from cartoloop.arrays import FloatArray, IntArray


@kernel
def voxel_filter(points: FloatArray, num_points: int, edge: float, out_points: FloatArray) -> int:
    """Write the middle point of each occupied cell into `out_points`, in order; return how many.

    Of an even number it is the one before or the one after the middle, in one cell after the other.

    Parameters
    ----------
    points : float64, shape (>= num_points, 2) [m].
    edge : the cells' edge [m].
    out_points : float64, shape (>= num_points, 2) [m]; may be `points` itself.

    Notes
    -----
    An open-addressing hash table of cell keys; O(n). The first point of a cell, in the order of the
    beams, would be one that noise puts there: too far where the ranges grow from beam to beam, too
    near where they decrease. All walls would seem to be turned, and the robot to turn from scan
    to scan.
    """
    cells, table = np.empty(num_points, dtype=np.int64), _empty_table(num_points)
    number_cells(points, edge, cells)
    before_kept = np.zeros(table.size, dtype=np.int64)
    for k in range(num_points):
        slot = _slot(cells[k], table)
        table[slot] = cells[k]
        before_kept[slot] += 1
        cells[k] = slot
    for slot in range(table.size):
        is_odd = ((table[slot] >> 31) + table[slot]) & 1
        before_kept[slot] = (before_kept[slot] - 1 + is_odd) >> 1
    kept = 0
    for k in range(num_points):
        if before_kept[cells[k]] == 0:
            out_points[kept, 0] = points[k, 0]
            out_points[kept, 1] = points[k, 1]
            kept += 1
        before_kept[cells[k]] -= 1
    return kept


@kernel
def _fills_cells(points: FloatArray, edge: float, needed: int, cells: IntArray) -> bool:
    """Return whether the points lie in at least `needed` cells, as soon as that is certain.

    Parameters
    ----------
    points, edge : as for :func:`voxel_filter`.
    needed : number of cells, positive.
    cells : int64, shape (num_points,), scratch.
    """
    num_points = cells.size
    table = _empty_table(num_points)
    number_cells(points, edge, cells)
    filled = 0
    for k in range(num_points):
        if filled + num_points - k < needed:
            return False
        if _is_first(cells[k], table):
            filled += 1
            if filled == needed:
                return True
    return False


@inlined_kernel
def _empty_table(num_points: int) -> IntArray:
    """Return a hash table for the cells of a number of points; -1 is an empty slot."""
    size = 16
    while size < 2 * num_points:
        size *= 2
    return np.full(size, np.int64(-1), dtype=np.int64)


@borrowing_kernel
def number_cells(points: FloatArray, edge: float, out_cells: IntArray) -> None:
    """Write the numbers of the cells of the first points into `out_cells`.

    Parameters
    ----------
    points : float64, shape (n, 2) [m].
    edge : the cells' edge [m].
    out_cells : int64, shape (k,), k <= n, not negative.
    """
    flat = points.reshape(-1)  # vectorised only with a stride that is known
    for k in range(out_cells.size):
        cell_x = np.int64(np.floor(flat[2 * k] / edge)) + 1073741824
        cell_y = np.int64(np.floor(flat[2 * k + 1] / edge)) + 1073741824
        out_cells[k] = (cell_x << 31) | cell_y


@inlined_kernel
def _slot(cell: int, table: IntArray) -> int:
    """Return the slot of a cell in the table, or the empty one that it is to be entered in."""
    last = table.size - 1
    slot = (((cell >> 31) * 73856093) ^ ((cell & 0x7FFFFFFF) * 19349663)) & last
    while table[slot] != -1 and table[slot] != cell:
        slot = (slot + 1) & last
    return slot


@inlined_kernel
def _is_first(cell: int, table: IntArray) -> bool:
    """Return whether a cell is not in the table, and enter it."""
    slot = _slot(cell, table)
    is_first: bool = table[slot] == -1
    table[slot] = cell
    return is_first


@kernel
def copy_points(points: FloatArray, num_points: int, out_points: FloatArray) -> int:
    """Write the first of the points, float64, shape (n, 2), into `out_points`; return how many.

    A loop instead of a slice assignment: the error path of Numba for different shapes doubles the
    compile time.
    """
    for k in range(num_points):
        out_points[k, 0] = points[k, 0]
        out_points[k, 1] = points[k, 1]
    return num_points


@kernel
def adaptive_voxel_filter(
    points: FloatArray,
    max_length: float,
    min_num_points: int,
    max_range: float,
    out_points: FloatArray,
) -> int:
    """Write the points kept by the coarsest filter that keeps enough; return how many.

    Parameters
    ----------
    points : float64, shape (n, 2) [m], tracking frame.
    max_length : edge of the largest cells [m].
    min_num_points : number of points that must remain, if there are as many; positive.
    max_range : points further from the frame's origin are dropped [m].
    out_points : float64, shape (>= n, 2) [m].

    Notes
    -----
    Halves the edge until enough points remain, then bisects between the last two edges, as
    Cartographer does, to within a tenth of the edge. All points remain where even a
    hundredth of `max_length` keeps too few.
    """
    near = np.empty_like(points)
    num_near = 0
    cells = np.empty(points.shape[0], dtype=np.int64)
    for k in range(points.shape[0]):
        if points[k, 0] ** 2 + points[k, 1] ** 2 <= max_range * max_range:
            near[num_near, 0] = points[k, 0]
            near[num_near, 1] = points[k, 1]
            num_near += 1
    if num_near <= min_num_points:
        return copy_points(near, num_near, out_points)
    cells = cells[:num_near]
    low = high = max_length
    is_enough = _fills_cells(near, low, min_num_points, cells)
    while not is_enough and low > 1e-2 * max_length:
        high = low
        low = 0.5 * low
        is_enough = _fills_cells(near, low, min_num_points, cells)
    if not is_enough:
        return copy_points(near, num_near, out_points)
    while high - low > 0.1 * low:
        middle = 0.5 * (low + high)
        if _fills_cells(near, middle, min_num_points, cells):
            low = middle
        else:
            high = middle
    return voxel_filter(near, num_near, low, out_points)
