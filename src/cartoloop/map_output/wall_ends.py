# SPDX-License-Identifier: Apache-2.0
"""Where a wall ends: whether one sees past it, and whether it meets walls of another part."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cartoloop.arrays import BoolArray, FloatArray, IntArray
from cartoloop.map_output.wall_axes import FLOOR, WALL, axes_of, cells_at, directions_behind

BRIDGED_M = 0.15
"""Pieces of wall closer than this belong together [m]."""

_LANES = np.arange(4.0)
"""Lines along a wall on which one looks past its end, by their distance behind it [cells]."""

FREE_END_M = 0.3
"""Floor beyond the end of a wall, in line with it, by which it stands free there [m]."""

MAX_REST_M = 0.5
"""A wall that goes on further than this where nothing contradicts it does not end there [m]."""


def has_free_end(walls: NDArray[np.float32], places: IntArray, resolution: float) -> bool:
    """Return whether the map with a wall saw past an end of it: floor, in line with the wall.

    What ends a room or a corridor meets other walls at both ends, and furniture in a corner at one.

    Parameters
    ----------
    walls : probabilities of the map.
    places : int64, shape (n, 2), row and column of cells of the wall.
    resolution : edge of a cell [m].
    """
    for end in _ends(walls, places, resolution):
        # The cell between wall and floor may be either.
        beyond = end.lanes[:, end.last + 1 : end.last + round(FREE_END_M / resolution)]
        is_floor = (beyond >= 0.0) & (beyond < FLOOR)
        if end.is_near and (np.count_nonzero(~is_floor, axis=1) <= 1).any():
            return True
    return False


class _End(NamedTuple):
    """An end of a wall.

    Attributes
    ----------
    place : row and column, shape (2,).
    last : steps by which the wall goes on where nothing contradicts it [cells].
    is_near : whether it ends there, and does not go on further than is looked at.
    lanes : shape (len(_LANES), n), probabilities on lines behind the wall, n cells beyond where it
        is contradicted.
    """

    place: FloatArray
    last: int
    is_near: bool
    lanes: NDArray[np.float32]


def _ends(walls: NDArray[np.float32], places: IntArray, resolution: float) -> Iterator[_End]:
    """Yield both ends of a wall in its own map."""
    middle, axes = axes_of(places)
    across, along = ((places - middle) @ axes).T
    middle = middle + np.median(across) * axes[:, 0]
    back = directions_behind(walls, places)[0]
    num_free, most = round(FREE_END_M / resolution), round(MAX_REST_M / resolution)
    gap = max(1, round(BRIDGED_M / resolution))
    steps = np.arange(1, most + num_free + gap + 1)
    for end, ahead in ((along.max(), axes[:, 1]), (-along.min(), -axes[:, 1])):
        line = middle + (end + steps)[:, None] * ahead
        before, *lanes = [cells_at(walls, line + shift * back) for shift in (-1.0, *_LANES)]
        last = 0  # cell of the wall beyond the end
        for step in np.flatnonzero(np.max((before, *lanes[:2]), axis=0) > WALL).tolist():
            if step + 1 - last > gap:
                break
            last = step + 1
        yield _End(middle + (end + min(last, most)) * ahead, last, last <= most, np.array(lanes))


def meets_walls(
    walls: NDArray[np.float32], others: BoolArray, places: IntArray, reach: float, resolution: float
) -> bool:
    """Return whether both ends of a wall are near walls of the other part.

    Parameters
    ----------
    others : cells of the other part that may be walls.
    reach : the distance [cells].
    """
    return all(_is_near(others, end.place, reach) for end in _ends(walls, places, resolution))


def _is_near(cells: BoolArray, place: FloatArray, reach: float) -> bool:
    """Return whether one of the cells is within a distance of a place [cells]."""
    lower = np.maximum(np.floor(place - reach).astype(np.int64), 0)
    upper = np.maximum(np.ceil(place + reach).astype(np.int64) + 1, 0)
    near = np.argwhere(cells[lower[0] : upper[0], lower[1] : upper[1]]) + lower
    return bool(len(near)) and float(np.hypot(*(near - place).T).min()) <= reach
