# SPDX-License-Identifier: Apache-2.0
"""The probability grid of a growing submap, and the insertion of scans (section IV-B)."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cartoloop.arrays import CellArray, FloatArray
from cartoloop.config import SubmapConfig
from cartoloop.errors import InputError
from cartoloop.kernels import ray_casting, scan_insertion
from cartoloop.kernels.cell_values import known_box
from cartoloop.kernels.grid_update import update_cells
from cartoloop.runtime.reused_memory import ReusedMemory
from cartoloop.sensor.pose import Pose
from cartoloop.submaps.finished_grid import (
    MAX_PROBABILITY,
    MIN_PROBABILITY,
    FinishedGrid,
    quantize_part,
)

GROWTH_CELLS = 64
"""Minimum growth of a grid, so that it rarely grows [cells]: 3.2 m at 0.05 m."""

NO_POINTS = np.empty((0, 2))

_MEMORY = ReusedMemory(max_idle_bytes=16 << 20)
"""Memory of growing grids: that of four usual ones."""


WALL_REACH_M = 0.3
"""The direction of a wall is measured over so much to either side [m]: many times the noise."""

WALL_STRAIGHTNESS = 0.9
"""Least cosine of the angle between the two sides of a straight wall: 26 degrees, for noise."""


class Extent(NamedTuple):
    """The cells of a grid and their position, replaced together since other threads may read them.

    Attributes
    ----------
    cells : float32, shape (num_rows, num_cols); positive where observed, then within
        [MIN_PROBABILITY, MAX_PROBABILITY]; negative where only hidden by walls, the probability
        that an observation starts from; otherwise 0.
    first_col, first_row : lattice coordinates of ``cells[0, 0]``, whose centre is at
        (first_col * r, first_row * r) in the grid's frame.
    """

    cells: NDArray[np.float32]
    first_col: int
    first_row: int


class ProbabilityGrid:
    """A map from grid points to the probability that they are obstructed; grows as needed.

    Attributes
    ----------
    resolution : pixel edge r [m].
    extent : its cells and their position.
    """

    def __init__(self, resolution: float) -> None:
        self.resolution = resolution
        self.extent = Extent(np.zeros((0, 0), dtype=np.float32), 0, 0)

    @property
    def cells(self) -> NDArray[np.float32]:
        """The cells; see :class:`Extent`."""
        return self.extent.cells

    @property
    def first_col(self) -> int:
        """Lattice coordinate of the first column."""
        return self.extent.first_col

    @property
    def first_row(self) -> int:
        """Lattice coordinate of the first row."""
        return self.extent.first_row

    @property
    def origin_x(self) -> float:
        """Centre of the first column [m, grid frame]."""
        return self.extent.first_col * self.resolution

    @property
    def origin_y(self) -> float:
        """Centre of the first row [m, grid frame]."""
        return self.extent.first_row * self.resolution

    def cover(self, first_col: int, first_row: int, last_col: int, last_row: int) -> None:
        """Grow so that all lattice cells from first to last (inclusive) are within the grid."""
        cells, own_col, own_row = self.extent
        num_rows, num_cols = cells.shape
        if num_rows == 0:
            own_col, own_row = first_col - GROWTH_CELLS, first_row - GROWTH_CELLS
            shape = (last_row - own_row + GROWTH_CELLS, last_col - own_col + GROWTH_CELLS)
            self.extent = Extent(np.zeros(shape, dtype=np.float32), own_col, own_row)
            return
        left = _growth(own_col - first_col)
        below = _growth(own_row - first_row)
        right = _growth(last_col + 1 - own_col - num_cols)
        above = _growth(last_row + 1 - own_row - num_rows)
        if not (left or below or right or above):
            return
        grown = _surrounded(cells, (below, above), (left, right))
        self.extent = Extent(grown, own_col - left, own_row - below)

    def finish(self) -> FinishedGrid:
        """Return the known part, quantized, for searches and maps."""
        cells, first_col, first_row = self.extent
        row, col, *shape = known_box(cells)
        return FinishedGrid(
            quantize_part(cells, row, col, (shape[0], shape[1])),
            (first_col + col) * self.resolution,
            (first_row + row) * self.resolution,
            self.resolution,
        )


def _growth(shortfall: int) -> int:
    """Return the growth at a side where `shortfall` cells are missing [cells]."""
    return shortfall + GROWTH_CELLS if shortfall > 0 else 0


def _surrounded(
    cells: NDArray[np.float32], rows: tuple[int, int], columns: tuple[int, int]
) -> NDArray[np.float32]:
    """Return cells with zeros around them: rows below and above, columns left and right."""
    num_rows, num_cols = cells.shape
    below, left = rows[0], columns[0]
    above, right = below + num_rows, left + num_cols
    shape = (above + rows[1], right + columns[1])
    size = cells.itemsize * shape[0] * shape[1]
    # Rounded up, so that the next but one grid, which is a little larger, fits in there, too.
    memory = _MEMORY.array(1 << (size - 1).bit_length())[:size]
    grown = memory.view(np.float32).reshape(shape)
    grown[:below] = grown[above:] = 0.0
    grown[below:above, :left] = grown[below:above, right:] = 0.0
    grown[below:above, left:right] = cells
    return grown


class ScanCells(NamedTuple):
    """The grid points that a scan hits and misses, and those that its walls hide: disjoint sets.

    Attributes
    ----------
    hits : int32, shape (h, 2), lattice (column, row), each once.
    free : int32, shape (f, 3), the misses as runs along rows: lattice row, first column, column
        after the last.
    hidden : int32, shape (b, 2), lattice (column, row), each once, of points just behind walls.
    first_col, first_row, last_col, last_row : lattice box around them all.
    """

    hits: CellArray
    free: CellArray
    hidden: CellArray
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
    x, y, _ = tf_grid_sensor
    cells = ScanCells(
        *ray_casting.scan_cells(x, y, returns, misses, NO_POINTS, resolution, 0.0, 0.0)
    )
    _check_extent(*cells[3:], resolution)
    return cells


def cells_with_walls(
    tf_grid_sensor: Pose,
    returns: FloatArray,
    misses: FloatArray,
    config: SubmapConfig,
    uncertain: tuple[float, float] = (0.0, 0.0),
    *,
    are_hidden: bool,
) -> ScanCells:
    """Return the hit and miss sets of a scan, with its straight walls, and what these hide.

    The beams of a coarse scanner leave gaps of several cells in a wall. The next scan, from another
    angle, hits the wall in these, and would find nothing there to match: points between the returns
    of neighbouring beams count as returns.

    A cell just in front of a wall is hit by some returns, because of their noise, and missed by all
    others. One just behind it would be hit by some, and missed by none, so that the wall would
    appear to be farther away, the more the longer it has been seen: a robot that has it on one side
    would turn. So what a wall hides counts as missed, to the depth of a pixel.

    Parameters
    ----------
    tf_grid_sensor, returns, misses : as for :func:`scan_cells`, the returns in the order of the
        beams.
    uncertain : so much of a ray in front of its return is not known to be free, since the range may
        be too long: a length [m] and a share of the ray, their squares added.
    are_hidden : whether what walls hide counts.

    Raises
    ------
    InputError
        As for :func:`scan_cells`.
    """
    x, y, _ = tf_grid_sensor
    cells = ScanCells(
        *scan_insertion.cells_with_walls(
            x,
            y,
            returns,
            misses,
            config.resolution,
            config.max_return_gap,
            math.cos(math.radians(config.max_wall_bend_deg)),
            WALL_REACH_M if are_hidden else 0.0,
            WALL_STRAIGHTNESS,
            *uncertain,
        )
    )
    _check_extent(*cells[3:], config.resolution)
    return cells


def insert_cells(
    grid: ProbabilityGrid,
    cells: ScanCells,
    config: SubmapConfig,
    origin: tuple[int, int] = (0, 0),
    weight: float = 1.0,
) -> None:
    """Update the grid's probabilities by a scan's hits and misses.

    Parameters
    ----------
    cells : in a lattice that may be shifted against the grid's by whole cells.
    origin : lattice coordinates of the origin of the grid's frame.
    weight : number of independent observations that the scan stands for; the odds of eq. (3) are
        raised to this power.

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
        cells.hidden,
        _repeated(config.hit_probability, weight),
        _repeated(config.miss_probability, weight),
        MIN_PROBABILITY,
        MAX_PROBABILITY,
    )


def _repeated(probability: float, times: float) -> float:
    """Return the probability of a cell after a number of equal observations."""
    if times == 1.0:
        return probability
    odds: float = (probability / (1.0 - probability)) ** times
    return odds / (1.0 + odds)


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
