# SPDX-License-Identifier: Apache-2.0
"""Whether returns lie where a submap has walls, and where they would fit better."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from cartoloop._jit import borrowing_kernel, kernel
from cartoloop.arrays import BoolArray, ByteArray, FloatArray, IntArray
from cartoloop.kernels.scan_batch import ScanBatch


class CellGrid(NamedTuple):
    """The cells of a finished submap and where they are.

    Attributes
    ----------
    cells : uint8, shape (num_rows, num_cols), 0 where never observed.
    origin_x, origin_y : centre of cell (0, 0) [m, submap frame].
    resolution : edge of a cell [m].
    """

    cells: ByteArray
    origin_x: float
    origin_y: float
    resolution: float


class AgreementLimits(NamedTuple):
    """What counts as a wall, and as floor.

    Attributes
    ----------
    wall : least value of a cell that is a wall.
    floor : largest value of a cell that is floor; it was observed.
    on_wall : a return with a wall within this distance lies on it [cells].
    off_wall : a return on floor with no wall within this distance contradicts the submap [cells].
    max_range : returns farther from the robot are not counted [m].
    """

    wall: int
    floor: int
    on_wall: int
    off_wall: int
    max_range: float


@kernel
def count_agreement(
    grid: CellGrid,
    limits: AgreementLimits,
    scans: ScanBatch,
    poses: FloatArray,
    out_counts: IntArray,
) -> None:
    """Write how many returns of each scan lie on walls of a submap, and how many on its floor.

    A return lies on floor if its cell and the eight around it are, and no wall is near. The others
    lie where the submap was not observed, or not clearly: they are not counted.

    Parameters
    ----------
    grid, limits : of the submap.
    scans : k of them.
    poses : float64, shape (k, 3), tf_submap_scan [m, m, rad].
    out_counts : int64, shape (k, 2): on walls, on floor.
    """
    cells, resolution = grid.cells, grid.resolution
    num_rows, num_cols = cells.shape
    margin = max(limits.off_wall, 1)
    for i in range(poses.shape[0]):
        cos, sin = math.cos(poses[i, 2]), math.sin(poses[i, 2])
        on_wall, on_floor = 0, 0
        for j in range(scans.firsts[i], scans.ends[i]):
            x, y = scans.points[j, 0], scans.points[j, 1]
            if x * x + y * y > limits.max_range**2:
                continue
            x_submap = poses[i, 0] + cos * x - sin * y
            y_submap = poses[i, 1] + sin * x + cos * y
            col = np.int64(np.floor((x_submap - grid.origin_x) / resolution + 0.5))
            row = np.int64(np.floor((y_submap - grid.origin_y) / resolution + 0.5))
            if not (margin <= col < num_cols - margin and margin <= row < num_rows - margin):
                continue
            if is_wall_near(cells, row, col, limits.on_wall, limits.wall):
                on_wall += 1
            # The floor first: it is soon known that a return is not on it.
            elif is_floor(cells, row, col, limits.floor) and not is_wall_near(
                cells, row, col, limits.off_wall, limits.wall
            ):
                on_floor += 1
        out_counts[i, 0] = on_wall
        out_counts[i, 1] = on_floor


@borrowing_kernel
def is_wall_near(cells: ByteArray, row: np.int64, col: np.int64, reach: int, wall: int) -> bool:
    """Return whether there is a wall within a distance [cells]."""
    if cells[row, col] >= wall:
        return True
    for i in range(-reach, reach + 1):
        for j in range(-reach, reach + 1):
            if cells[row + i, col + j] >= wall and i * i + j * j <= reach * reach:
                return True
    return False


@borrowing_kernel
def is_floor(cells: ByteArray, row: np.int64, col: np.int64, floor: int) -> bool:
    """Return whether a cell and those around it were observed to be free."""
    for i in range(-1, 2):
        for j in range(-1, 2):
            value = cells[row + i, col + j]
            if value == 0 or value > floor:
                return False
    return True


class ShiftWindow(NamedTuple):
    """Which displacements are tried.

    Attributes
    ----------
    steps : to each side of the pose, in x and in y.
    step_cells : length of a step [cells].
    turns : to each side, about the centre of the points.
    turn : angle of a turn [rad].
    near_steps : displacements up to this number of steps are near, those of at least one more
        are elsewhere.
    """

    steps: int
    step_cells: int
    turns: int
    turn: float
    near_steps: int


@kernel
def best_shifts(
    grid: CellGrid,
    wall: int,
    window: ShiftWindow,
    points: FloatArray,
    firsts: IntArray,
    ends: IntArray,
    out_shifts: FloatArray,
) -> None:
    """Write how well groups of points fit where they are, and how well at the best other place.

    Parameters
    ----------
    grid, wall : a point fits if one of the two by two cells at it is at least `wall`.
    window : the displacements.
    points : float64, shape (n, 2) [m, submap frame].
    firsts, ends : int64, shape (k,): group i has ``points[firsts[i] : ends[i]]``, at least one.
    out_shifts : float64, shape (k, 5): number of points that fit near, and elsewhere; displacement
        x, y [m] and turn [rad] elsewhere. Of equal ones the first wins.
    """
    at_wall = _mark_walls(grid.cells, wall)
    for i in range(firsts.shape[0]):
        group = points[firsts[i] : ends[i]]
        centre_x, centre_y = _centre(group)
        for k in range(out_shifts.shape[1]):
            out_shifts[i, k] = 0.0
        rows = np.empty(group.shape[0], dtype=np.int64)
        cols = np.empty(group.shape[0], dtype=np.int64)
        for turn in range(-window.turns, window.turns + 1):
            angle = turn * window.turn
            cos, sin = math.cos(angle), math.sin(angle)
            for j in range(group.shape[0]):
                x, y = group[j, 0] - centre_x, group[j, 1] - centre_y
                turned_x = centre_x + cos * x - sin * y
                turned_y = centre_y + sin * x + cos * y
                cols[j] = np.int64(np.floor((turned_x - grid.origin_x) / grid.resolution))
                rows[j] = np.int64(np.floor((turned_y - grid.origin_y) / grid.resolution))
            _try_shifts(at_wall, grid.resolution, window, rows, cols, angle, out_shifts[i])


@kernel
def count_along(
    grid: CellGrid,
    wall: int,
    points: FloatArray,
    firsts: IntArray,
    ends: IntArray,
    directions: FloatArray,
    shifts: FloatArray,
    out_counts: IntArray,
) -> None:
    """Write how many points of each group fit when they are shifted along a direction.

    Parameters
    ----------
    grid, wall, points, firsts, ends : see :func:`best_shifts`.
    directions : float64, shape (k, 2), unit vector of each group, submap frame.
    shifts : float64, shape (s,) [m].
    out_counts : int64, shape (k, s).
    """
    at_wall = _mark_walls(grid.cells, wall)
    for i in range(firsts.shape[0]):
        group = points[firsts[i] : ends[i]]
        flat = group.reshape(-1)  # vectorised only with a stride that is known
        rows = np.empty(group.shape[0], dtype=np.int64)
        cols = np.empty(group.shape[0], dtype=np.int64)
        for s in range(shifts.shape[0]):
            x = shifts[s] * directions[i, 0] - grid.origin_x
            y = shifts[s] * directions[i, 1] - grid.origin_y
            for j in range(group.shape[0]):
                cols[j] = np.int64(np.floor((flat[2 * j] + x) / grid.resolution))
                rows[j] = np.int64(np.floor((flat[2 * j + 1] + y) / grid.resolution))
            out_counts[i, s] = _num_fitting(at_wall, rows, cols, 0, 0, -1.0)


@borrowing_kernel
def _centre(points: FloatArray) -> tuple[float, float]:
    """Return the mean of points."""
    # By hand: the mean of NumPy makes a kernel slow to load from the cache.
    x, y = 0.0, 0.0
    for j in range(points.shape[0]):
        x += points[j, 0]
        y += points[j, 1]
    return x / points.shape[0], y / points.shape[0]


@borrowing_kernel
def _try_shifts(
    at_wall: BoolArray,
    resolution: float,
    window: ShiftWindow,
    rows: IntArray,
    cols: IntArray,
    angle: float,
    out_shift: FloatArray,
) -> None:
    """Count the points that fit at all shifts of one turn, and keep the best in `out_shift`."""
    near, elsewhere = window.near_steps**2, (window.near_steps + 1) ** 2
    for down in range(-window.steps, window.steps + 1):
        for right in range(-window.steps, window.steps + 1):
            squared = down * down + right * right
            if near < squared < elsewhere:
                continue
            best = out_shift[0] if squared <= near else out_shift[1]
            fitting = _num_fitting(
                at_wall,
                rows,
                cols,
                down * window.step_cells,
                right * window.step_cells,
                best,
            )
            if squared <= near:
                out_shift[0] = max(best, fitting)
            elif fitting > best:
                step = window.step_cells * resolution
                out_shift[1] = fitting
                out_shift[2] = right * step
                out_shift[3] = down * step
                out_shift[4] = angle


@kernel
def _mark_walls(cells: ByteArray, wall: int) -> BoolArray:
    """Return where one of two by two cells is at least `wall`, by the lower left one of them."""
    num_rows, num_cols = max(cells.shape[0] - 1, 0), max(cells.shape[1] - 1, 0)
    at_wall = np.empty((num_rows, num_cols), dtype=np.bool_)
    for row in range(num_rows):
        lower, upper, out = cells[row], cells[row + 1], at_wall[row]
        for col in range(num_cols):
            highest = max(lower[col], lower[col + 1], upper[col], upper[col + 1])
            out[col] = highest >= wall
    return at_wall


@borrowing_kernel
def _num_fitting(
    at_wall: BoolArray,
    rows: IntArray,
    cols: IntArray,
    down: int,
    right: int,
    best: float,
) -> int:
    """Return how many points, given by the lower left of their four cells, are at a wall.

    Parameters
    ----------
    at_wall : as :func:`_mark_walls` returns it.
    best : it ends early, with less, where it cannot become more than this; -1: it does not.
    """
    num_rows, num_cols = at_wall.shape
    count, fitting = rows.shape[0], 0
    for j in range(count):
        if fitting + count - j <= best:
            break
        row, col = rows[j] + down, cols[j] + right
        if 0 <= row < num_rows and 0 <= col < num_cols and at_wall[row, col]:
            fitting += 1
    return fitting
