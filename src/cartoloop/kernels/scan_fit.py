# SPDX-License-Identifier: Apache-2.0
"""Whether the beams of a scan agree with a map: where they end, and what they pass through."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from cartoloop._jit import kernel
from cartoloop.arrays import ByteArray, FloatArray, IntArray
from cartoloop.kernels.map_agreement import CellGrid, is_floor, is_wall_near
from cartoloop.kernels.scan_batch import ScanBatch

ON_WALL, ON_FLOOR, BEHIND_WALL, ON_STRAIGHT_WALL, ON_WALL_BEHIND = 0, 1, 2, 3, 4
"""Columns of the counts: returns that lie on a wall, on floor, and behind a wall; of the first,
those on a straight one; of those behind a wall, those that lie on another one."""


STRAIGHT, SEEN_THROUGH = 1, 2
"""Marks of walls, to be added: those that go on straight, and those that beams pass through."""


class FitLimits(NamedTuple):
    """What counts as a wall and as floor, and which part of a beam is looked at.

    Attributes
    ----------
    wall : least value of a cell that is a wall.
    floor : largest value of a cell that is floor; it was observed.
    on_wall : a return with a wall within this distance lies on it [cells].
    off_wall : a return on floor with no wall within this distance contradicts the map [cells].
    clearance : walls nearer than this to either end of a beam do not block it [cells].
    max_range : returns farther from the robot are not counted [m].
    """

    wall: int
    floor: int
    on_wall: int
    off_wall: int
    clearance: float
    max_range: float


@kernel
def count_fit(
    grid: CellGrid,
    marks: ByteArray,
    limits: FitLimits,
    scans: ScanBatch,
    beam_origins: FloatArray,
    poses: FloatArray,
    out_counts: IntArray,
) -> None:
    """Write how many returns of each scan lie on walls, on floor, and behind walls of a map.

    A return is behind a wall if its beam passes through one. A return lies on floor if its cell and
    the eight around it are, and no wall is near. What lies where the map is not known, or not
    clear, is not counted. A return on a wall is on a straight one if the nearest cell of a wall is;
    of equally near ones the first decides.

    Parameters
    ----------
    grid, limits : of the map.
    marks : uint8, shape of the grid, of walls. Those that are seen through block no beam.
    scans : k of them.
    beam_origins : float64, shape (k, 2), where their beams start, scan frame [m].
    poses : float64, shape (k, 3), of the scans in the grid's frame [m, m, rad].
    out_counts : int64, shape (k, 5): on walls, on floor, behind walls, on straight walls, on walls
        behind walls.

    Notes
    -----
    O(cells along the beams). A beam is looked up once for each cell of its length.
    """
    num_rows, num_cols = grid.cells.shape
    margin = max(limits.off_wall, 1)
    for i in range(poses.shape[0]):
        cos, sin = math.cos(poses[i, 2]), math.sin(poses[i, 2])
        start_x, start_y = beam_origins[i, 0], beam_origins[i, 1]
        start_col = (poses[i, 0] + cos * start_x - sin * start_y - grid.origin_x) / grid.resolution
        start_row = (poses[i, 1] + sin * start_x + cos * start_y - grid.origin_y) / grid.resolution
        on_wall, on_floor, behind, on_straight, on_wall_behind = 0, 0, 0, 0, 0
        for j in range(scans.firsts[i], scans.ends[i]):
            x, y = scans.points[j, 0], scans.points[j, 1]
            if x * x + y * y > limits.max_range**2:
                continue
            end_col = (poses[i, 0] + cos * x - sin * y - grid.origin_x) / grid.resolution
            end_row = (poses[i, 1] + sin * x + cos * y - grid.origin_y) / grid.resolution
            col, row = np.int64(np.floor(end_col + 0.5)), np.int64(np.floor(end_row + 0.5))
            is_inside = margin <= col < num_cols - margin and margin <= row < num_rows - margin
            is_on_wall = is_inside and is_wall_near(
                grid.cells, row, col, limits.on_wall, limits.wall
            )
            if _is_blocked(grid, marks, limits, start_col, start_row, end_col, end_row):
                behind += 1
                on_wall_behind += is_on_wall
                continue
            if not is_inside:
                continue
            if is_on_wall:
                on_wall += 1
                if _is_on_straight(grid.cells, marks, row, col, limits.on_wall, limits.wall):
                    on_straight += 1
            elif is_floor(grid.cells, row, col, limits.floor) and not is_wall_near(
                grid.cells, row, col, limits.off_wall, limits.wall
            ):
                on_floor += 1
        out_counts[i, 0] = on_wall
        out_counts[i, 1] = on_floor
        out_counts[i, 2] = behind
        out_counts[i, 3] = on_straight
        out_counts[i, 4] = on_wall_behind


@kernel
def _is_on_straight(
    cells: ByteArray, marks: ByteArray, row: np.int64, col: np.int64, reach: int, wall: int
) -> bool:
    """Return whether the nearest cell of a wall within a distance [cells] is of a straight one."""
    nearest, is_straight = reach * reach + 1, False
    for i in range(-reach, reach + 1):
        for j in range(-reach, reach + 1):
            square = i * i + j * j
            if square < nearest and cells[row + i, col + j] >= wall:
                nearest, is_straight = square, marks[row + i, col + j] & STRAIGHT != 0
    return is_straight


@kernel
def _is_blocked(
    grid: CellGrid,
    marks: ByteArray,
    limits: FitLimits,
    start_col: float,
    start_row: float,
    end_col: float,
    end_row: float,
) -> bool:
    """Return whether a beam passes through a wall, away from its ends; all in cells."""
    num_rows, num_cols = grid.cells.shape
    length = math.sqrt((end_col - start_col) ** 2 + (end_row - start_row) ** 2)
    for k in range(math.ceil(limits.clearance), math.floor(length - limits.clearance) + 1):
        share = k / length
        col = np.int64(np.floor(start_col + share * (end_col - start_col) + 0.5))
        row = np.int64(np.floor(start_row + share * (end_row - start_row) + 0.5))
        if (
            0 <= col < num_cols
            and 0 <= row < num_rows
            and grid.cells[row, col] >= limits.wall
            and marks[row, col] & SEEN_THROUGH == 0
        ):
            return True
    return False


@kernel
def count_passes(
    grid: CellGrid,
    limits: FitLimits,
    scans: ScanBatch,
    beam_origins: FloatArray,
    poses: FloatArray,
    out_passes: IntArray,
) -> None:
    """Add to each cell of a wall the number of beams that pass through it.

    Parameters
    ----------
    grid, limits, scans, beam_origins, poses : as for :func:`count_fit`.
    out_passes : int64, shape of the grid.

    Notes
    -----
    O(cells along the beams).
    """
    num_rows, num_cols = grid.cells.shape
    for i in range(poses.shape[0]):
        cos, sin = math.cos(poses[i, 2]), math.sin(poses[i, 2])
        start_x, start_y = beam_origins[i, 0], beam_origins[i, 1]
        start_col = (poses[i, 0] + cos * start_x - sin * start_y - grid.origin_x) / grid.resolution
        start_row = (poses[i, 1] + sin * start_x + cos * start_y - grid.origin_y) / grid.resolution
        for j in range(scans.firsts[i], scans.ends[i]):
            x, y = scans.points[j, 0], scans.points[j, 1]
            if x * x + y * y > limits.max_range**2:
                continue
            along_cols = (poses[i, 0] + cos * x - sin * y - grid.origin_x) / grid.resolution
            along_cols -= start_col
            along_rows = (poses[i, 1] + sin * x + cos * y - grid.origin_y) / grid.resolution
            along_rows -= start_row
            length = math.sqrt(along_cols * along_cols + along_rows * along_rows)
            last_row, last_col = np.int64(-1), np.int64(-1)
            first, end = math.ceil(limits.clearance), math.floor(length - limits.clearance) + 1
            for k in range(first, end):
                col = np.int64(np.floor(start_col + k / length * along_cols + 0.5))
                row = np.int64(np.floor(start_row + k / length * along_rows + 0.5))
                if not (0 <= col < num_cols and 0 <= row < num_rows):
                    continue
                if grid.cells[row, col] >= limits.wall and (row != last_row or col != last_col):
                    out_passes[row, col] += 1
                last_row, last_col = row, col
