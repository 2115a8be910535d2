# SPDX-License-Identifier: Apache-2.0
"""Floor behind a wall of one map, which only another map of the same place knows."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cartoloop.arrays import BoolArray, FloatArray, IntArray
from cartoloop.map_output.wall_axes import MAYBE_WALL, WALL

BESIDE_M = 0.5
"""What a wall hides begins within this distance, and not behind another wall [m]."""

MIN_WALLS_BEHIND_M = 1.0
"""Less wall, as cells in a row, beside floor behind a wall: beams passed through a window [m]."""


class HiddenFloor(NamedTuple):
    """Floor of the one map that the other does not know.

    Attributes
    ----------
    pieces : int64, shape of the maps, number of the piece that a cell is in; 0 is none.
    areas : of each piece [m^2]; 0 where hardly any wall was seen beside it.
    """

    pieces: IntArray
    areas: FloatArray


def hidden_floor(
    walls: NDArray[np.float32],
    seen: NDArray[np.float32],
    floor: BoolArray,
    resolution: float,
    bridge: int,
) -> HiddenFloor:
    """Return the pieces of floor that the first map does not know."""
    from scipy import ndimage

    unknown = walls < 0.0
    pieces, count = ndimage.label(floor & unknown)
    areas = np.bincount(pieces.ravel(), minlength=count + 1).astype(np.float64) * resolution**2
    reach = ndimage.grey_dilation(pieces, size=(2 * bridge + 1, 2 * bridge + 1))
    beside = np.bincount(reach[(seen > WALL) & unknown], minlength=count + 1) * resolution
    areas[beside < MIN_WALLS_BEHIND_M] = 0.0
    return HiddenFloor(pieces, areas)


def area_behind(
    piece: IntArray,
    back: FloatArray,
    seen: NDArray[np.float32],
    hidden: HiddenFloor,
    resolution: float,
) -> float:
    """Return the largest area of one piece of floor that a wall hides [m^2].

    Parameters
    ----------
    piece : int64, shape (n, 2), rows and columns of the wall, with what bridges its gaps.
    back : shape (2,), direction to what is behind it.
    seen : probabilities of the map that knows what is hidden.
    """
    from scipy import ndimage

    reach = max(1, round(BESIDE_M / resolution))
    first = np.maximum(piece.min(axis=0) - reach, 0)
    end = np.minimum(piece.max(axis=0) + reach + 1, seen.shape)
    around = (slice(first[0], end[0]), slice(first[1], end[1]))
    is_wall = np.zeros(end - first, dtype=bool)
    is_wall[tuple((piece - first).T)] = True
    # What the other part saw behind a wall of its own is not hidden by this one.
    passable = ~(seen[around] > MAYBE_WALL)
    near = ndimage.binary_dilation(is_wall, iterations=reach, mask=passable)
    touched = np.unique(hidden.pieces[around][near])
    largest = 0.0
    for number in touched[(touched > 0) & (hidden.areas[touched] > 0.0)].tolist():
        # What lies before the wall, other things hide.
        is_behind = (np.argwhere(hidden.pieces == number) - piece.mean(axis=0)) @ back > 0.0
        largest = max(largest, int(np.count_nonzero(is_behind)) * resolution**2)
    return largest
