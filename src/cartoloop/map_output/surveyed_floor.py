# SPDX-License-Identifier: Apache-2.0
"""Which part of a map was surveyed, and what only stray rays saw."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cartoloop.arrays import BoolArray, FloatArray, IntArray
from cartoloop.map_output.occupancy_map import OccupancyMap
from cartoloop.submaps.finished_grid import MIN_PROBABILITY

_BLOCK_M = 0.4
"""Edge of the blocks that are known or not [m]: a robot fits in no narrower passage."""

_DENSE = 0.8
"""A block is surveyed if this share of its cells is known for sure. Rays that stray through a
window or a mirror diverge, and leave the cells between them unknown, and others doubtful."""

_SURELY_FREE = 0.02
"""Cells less probably occupied than this were seen free from several places."""

_OFTEN_FREE = 1.1 * MIN_PROBABILITY
"""Cells less probably occupied than this were seen free about as often as one submap counts: floor
that was passed once, like that of the first part of a drive, is no surer."""

_BESIDE_PATH_M = 2.0
"""Floor this far along the floor from the path was surveyed, however few scans saw it [m]: most
corridors are no wider."""


@dataclass(frozen=True, slots=True)
class Extent:
    """A rectangle along the axes of the map.

    Attributes
    ----------
    left, bottom, right, top : its sides [m, map frame].
    """

    left: float
    bottom: float
    right: float
    top: float

    @property
    def width(self) -> float:
        """Along x [m]."""
        return self.right - self.left

    @property
    def height(self) -> float:
        """Along y [m]."""
        return self.top - self.bottom


def surveyed(
    occupancy_map: OccupancyMap, free_below: float, path: FloatArray
) -> tuple[Extent | None, float]:
    """Return the rectangle around what was surveyed, and the area of its floor [m^2].

    Surveyed is where almost all cells of a block are known for sure, or the block is joined to the
    path by floor that was seen often; and the blocks next to these, which hold the walls; not the
    rays that stray through a window. The path itself lies in the rectangle.

    Parameters
    ----------
    occupancy_map : the map.
    free_below : cells less probably occupied than this are floor.
    path : places of the robot, shape (n, 2), NaN for none [m, map frame].
    """
    probability, resolution = occupancy_map.probability, occupancy_map.resolution
    edge = max(1, round(_BLOCK_M / resolution))
    free, wall = (probability >= 0.0) & (probability < free_below), probability > 0.5
    known = free | wall
    if not known.any():
        return None, 0.0
    cells = (path[~np.isnan(path[:, 0])] - _origin(occupancy_map)) / resolution
    often = wall | (free & (probability < _OFTEN_FREE))
    sure = wall | (free & (probability < _SURELY_FREE))
    beside = _beside(cells / edge, _dense_blocks(known, edge), edge * resolution)
    often_blocks = _dense_blocks(often, edge)
    joined = _reached(beside, often_blocks, often_blocks.size)
    dense = joined | _dense_blocks(sure, edge)
    if dense.any():
        dense |= beside
        sure |= often & _cells_of(_with_neighbours(joined), edge, known.shape)
        sure |= known & _cells_of(beside, edge, known.shape)
    else:  # a few scans only
        sure, dense = known, _dense_blocks(known, edge)
    around = _cells_of(_with_neighbours(dense), edge, known.shape)
    area_m2 = float(np.count_nonzero(free & around)) * resolution**2
    return _box(sure & around, cells, occupancy_map), area_m2


def _origin(occupancy_map: OccupancyMap) -> FloatArray:
    return np.array((occupancy_map.origin_x, occupancy_map.origin_y))


def _box(seen: BoolArray, path: FloatArray, occupancy_map: OccupancyMap) -> Extent | None:
    """Return the rectangle around cells and the path [cells]."""
    cols, rows = np.flatnonzero(seen.any(axis=0)), np.flatnonzero(seen.any(axis=1))
    if len(rows):
        corners = [(cols[0], rows[0]), (cols[-1] + 1, rows[-1] + 1)]
        path = np.concatenate((path, np.array(corners, dtype=np.float64)))
    if len(path) == 0:
        return None
    ends = np.stack((path.min(axis=0), path.max(axis=0)))
    corners_map = _origin(occupancy_map) + ends * occupancy_map.resolution
    return Extent(*corners_map.ravel().tolist())


def _beside(path: FloatArray, known: BoolArray, edge_m: float) -> BoolArray:
    """Return which known blocks are joined to the path by known blocks, and not far from it.

    Parameters
    ----------
    path : shape (n, 2) [blocks].
    known : which blocks are known almost as a whole.
    edge_m : of a block [m].
    """
    cols, rows = np.floor(path).astype(np.int64).T
    inside = (rows >= 0) & (rows < known.shape[0]) & (cols >= 0) & (cols < known.shape[1])
    passed = np.zeros_like(known)
    passed[rows[inside], cols[inside]] = True
    return _reached(passed, known, max(1, round(_BESIDE_PATH_M / edge_m)))


def _reached(first: BoolArray, within: BoolArray, max_steps: int) -> BoolArray:
    """Return which blocks are reached from the first ones, by their sides, within some blocks."""
    reached = first & within
    for _ in range(max_steps):
        around = np.pad(reached, 1)
        beside = around[:-2, 1:-1] | around[2:, 1:-1] | around[1:-1, :-2] | around[1:-1, 2:]
        grown = reached | (beside & within)
        if np.array_equal(grown, reached):
            break
        reached = grown
    return reached


def _dense_blocks(known: BoolArray, edge: int) -> BoolArray:
    """Return which blocks of `edge` by `edge` cells are known almost as a whole."""
    num_rows, num_cols = known.shape
    padded = np.pad(known, ((0, -num_rows % edge), (0, -num_cols % edge)))
    # Along whole rows first: sums of a few neighbours take NumPy ten times as long.
    rows, cols = padded.shape[0] // edge, padded.shape[1] // edge
    by_row = padded.reshape(rows, edge, cols * edge).sum(axis=1, dtype=np.int32)
    counts: IntArray = by_row.reshape(rows, cols, edge).sum(axis=2)
    return counts / edge**2 >= _DENSE


def _with_neighbours(blocks: BoolArray) -> BoolArray:
    """Return the blocks and the eight around each."""
    padded = np.pad(blocks, 1)
    rows = padded[:-2] | padded[1:-1] | padded[2:]
    return rows[:, :-2] | rows[:, 1:-1] | rows[:, 2:]


def _cells_of(blocks: BoolArray, edge: int, shape: tuple[int, ...]) -> BoolArray:
    """Return which cells lie in blocks."""
    cells = np.repeat(np.repeat(blocks, edge, axis=0), edge, axis=1)
    return cells[: shape[0], : shape[1]]
