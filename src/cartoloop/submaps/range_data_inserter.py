# SPDX-License-Identifier: Apache-2.0
"""Insertion of scans into probability grids: hit set, miss set, eq. (2) and (3) (section IV-B)."""

from __future__ import annotations

from typing import NamedTuple

from cartoloop.arrays import CellArray, FloatArray
from cartoloop.config import SubmapConfig
from cartoloop.errors import InputError
from cartoloop.kernels import ray_casting
from cartoloop.kernels.grid_update import update_cells
from cartoloop.sensor.pose import Pose
from cartoloop.submaps.finished_grid import MAX_PROBABILITY, MIN_PROBABILITY
from cartoloop.submaps.probability_grid import ProbabilityGrid


class ScanCells(NamedTuple):
    """The grid points that a scan hits and misses: disjoint sets.

    Attributes
    ----------
    hits : int32, shape (h, 2), lattice (column, row), each once.
    free : int32, shape (f, 3), the misses as runs along rows: lattice row, first column, column
        after the last.
    first_col, first_row, last_col, last_row : lattice box around them all.
    """

    hits: CellArray
    free: CellArray
    first_col: int
    first_row: int
    last_col: int
    last_row: int


def scan_cells(
    tf_grid_sensor: Pose, returns: FloatArray, misses: FloatArray, resolution: float
) -> ScanCells:
    """Return the hit and miss sets of a scan.

    Parameters
    ----------
    tf_grid_sensor : start of the rays.
    returns, misses : float64, shapes (n, 2), (k, 2), ends of the rays [m, grid frame].
    resolution : pixel edge r [m].

    Raises
    ------
    InputError
        They are too far from each other, or from the origin, for any map.
    """
    cells = ScanCells(
        *ray_casting.scan_cells(tf_grid_sensor.x, tf_grid_sensor.y, returns, misses, resolution)
    )
    _check_extent(*cells[2:], resolution)
    return cells


def insert_cells(
    grid: ProbabilityGrid, cells: ScanCells, config: SubmapConfig, origin: tuple[int, int] = (0, 0)
) -> None:
    """Update the grid's probabilities by a scan's hits and misses.

    Parameters
    ----------
    cells : in a lattice that may be shifted against the grid's by whole cells.
    origin : lattice coordinates of the origin of the grid's frame.

    Raises
    ------
    InputError
        They are too far from the cells of the grid for one submap.
    """
    if len(cells.hits) + len(cells.free) == 0:
        return
    col, row = origin
    first_col, first_row = cells.first_col - col, cells.first_row - row
    last_col, last_row = cells.last_col - col, cells.last_row - row
    num_rows, num_cols = grid.cells.shape
    if num_rows:
        _check_extent(
            min(first_col, grid.first_col),
            min(first_row, grid.first_row),
            max(last_col, grid.first_col + num_cols),
            max(last_row, grid.first_row + num_rows),
            grid.resolution,
        )
    grid.cover(first_col, first_row, last_col, last_row)
    update_cells(
        grid.cells,
        grid.first_col + col,
        grid.first_row + row,
        cells.hits,
        cells.free,
        config.hit_probability,
        config.miss_probability,
        MIN_PROBABILITY,
        MAX_PROBABILITY,
    )


def _check_extent(
    first_col: int, first_row: int, last_col: int, last_row: int, resolution: float
) -> None:
    """Raise an InputError if a lattice box is too large for a submap, or too far away."""
    if ray_casting.fits(first_col, first_row, last_col, last_row):
        return
    width, height = (last_col - first_col) * resolution, (last_row - first_row) * resolution
    what = f"a submap would be {width:.4g} m by {height:.4g} m"
    if max(map(abs, (first_col, first_row, last_col, last_row))) >= ray_casting.FARTHEST:
        what = f"it would be {ray_casting.FARTHEST * resolution:.4g} m or more from the start"
    raise InputError(
        f"{what}; probably the odometry jumped while the scans showed nothing "
        "(--set local_slam.use_odometry=false maps without it), or "
        f"local_slam.submaps.resolution = {resolution:g} is too fine"
    )
