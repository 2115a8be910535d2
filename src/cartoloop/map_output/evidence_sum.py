# SPDX-License-Identifier: Apache-2.0
"""The sum of the evidence of submaps in the cells of a map, one submap after the other."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from cartoloop.arrays import BoolArray, FloatArray, IntArray
from cartoloop.config import SubmapConfig
from cartoloop.kernels.map_composition import add_submap, cell_evidence
from cartoloop.sensor.pose import Pose, inverse, transform_points
from cartoloop.submaps.finished_grid import MAX_PROBABILITY, MAX_STEPS, MIN_PROBABILITY

if TYPE_CHECKING:
    from cartoloop.submaps.finished_grid import FinishedGrid


class EvidenceSum:
    """Log-odds of the cells of a map, from the submaps added so far.

    Parameters
    ----------
    lower : int64, shape (2,), column and row of the map's first cell on the lattice of its frame.
    shape : rows and columns of the map.
    config : resolution of the map, and what a hit and a miss weigh.

    Attributes
    ----------
    lower : see above.
    resolution : edge of a cell [m].
    total : float32, shape (rows, cols), log-odds; 0 where nothing was seen.
    known : bool, same shape, whether any submap has seen the cell.
    """

    def __init__(self, lower: IntArray, shape: tuple[int, int], config: SubmapConfig) -> None:
        self.lower = lower
        self.resolution = config.resolution
        self.total: NDArray[np.float32] = np.zeros(shape, dtype=np.float32)
        self.known: BoolArray = np.zeros(shape, dtype=np.bool_)
        self._log_odds = cell_log_odds(config)

    def add(self, grid: FinishedGrid, pose: Pose) -> None:
        """Add a submap at its pose in the map; what lies outside is left out."""
        num_rows, num_cols = self.known.shape
        cells = transform_points(pose, outer_corners(grid)) / self.resolution - self.lower
        first = np.clip(np.floor(cells.min(axis=0)) - 1, 0, None).astype(np.int64)
        end = np.minimum(np.ceil(cells.max(axis=0)).astype(np.int64) + 1, (num_cols, num_rows))
        if np.any(first >= end):
            return
        window = np.array((first[1], end[1], first[0], end[0]))
        affine = map_cell_to_submap_cell(pose, grid, self.lower, self.resolution)
        cells_around = np.pad(grid.cells, 1)
        evidence = np.empty(cells_around.shape, dtype=np.float32)
        cell_evidence(cells_around, self._log_odds, evidence)
        add_submap(cells_around, evidence, affine, window, self.total, self.known)


def cells_covering(
    submaps: Sequence[tuple[FinishedGrid, Pose]], resolution: float, margin: int
) -> tuple[IntArray, tuple[int, int]]:
    """Return the first cell, column and row, and the shape of a map that holds all submaps.

    Parameters
    ----------
    submaps : grids and their poses, at least one.
    resolution : edge of a cell of the map [m].
    margin : unknown cells around.
    """
    corners = [transform_points(pose, outer_corners(grid)) for grid, pose in submaps]
    corner_cells = np.concatenate(corners) / resolution
    lower = np.floor(corner_cells.min(axis=0)).astype(np.int64) - margin
    upper = np.ceil(corner_cells.max(axis=0)).astype(np.int64) + margin
    num_cols, num_rows = (upper - lower + 1).tolist()
    return lower, (num_rows, num_cols)


def outer_corners(grid: FinishedGrid) -> FloatArray:
    """Return centres of the outermost cells of a ring of unknown cells around a grid.

    In the submap's frame [m], shape (4, 2).
    """
    num_rows, num_cols = grid.shape
    left, bottom = grid.origin_x - grid.resolution, grid.origin_y - grid.resolution
    right = grid.origin_x + num_cols * grid.resolution
    top = grid.origin_y + num_rows * grid.resolution
    return np.array([(left, bottom), (right, bottom), (right, top), (left, top)])


def cell_log_odds(config: SubmapConfig) -> NDArray[np.float32]:
    """Return the log-odds that a cell adds to the map, float32 (256,), by its value."""
    span = MAX_PROBABILITY - MIN_PROBABILITY
    probability = MIN_PROBABILITY + np.arange(-1, 255) / MAX_STEPS * span
    log_odds = np.log(probability / (1.0 - probability))
    log_odds[0] = 0.0
    hit = math.log(config.hit_probability / (1.0 - config.hit_probability))
    miss = math.log((1.0 - config.miss_probability) / config.miss_probability)
    return np.where(log_odds > 0.0, max(1.0, hit / miss) * log_odds, log_odds).astype(np.float32)


def map_cell_to_submap_cell(
    tf_map_submap: Pose, grid: FinishedGrid, lower: IntArray, resolution: float
) -> FloatArray:
    """Return the transform from map cells to cells of a submap and the ring around it.

    Both are coordinates of cell centres.
    """
    tf_submap_map = inverse(tf_map_submap)
    cos = math.cos(tf_submap_map.theta) * resolution / grid.resolution
    sin = math.sin(tf_submap_map.theta) * resolution / grid.resolution
    centre_x, centre_y = (float(cell) + 0.5 for cell in lower)
    first_x, first_y = grid.origin_x - grid.resolution, grid.origin_y - grid.resolution
    return np.array(
        (
            (tf_submap_map.x - first_x) / grid.resolution + cos * centre_x - sin * centre_y,
            cos,
            -sin,
            (tf_submap_map.y - first_y) / grid.resolution + sin * centre_x + cos * centre_y,
            sin,
            cos,
        )
    )
