# SPDX-License-Identifier: Apache-2.0
"""Insertion of scans into probability grids: hit set, miss set, eq. (2) and (3) (section IV-B)."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cartoloop.config import SubmapConfig
from cartoloop.kernels import ray_casting
from cartoloop.sensor.pose import FloatArray, Pose
from cartoloop.submaps.finished_grid import MAX_PROBABILITY, MIN_PROBABILITY
from cartoloop.submaps.probability_grid import ProbabilityGrid


class ScanCells(NamedTuple):
    """The grid points that a scan hits and misses.

    Attributes
    ----------
    cells : int32, shape (n, 2), lattice (column, row), each once, hits first.
    num_hits : how many of them are hits.
    """

    cells: NDArray[np.int32]
    num_hits: int


def scan_cells(
    tf_grid_sensor: Pose, returns: FloatArray, misses: FloatArray, resolution: float
) -> ScanCells:
    """Return the disjoint hit and miss sets of a scan.

    Parameters
    ----------
    tf_grid_sensor : where the rays start.
    returns, misses : float64, shapes (n, 2), (k, 2), ends of the rays [m, grid frame].
    resolution : pixel edge r [m].
    """
    low_x = high_x = tf_grid_sensor.x
    low_y = high_y = tf_grid_sensor.y
    for ends in (returns, misses):
        if len(ends):
            (min_x, min_y), (max_x, max_y) = ends.min(axis=0), ends.max(axis=0)
            low_x, low_y = min(low_x, min_x), min(low_y, min_y)
            high_x, high_y = max(high_x, max_x), max(high_y, max_y)
    first_col, first_row = math.floor(low_x / resolution) - 1, math.floor(low_y / resolution) - 1
    num_cols = math.floor(high_x / resolution) + 3 - first_col
    num_rows = math.floor(high_y / resolution) + 3 - first_row
    marks = np.zeros((num_rows, num_cols), dtype=np.uint8)
    cells = np.empty((num_rows * num_cols, 2), dtype=np.int32)
    num_hits, num_cells = ray_casting.scan_cells(
        tf_grid_sensor.x,
        tf_grid_sensor.y,
        returns,
        misses,
        resolution,
        marks,
        first_col,
        first_row,
        cells,
    )
    return ScanCells(cells[:num_cells], num_hits)


def insert_cells(grid: ProbabilityGrid, cells: ScanCells, config: SubmapConfig) -> None:
    """Update the grid's probabilities by a scan's hits and misses."""
    if len(cells.cells) == 0:
        return
    first, last = cells.cells.min(axis=0), cells.cells.max(axis=0)
    grid.cover(int(first[0]), int(first[1]), int(last[0]), int(last[1]))
    ray_casting.update_cells(
        grid.cells,
        grid.first_col,
        grid.first_row,
        cells.cells,
        cells.num_hits,
        len(cells.cells),
        config.hit_probability,
        config.miss_probability,
        MIN_PROBABILITY,
        MAX_PROBABILITY,
    )
