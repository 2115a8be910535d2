# SPDX-License-Identifier: Apache-2.0
"""How many returns of scans agree with a submap, and how many contradict it.

A return contradicts where it lies on floor that the submap saw clearly. A beam without a return
clears the space along it, too. Where the scanner sees less far than that, it clears walls that it
passes, and a few scans from nearby do not bring all of them back. Returns of other scans on these
walls lie on what looks like floor, however right the map is. Two kinds of floor are less sure then:

- what is around returns of the submap's own scans: it contradicts itself. Scans that lie elsewhere
  than the submap have returns where none of its own scans had any;
- what is farther from all scans of the submap than the scanner has ever had a return: no beam with
  a return has passed there. Most of it is floor, and shows visits that are displaced. But scans
  that follow each other look ahead to just those walls that were not seen yet.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from cartoloop.arrays import BoolArray, FloatArray, IntArray
from cartoloop.kernels.map_agreement import AgreementLimits, CellGrid, count_agreement
from cartoloop.kernels.scan_batch import ScanBatch
from cartoloop.sensor.pose import Pose, transform_points
from cartoloop.sensor.scan_points import ScanPoints


def agreement(
    grid: CellGrid, limits: AgreementLimits, scans: ScanPoints, tf_submap_scan: FloatArray
) -> IntArray:
    """Return how many returns of k scans are on walls and on floor of a submap, shape (k, 2).

    Parameters
    ----------
    grid, limits : of the submap.
    scans : k of them.
    tf_submap_scan : float64 (k, 3) [m, m, rad].
    """
    counts = np.zeros((len(scans), 2), dtype=np.int64)
    batch = ScanBatch(scans.points, scans.firsts, scans.ends)
    count_agreement(grid, limits, batch, np.ascontiguousarray(tf_submap_scan), counts)
    return counts


def farthest_return(scans: ScanPoints) -> float:
    """Return the distance of the farthest return of all scans [m], 0 without any."""
    points = scans.points
    return math.sqrt(np.einsum("ij,ij->i", points, points).max(initial=0.0))


class Floor(NamedTuple):
    """A submap without floor that is less sure, see above: as never observed.

    Attributes
    ----------
    of_visits : without floor around its own returns, as scans of other visits are compared with.
    consecutive : also without what is out of reach, as scans that follow each other are.
    """

    of_visits: CellGrid
    consecutive: CellGrid


def sure_floor(
    grid: CellGrid,
    limits: AgreementLimits,
    own: ScanPoints,
    tf_submap_scan: FloatArray,
    reach: float,
) -> Floor:
    """Return a submap without floor that is less sure.

    Parameters
    ----------
    grid, limits : of the submap.
    own : the scans that were inserted into it, k of them.
    tf_submap_scan : float64 (k, 3), the poses at which they were inserted [m, m, rad].
    reach : distance of the farthest return of the scanner [m]. Where all floor is within it, beams
        without a return clear no farther, and the floor is sure.
    """
    if reach >= limits.max_range:
        return Floor(grid, grid)
    is_unseen = _are_far(grid, tf_submap_scan, reach) & (grid.cells <= limits.floor)
    if not np.any(is_unseen & (grid.cells > 0)):
        return Floor(grid, grid)
    of_visits = _without_own_returns(grid, limits, own, tf_submap_scan)
    consecutive = np.where(is_unseen, np.uint8(0), of_visits.cells)
    return Floor(of_visits, grid._replace(cells=consecutive))


def _without_own_returns(
    grid: CellGrid, limits: AgreementLimits, own: ScanPoints, tf_submap_scan: FloatArray
) -> CellGrid:
    """Return a submap without the floor at its own returns, as far as others agree with them."""
    on_floor = np.flatnonzero(agreement(grid, limits, own, tf_submap_scan)[:, 1]).tolist()
    points = [transform_points(Pose(*tf_submap_scan[row].tolist()), own[row]) for row in on_floor]
    places = np.unique(_cells_of(grid, np.concatenate([np.empty((0, 2)), *points])), axis=0)
    disc = np.argwhere(_is_in_disc(limits.on_wall)) - limits.on_wall
    around = (places[:, np.newaxis] + disc).reshape(-1, 2)
    rows, cols = around[np.all((around >= 0) & (around < grid.cells.shape), axis=1)].T
    cells = grid.cells.copy()
    cells[rows, cols] = np.where(cells[rows, cols] <= limits.floor, 0, cells[rows, cols])
    return grid._replace(cells=cells)


def _are_far(grid: CellGrid, poses: FloatArray, reach: float) -> BoolArray:
    """Return which cells are farther from all poses than a reach [m]."""
    radius = math.ceil(reach / grid.resolution)
    disc = _is_in_disc(radius)
    num_rows, num_cols = grid.cells.shape
    are_far = np.ones((num_rows + 2 * radius, num_cols + 2 * radius), dtype=np.bool_)
    places = np.clip(_cells_of(grid, poses[:, :2]), 0, (num_rows - 1, num_cols - 1))
    for row, col in np.unique(places, axis=0).tolist():
        are_far[row : row + 2 * radius + 1, col : col + 2 * radius + 1] &= ~disc
    return are_far[radius : radius + num_rows, radius : radius + num_cols]


def _cells_of(grid: CellGrid, points: FloatArray) -> IntArray:
    """Return rows and columns of points of the submap's frame, shape (n, 2); some are outside."""
    at = (points - (grid.origin_x, grid.origin_y)) / grid.resolution
    cells: IntArray = np.rint(at[:, ::-1]).astype(np.int64)
    return cells


def _is_in_disc(radius: int) -> BoolArray:
    """Return which cells of a square are in the disc in it, shape (2 radius + 1, 2 radius + 1)."""
    rows, cols = np.ogrid[-radius : radius + 1, -radius : radius + 1]
    is_inside: BoolArray = rows**2 + cols**2 <= radius**2
    return is_inside
