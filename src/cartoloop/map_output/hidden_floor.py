# SPDX-License-Identifier: Apache-2.0
"""Floor behind a wall of one map, which only another map of the same place knows."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cartoloop.arrays import BoolArray, FloatArray, IntArray
from cartoloop.map_output.wall_axes import FLOOR, MAYBE_WALL, WALL, directions_behind

BESIDE_M = 0.5
"""What a wall hides begins within this distance, and not behind another wall [m]."""

MIN_WALLS_BEHIND_M = 1.0
"""Less wall, as cells in a row, beside floor behind a wall: beams passed through a window [m]."""


class HiddenFloor(NamedTuple):
    """Floor of a map that another one does not know.

    Attributes
    ----------
    pieces : int64, shape of the maps, number of the piece that a cell is in; 0 is none.
    has_walls : of each piece, whether some length of wall was seen beside it.
    """

    pieces: IntArray
    has_walls: BoolArray


def hidden_floor(
    walls: NDArray[np.float32], seen: NDArray[np.float32], resolution: float, bridge: int
) -> HiddenFloor:
    """Return the floor of the map `seen` that the map `walls`, of the same cells, does not know.

    Parameters
    ----------
    walls, seen : probabilities, negative where nothing is known.
    resolution : edge of a cell [m].
    bridge : walls as near to a piece as this count as beside it [cells].
    """
    from scipy import ndimage  # heavy, and rarely used

    unknown = walls < 0.0
    pieces, count = ndimage.label((seen >= 0.0) & (seen < FLOOR) & unknown)
    reach = ndimage.grey_dilation(pieces, size=(2 * bridge + 1, 2 * bridge + 1))
    beside = np.bincount(reach[(seen > WALL) & unknown], minlength=count + 1) * resolution
    has_walls: BoolArray = beside >= MIN_WALLS_BEHIND_M
    has_walls[0] = False
    return HiddenFloor(pieces, has_walls)


def area_behind(
    piece: IntArray,
    places: IntArray,
    walls: NDArray[np.float32],
    seen: NDArray[np.float32],
    hidden: HiddenFloor,
    resolution: float,
) -> float:
    """Return the largest area of one piece of floor that a wall hides [m^2].

    It begins beside the wall, behind the line through it; what lies before that line, other things
    hide.

    Parameters
    ----------
    piece : int64, shape (n, 2), rows and columns of the wall, with what bridges its gaps.
    places : the same of the wall alone.
    walls, seen, hidden : as for :func:`hidden_floor`, and what it returned.
    resolution : edge of a cell [m].
    """
    near = _beside(piece, seen, max(1, round(BESIDE_M / resolution)))
    most = max(_num_behind(near, places, back, hidden) for back in directions_behind(walls, places))
    return most * resolution**2


def _beside(piece: IntArray, seen: NDArray[np.float32], reach: int) -> IntArray:
    """Return rows and columns of the cells within reach [cells] of a wall, and not behind others.

    What a map saw behind a wall of its own is not hidden by this one.
    """
    from scipy import ndimage

    first = np.maximum(piece.min(axis=0) - reach, 0)
    end = np.minimum(piece.max(axis=0) + reach + 1, seen.shape)
    is_wall = np.zeros(end - first, dtype=bool)
    is_wall[tuple((piece - first).T)] = True
    passable = ~(seen[first[0] : end[0], first[1] : end[1]] > MAYBE_WALL)
    near = ndimage.binary_dilation(is_wall, iterations=reach, mask=passable)
    cells: IntArray = np.argwhere(near) + first
    return cells


def _num_behind(near: IntArray, places: IntArray, back: FloatArray, hidden: HiddenFloor) -> int:
    """Return the number of cells behind a wall of the largest hidden piece that begins there.

    Parameters
    ----------
    near : int64, shape (k, 2), rows and columns of the cells beside the wall.
    places : int64, shape (n, 2), of the wall.
    back : shape (2,), direction to what is behind it.
    """
    line = float(np.median(places @ back))
    touched = np.unique(hidden.pieces[tuple(near[near @ back > line].T)])
    numbers = touched[hidden.has_walls[touched]].tolist()
    cells = (np.argwhere(hidden.pieces == number) for number in numbers)
    return max((int(np.count_nonzero(each @ back > line)) for each in cells), default=0)
