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
    first_col, first_row, last_col, last_row : lattice box that holds them all.
    """

    cells: NDArray[np.int32]
    num_hits: int
    first_col: int
    first_row: int
    last_col: int
    last_row: int


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
            x, y = ends[:, 0], ends[:, 1]
            low_x, high_x = min(low_x, float(x.min())), max(high_x, float(x.max()))
            low_y, high_y = min(low_y, float(y.min())), max(high_y, float(y.max()))
    first_col, first_row = math.floor(low_x / resolution) - 1, math.floor(low_y / resolution) - 1
    last_col, last_row = math.floor(high_x / resolution) + 1, math.floor(high_y / resolution) + 1
    marks = np.zeros((last_row - first_row + 1, last_col - first_col + 1), dtype=np.uint8)
    cells = np.empty((marks.size, 2), dtype=np.int32)
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
    return ScanCells(cells[:num_cells], num_hits, first_col, first_row, last_col, last_row)


def insert_cells(
    grid: ProbabilityGrid, cells: ScanCells, config: SubmapConfig, origin: tuple[int, int] = (0, 0)
) -> None:
    """Update the grid's probabilities by a scan's hits and misses.

    Parameters
    ----------
    cells : in the lattice of a frame that may differ from the grid's by whole cells.
    origin : lattice coordinates of the grid's frame in it.
    """
    if len(cells.cells) == 0:
        return
    col, row = origin
    grid.cover(
        cells.first_col - col, cells.first_row - row, cells.last_col - col, cells.last_row - row
    )
    ray_casting.update_cells(
        grid.cells,
        grid.first_col + col,
        grid.first_row + row,
        cells.cells,
        cells.num_hits,
        len(cells.cells),
        config.hit_probability,
        config.miss_probability,
        MIN_PROBABILITY,
        MAX_PROBABILITY,
    )
