# SPDX-License-Identifier: Apache-2.0
"""What scans show of a map that has changed: walls passed through by beams, returns on floor."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cartoloop._jit import kernel
from cartoloop.arrays import ByteArray, FloatArray
from cartoloop.kernels.map_agreement import is_floor


class LookLimits(NamedTuple):
    """What counts as a wall and as floor, and how far a scan may be displaced.

    Attributes
    ----------
    wall : least value of a cell that is a wall.
    floor : largest value of a cell that is floor; it was observed.
    reach : tolerance where the pose is exact [cells].
    offset, slope : limits of the error of the pose: of its position [cells], and of its heading
        [rad]. A return at a distance d [cells] has a tolerance of reach + hypot(offset, slope * d).
    max_tolerance : beams whose ends have more tolerance are not used [cells].
    clearance : what lies less than the tolerance and this before the end of a beam is not passed
        through [cells].
    max_balance : the balance of a cell is clamped to this and its negative.
    """

    wall: int
    floor: int
    reach: float
    offset: float
    slope: float
    max_tolerance: float
    clearance: float
    max_balance: int


class LookGrids(NamedTuple):
    """What all looks came to, arrays of the shape of the map.

    Attributes
    ----------
    marks : int32, the last look that counted at a cell: 2 k where look k passed through, 2 k + 1
        where it had a return there or near it. Less than 2 before the first look, which is 1.
    shown : uint16, looks by which the cell has changed: beams pass through a wall, or a return lies
        on floor, in the cell or one of the eight around it.
    denied : uint16, looks by which it has not: a return at the wall, a beam through the floor.
    ends : uint16, returns in the cell itself, on floor.
    balance : int8, looks that show the change less those that deny it, clamped at each look.
    first, last : float64, when the change was first and last shown [s].
    """

    marks: NDArray[np.int32]
    shown: NDArray[np.uint16]
    denied: NDArray[np.uint16]
    ends: NDArray[np.uint16]
    balance: NDArray[np.int8]
    first: FloatArray
    last: FloatArray


MOST = 65535
"""Counts stop here."""


@kernel
def note_look(
    cells: ByteArray,
    limits: LookLimits,
    start_col: float,
    start_row: float,
    ends: FloatArray,
    look: int,
    time: float,
    out: LookGrids,
) -> None:
    """Note what one scan shows of each cell of a map; each cell counts once.

    Parameters
    ----------
    cells : uint8, shape (num_rows, num_cols), 0 where never observed.
    limits : of this scan.
    start_col, start_row : where its beams start [cells]; the centre of cell (0, 0) is 0, 0.
    ends : float64, shape (n, 2), its returns, column and row likewise.
    look : number of the scan, from 1 on, increasing.
    time : of the scan [s].
    out : changed in place.

    Notes
    -----
    First the returns, then the beams: a cell with a return in it or near it is not passed through.
    A wall is passed through where it extends to both sides of the beam, as far as the beam may be
    displaced: beams along a wall and beside a corner say nothing.
    """
    for j in range(ends.shape[0]):
        length = math.hypot(ends[j, 0] - start_col, ends[j, 1] - start_row)
        tolerance = _tolerance(limits, length)
        if tolerance <= limits.max_tolerance:
            _note_end(cells, limits, ends[j, 0], ends[j, 1], tolerance, look, time, out)
    for j in range(ends.shape[0]):
        across, up = ends[j, 0] - start_col, ends[j, 1] - start_row
        length = math.hypot(across, up)
        tolerance = _tolerance(limits, length)
        if 0.0 < length and tolerance <= limits.max_tolerance:
            passed = math.floor(length - tolerance - limits.clearance)
            _note_beam(
                cells, limits, start_col, start_row, across / length, up / length,
                passed, look, time, out,
            )  # fmt: skip


@kernel
def _tolerance(limits: LookLimits, distance: float) -> float:
    """Return by how much a point on a beam may be displaced [cells]."""
    return limits.reach + math.hypot(limits.offset, limits.slope * distance)


@kernel
def _note_end(
    cells: ByteArray,
    limits: LookLimits,
    end_col: float,
    end_row: float,
    tolerance: float,
    look: int,
    time: float,
    out: LookGrids,
) -> None:
    """Note a return: near walls it confirms them, and on floor something has appeared."""
    num_rows, num_cols = cells.shape
    col, row = int(np.floor(end_col + 0.5)), int(np.floor(end_row + 0.5))
    reach = int(np.ceil(tolerance))
    is_wall_near = False
    for i in range(max(row - reach, 0), min(row + reach + 1, num_rows)):
        for j in range(max(col - reach, 0), min(col + reach + 1, num_cols)):
            if cells[i, j] >= limits.wall and (i - row) ** 2 + (j - col) ** 2 <= reach * reach:
                is_wall_near = True
                if out.marks[i, j] != 2 * look + 1:
                    out.marks[i, j] = 2 * look + 1
                    _deny(limits, i, j, out)
    if is_wall_near or not (1 <= row < num_rows - 1 and 1 <= col < num_cols - 1):
        return
    if not is_floor(cells, np.int64(row), np.int64(col), limits.floor):
        return
    out.ends[row, col] = min(out.ends[row, col] + 1, MOST)
    for i in range(row - 1, row + 2):
        for j in range(col - 1, col + 2):
            if out.marks[i, j] != 2 * look + 1:
                out.marks[i, j] = 2 * look + 1
                _show(limits, i, j, time, out)


@kernel
def _note_beam(
    cells: ByteArray,
    limits: LookLimits,
    start_col: float,
    start_row: float,
    across: float,
    up: float,
    passed: int,
    look: int,
    time: float,
    out: LookGrids,
) -> None:
    """Note the walls and the floor that a beam passes through, in steps of a cell."""
    num_rows, num_cols = cells.shape
    for k in range(1, passed + 1):
        at_col, at_row = start_col + k * across, start_row + k * up
        col, row = int(np.floor(at_col + 0.5)), int(np.floor(at_row + 0.5))
        if not (0 <= col < num_cols and 0 <= row < num_rows):
            continue
        value = cells[row, col]
        if value == 0 or out.marks[row, col] >= 2 * look:
            continue
        if value >= limits.wall:
            aside = _tolerance(limits, k)
            if is_wall_at(cells, limits.wall, at_col - aside * up, at_row + aside * across) and (
                is_wall_at(cells, limits.wall, at_col + aside * up, at_row - aside * across)
            ):
                out.marks[row, col] = 2 * look
                _show(limits, row, col, time, out)
        elif value <= limits.floor:
            out.marks[row, col] = 2 * look
            _deny(limits, row, col, out)


@kernel
def is_wall_at(cells: ByteArray, wall: int, at_col: float, at_row: float) -> bool:
    """Return whether the cell at a place, or one of the eight around it, is a wall."""
    num_rows, num_cols = cells.shape
    col, row = int(np.floor(at_col + 0.5)), int(np.floor(at_row + 0.5))
    for i in range(max(row - 1, 0), min(row + 2, num_rows)):
        for j in range(max(col - 1, 0), min(col + 2, num_cols)):
            if cells[i, j] >= wall:
                return True
    return False


@kernel
def _show(limits: LookLimits, row: int, col: int, time: float, out: LookGrids) -> None:
    """Count a look that shows a change of a cell."""
    if out.shown[row, col] == 0:
        out.first[row, col] = time
    out.last[row, col] = time
    out.shown[row, col] = min(out.shown[row, col] + 1, MOST)
    out.balance[row, col] = min(out.balance[row, col] + 1, limits.max_balance)


@kernel
def _deny(limits: LookLimits, row: int, col: int, out: LookGrids) -> None:
    """Count a look that denies a change of a cell."""
    out.denied[row, col] = min(out.denied[row, col] + 1, MOST)
    out.balance[row, col] = max(out.balance[row, col] - 1, -limits.max_balance)
