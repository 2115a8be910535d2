# SPDX-License-Identifier: Apache-2.0
"""Which part of a map was surveyed, and what only stray rays saw."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cartoloop.arrays import BoolArray, FloatArray
from cartoloop.kernels.floor_blocks import count_in_blocks, floor_in_blocks
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
    limits = np.minimum((_SURELY_FREE, _OFTEN_FREE, free_below), free_below).astype(np.float32)
    counts = count_in_blocks(probability, edge, limits)
    if not counts.any():
        return None, 0.0
    sure, often, known = np.moveaxis(counts / edge**2 >= _DENSE, 2, 0)
    cells = (path[~np.isnan(path[:, 0])] - _origin(occupancy_map)) / resolution
    beside = _beside(cells / edge, known, edge * resolution)
    joined = _reached(beside, often, often.size)
    dense = joined | sure
    kinds = np.full(dense.shape, 1, dtype=np.uint8)
    if dense.any():
        dense |= beside
        kinds[_with_neighbours(joined)] = 2
        kinds[beside] = 3
    else:  # a few scans only
        dense, kinds[:] = known, 3
    kinds[~_with_neighbours(dense)] = 0
    num_free, *box = floor_in_blocks(probability, edge, limits, kinds)
    return _box(box, cells, occupancy_map), num_free * resolution**2


def _origin(occupancy_map: OccupancyMap) -> FloatArray:
    return np.array((occupancy_map.origin_x, occupancy_map.origin_y))


def _box(seen: Sequence[int], path: FloatArray, occupancy_map: OccupancyMap) -> Extent | None:
    """Return the rectangle around cells and the path [cells].

    Parameters
    ----------
    seen : first row, first column, last row and last column of the cells.
    """
    first_row, first_col, last_row, last_col = seen
    if last_row >= first_row:
        corners = [(first_col, first_row), (last_col + 1, last_row + 1)]
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


def _with_neighbours(blocks: BoolArray) -> BoolArray:
    """Return the blocks and the eight around each."""
    padded = np.pad(blocks, 1)
    rows = padded[:-2] | padded[1:-1] | padded[2:]
    return rows[:, :-2] | rows[:, 1:-1] | rows[:, 2:]
