# SPDX-License-Identifier: Apache-2.0
"""Walls of one part of a map through which another part saw: what forbids that they are joined.

Furniture that was moved and doors that were opened leave walls where another session sees floor.
They are short, or what they hide is small for their length, or one sees past an end of them, or an
end meets no wall that was there before. Beams that pass through a window return from nowhere: no
walls are seen behind it. The end of a corridor that leads on for metres in another session is none
of these: the two sessions are of different places that look alike.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cartoloop.arrays import BoolArray, FloatArray, IntArray
from cartoloop.config import SubmapConfig
from cartoloop.map_output.hidden_floor import HiddenFloor, area_behind, hidden_floor
from cartoloop.map_output.occupancy_map import CellBox, compose_map
from cartoloop.map_output.wall_axes import FLOOR, MAYBE_WALL, WALL, axes_of
from cartoloop.map_output.wall_ends import BRIDGED_M, has_free_end, meets_walls
from cartoloop.sensor.pose import Pose, transform_points
from cartoloop.submaps.finished_grid import FinishedGrid

NEAR_WALL_M = 0.3
"""A wall with none of the other part within this distance contradicts it, on its floor [m]."""

BEND_SHARE, MAX_BEND_M = 0.01, 0.3
"""Farther than that, it may be the same wall, displaced: by the first share of the distance to
where the parts hold together, at most by the second number [m]. Local SLAM drifts as much."""

MIN_DISPLACED_SHARE = 0.5
"""It is the same wall if this share of its length lies beside a wall of the other part, in one line
with an accuracy of a cell."""

PARALLEL, OBLIQUE = (-0.1, 0.0, 0.1), (-0.5, -0.4, -0.3, -0.2, 0.2, 0.3, 0.4, 0.5)
"""Slopes of this line to the wall, and those with which an oblique wall lies beside more of it."""

STRAIGHT_CELLS = 1.5
"""Cells of a wall lie as close as this to its axis."""

FURNITURE_M = 2.0
"""A shorter wall that stands free at an end may be a piece of furniture [m]."""

SHELVES_M = 3.5
"""A shorter wall with an end that meets no wall of the other part may be a row of cupboards, moved,
and seen through a door [m]."""

THROUGH_M = 0.15
"""A robot whose path comes as close to a wall drove through it [m]."""

HIDDEN_DEPTH_M, HIDDEN_M2 = 2.0, 8.0
"""A wall behind which the other part saw less than this depth along its length [m], and less than
this area [m^2], may be a row of shelves: where a corridor or a room goes on, there is more."""


class Submaps(NamedTuple):
    """The submaps of one part.

    Attributes
    ----------
    grids : of each.
    poses : float64, shape (m, 3), in the frame of both parts [m, m, rad].
    path : float64, shape (k, 2), places that the robot drove through, close to each other [m].
    """

    grids: Sequence[FinishedGrid]
    poses: FloatArray
    path: FloatArray = np.zeros((0, 2))


class WallFault(NamedTuple):
    """A wall of one part where the other saw floor, and went on behind it.

    Attributes
    ----------
    x, y : its middle, in the frame of both parts [m].
    length : of the wall [m].
    hidden : area behind it that only the other part knows, and where that has seen walls [m^2].
    closes : whether it closes a corridor or room of both: it meets walls of the other part at both
        ends, or the robot drove through it there, or it is longer than furniture.
    """

    x: float
    y: float
    length: float
    hidden: float
    closes: bool = True


def wall_faults(
    one: Submaps,
    other: Submaps,
    submaps: SubmapConfig,
    min_length: float,
    min_hidden: float,
    held: FloatArray,
) -> list[WallFault]:
    """Return the walls of either part that the other contradicts, the longest first.

    Parameters
    ----------
    held : shape (k, 2), where scans of the one were matched to the other [m]: from there on the
        parts may be bent.
    min_length, min_hidden : least length of a wall [m], and least area behind it [m^2].
    """
    resolution = submaps.resolution
    box = _common_box(one, other, resolution)
    if box is None:
        return []
    maps = [compose_map(each.grids, each.poses, submaps, box).probability for each in (one, other)]
    faults = [
        *_faults(maps[0], maps[1], other.path, box, resolution, min_length, min_hidden, held),
        *_faults(maps[1], maps[0], one.path, box, resolution, min_length, min_hidden, held),
    ]
    return sorted(faults, key=lambda fault: (-fault.length, fault.x, fault.y))


def _common_box(one: Submaps, other: Submaps, resolution: float) -> CellBox | None:
    """Return the cells that both parts may have seen; None if there are none."""
    lower, upper = np.full(2, -np.inf), np.full(2, np.inf)
    for part in (one, other):
        corners = [
            transform_points(Pose(*pose), _corners(grid))
            for grid, pose in zip(part.grids, part.poses.tolist(), strict=True)
            if grid.size
        ]
        if not corners:
            return None
        lower = np.maximum(lower, np.concatenate(corners).min(axis=0))
        upper = np.minimum(upper, np.concatenate(corners).max(axis=0))
    if np.any(upper <= lower):
        return None
    first, end = np.floor(lower / resolution), np.ceil(upper / resolution) + 1
    return CellBox(int(first[0]), int(first[1]), int(end[0]), int(end[1]))


def _corners(grid: FinishedGrid) -> FloatArray:
    width, height = grid.shape[1] * grid.resolution, grid.shape[0] * grid.resolution
    x, y = grid.origin_x, grid.origin_y
    return np.array([(x, y), (x + width, y), (x, y + height), (x + width, y + height)])


def _faults(
    walls: NDArray[np.float32],
    seen: NDArray[np.float32],
    path: FloatArray,
    box: CellBox,
    resolution: float,
    min_length: float,
    min_hidden: float,
    held: FloatArray,
) -> list[WallFault]:
    """Return the walls of a map that another one contradicts, on which the robot drove a path.

    Both are of the same cells.
    """
    from scipy import ndimage  # heavy, and rarely used

    floor, others = (seen >= 0.0) & (seen < FLOOR), seen > MAYBE_WALL
    contradicted = (walls > WALL) & ndimage.binary_erosion(floor, iterations=1)
    _clear_near(contradicted, others, NEAR_WALL_M / resolution)
    if not contradicted.any():
        return []
    bridge = max(1, round(BRIDGED_M / resolution))
    pieces, _ = ndimage.label(_grown(contradicted, bridge), structure=np.ones((3, 3)))
    driven = path[:, ::-1] / resolution - (box.first_row, box.first_col)
    hidden: HiddenFloor | None = None  # hardly any wall comes that far
    faults = []
    for number, (rows, cols) in enumerate(ndimage.find_objects(pieces), start=1):
        length = _straight_length(contradicted[rows, cols] & (pieces[rows, cols] == number))
        length *= resolution
        if length < min_length:
            continue
        piece = np.argwhere(pieces[rows, cols] == number) + np.array((rows.start, cols.start))
        places = piece[contradicted[tuple(piece.T)]]
        if length < FURNITURE_M and has_free_end(walls, places, resolution):
            continue
        bend = _bend(places, box, resolution, held)
        reach = (NEAR_WALL_M + bend) / resolution
        if bend and _is_displaced(others, places, reach):
            continue
        if hidden is None:
            hidden = hidden_floor(walls, seen, resolution, bridge)
        area = area_behind(piece, places, walls, seen, hidden, resolution)
        if area >= max(min_hidden, min(HIDDEN_DEPTH_M * length, HIDDEN_M2)):
            x = (box.first_col + 0.5 * (cols.start + cols.stop)) * resolution
            y = (box.first_row + 0.5 * (rows.start + rows.stop)) * resolution
            closes = (
                length >= SHELVES_M
                or _is_driven_through(places, driven, THROUGH_M / resolution)
                or meets_walls(walls, others, places, reach, resolution)
            )
            faults.append(WallFault(x, y, length, area, closes))
    return faults


def _is_driven_through(places: IntArray, path: FloatArray, reach: float) -> bool:
    """Return whether a path, shape (k, 2), row and column, comes so close to a wall [cells]."""
    from scipy.spatial import cKDTree

    if len(path) == 0:
        return False
    apart, _ = cKDTree(path).query(places)
    return bool(apart.min() <= reach)


def _clear_near(cells: BoolArray, walls: BoolArray, distance: float) -> None:
    """Clear cells within a distance of a wall, in place [cells]."""
    from scipy.spatial import cKDTree

    places, known = np.argwhere(cells), np.argwhere(walls)
    if len(places) and len(known):
        apart, _ = cKDTree(known).query(places, distance_upper_bound=distance + 1.0)
        near = places[apart <= distance]
        cells[near[:, 0], near[:, 1]] = False


def _bend(places: IntArray, box: CellBox, resolution: float, held: FloatArray) -> float:
    """Return by how far a wall may be displaced since the parts are bent [m].

    Parameters
    ----------
    places : int64, shape (n, 2), row and column of its cells.
    held : shape (k, 2), where the parts hold together [m].
    """
    if len(held) == 0:
        return 0.0
    row, col = places.mean(axis=0)
    x, y = (box.first_col + col) * resolution, (box.first_row + row) * resolution
    away = np.hypot(held[:, 0] - x, held[:, 1] - y).min()
    return float(min(BEND_SHARE * away, MAX_BEND_M))


def _is_displaced(walls: BoolArray, places: IntArray, reach: float) -> bool:
    """Return whether the other part has the same wall within a distance, parallel to it.

    Parameters
    ----------
    walls : cells of the other part that may be walls.
    places : int64, shape (n, 2), row and column of cells of the wall.
    reach : the distance [cells].
    """
    middle, axes = axes_of(places)
    across, along = ((places - middle) @ axes).T
    most = reach + max(OBLIQUE) * np.abs(along).max()  # an oblique wall leads on
    lower = np.maximum(np.floor(places.min(axis=0) - most).astype(np.int64), 0)
    upper = np.ceil(places.max(axis=0) + most).astype(np.int64) + 1
    others = np.argwhere(walls[lower[0] : upper[0], lower[1] : upper[1]]) + lower
    aside, ahead = ((others - middle) @ axes).T
    aside = aside - np.median(across)
    is_beside = (np.abs(aside) <= most) & (ahead >= along.min()) & (ahead <= along.max())
    aside, ahead = aside[is_beside], ahead[is_beside]
    # Cells of an oblique line are up to 1.4 apart.
    least = MIN_DISPLACED_SHARE * len(np.unique(np.floor(along / 2.0)))
    parallel = max(_length_beside(ahead, aside, slope, reach) for slope in PARALLEL)
    oblique = max(_length_beside(ahead, aside, slope, most) for slope in OBLIQUE)
    return parallel >= max(least, oblique)


def _length_beside(ahead: FloatArray, aside: FloatArray, slope: float, reach: float) -> int:
    """Return how much of a wall lies beside cells in one line, at the best shift [2 cells].

    Parameters
    ----------
    ahead, aside : where the cells are along and across the wall, from its middle [cells].
    slope : of the line to the wall.
    reach : largest shift [cells].
    """
    aside, numbers = aside - slope * ahead, np.floor(ahead / 2.0)
    most = math.floor(reach)
    return max(
        len(np.unique(numbers[np.abs(aside - shift) <= 1.0])) for shift in range(-most, most + 1)
    )


def _straight_length(cells: BoolArray) -> float:
    """Return along how much of their main axis cells lie close to it: less for ragged ones [cells].

    The edges of what is seen through a gap, and of furniture, are ragged; walls are straight.
    """
    places = np.argwhere(cells)
    middle, axes = axes_of(places)
    across, along = ((places - middle) @ axes).T
    close = along[np.abs(across - np.median(across)) <= STRAIGHT_CELLS]
    # Cells of an oblique line are up to 1.4 apart.
    return 2.0 * len(np.unique(np.floor(close / 2.0)))


def _grown(cells: BoolArray, radius: int) -> BoolArray:
    from scipy import ndimage

    grown: BoolArray = ndimage.binary_dilation(cells, iterations=radius)
    return grown
