# SPDX-License-Identifier: Apache-2.0
"""How well scans fit to a map: where their returns lie, and what their beams pass through."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from cartoloop.arrays import FloatArray, IntArray
from cartoloop.kernels.map_agreement import CellGrid
from cartoloop.kernels.scan_batch import ScanBatch
from cartoloop.kernels.scan_fit import (
    BEHIND_WALL,
    ON_FLOOR,
    ON_STRAIGHT_WALL,
    ON_WALL,
    ON_WALL_BEHIND,
    SEEN_THROUGH,
    STRAIGHT,
    FitLimits,
    count_fit,
    count_passes,
)
from cartoloop.kernels.straight_walls import mark_straight_walls
from cartoloop.kernels.sum_at_points import sum_at_points
from cartoloop.quality.pairs import FLOOR, OFF_WALL_M, ON_WALL_M, WALL
from cartoloop.sensor.scan_points import ScanPoints
from cartoloop.submaps.finished_grid import mean_probability, mean_value

CLEARANCE_M = 0.5
"""Walls nearer than this to either end of a beam do not block it [m]: along a wall, beams pass
through its blurred edge."""

MAX_COUNTED_RANGE_M = 25.0
"""Returns farther away do not count for the agreement [m]: a small turn moves them off a wall."""

STRAIGHT_M, NUM_HEADINGS = 1.0, 16
"""A wall that goes on straight this far to both sides [m], in one of this number of headings, is
straight."""

STRAIGHT_WEIGHT = 0.25
"""A return on a straight wall counts this much for distinctness: corridors are alike."""

THIN_M, FREE_SHARE = 0.25, 0.6
"""Objects of a map up to this size block no beam [m] if this share of what is around them is floor:
legs of tables and chairs are not wider than by what a pose is wrong and a map blurred, and beams
pass on both sides of them. Parts of a wall that few beams have shown do not stand on floor."""

MIN_PASSES = 3
"""A wall that this number of beams of the map's own scans pass through is seen through, as glass
and railings are: other beams may pass as well."""

GLASS_SHARE, GLASS_ON_WALL = 0.25, 0.85
"""Where a map does not show which walls are seen through: if at least the first share of returns
lies behind walls, and at least the second share of these on other walls, the former are seen
through, as the railing of an atrium. In wrong places, fewer lie behind walls and on others."""

MIN_GLASS_SCANS = 4
"""Number of scans that show this: a single one may show the wall of another room."""

LOW_SHARE = 0.1
"""Share of the scans that may be less distinct than what is the distinctness of all."""

UNKNOWN_WEIGHT = 2.0 / 3.0
"""A return about which the map says nothing is explained by this share: it speaks against a place,
but by a third of what a return that contradicts the map does."""

MIN_DISTINCT = 5.0
"""Scans with less than this to count are not looked at for distinctness."""


class Fit(NamedTuple):
    """How well scans fit to the map at their poses.

    Attributes
    ----------
    score : mean probability at the returns.
    agreement : of the returns where the map is known, the share on walls; the others lie on floor
        or behind walls. Those seen through walls do not count. NaN where none is counted.
    distinctness : the same with a lower weight of returns on straight walls, which lie on walls in
        many wrong places as well. Of several scans, nine of ten reach it. NaN where too few are
        counted.
    num_counted : number of returns where the map is known.
    detail : of these returns, the share on walls that are not straight.
    solid_agreement : the agreement if no beam passed through any wall.
    explained : share of all returns that the place explains: those on walls, and of those that are
        not counted :data:`UNKNOWN_WEIGHT`.
    explained_if_glass : the same if all beams that end on walls behind others passed through glass.
    """

    score: float
    agreement: float
    distinctness: float
    num_counted: int
    detail: float = 0.0
    solid_agreement: float = math.nan
    explained: float = 0.0
    explained_if_glass: float = 0.0

    @property
    def if_solid(self) -> Fit:
        """The fit if no beam passed through any wall."""
        return self._replace(agreement=self.solid_agreement)

    @property
    def detailed_agreement(self) -> float:
        """The agreement of the returns that do not lie on straight walls."""
        return self.detail / max(self.detail + 1.0 - self.agreement, 1e-9)

    @property
    def mean_distinctness(self) -> float:
        """The distinctness of all returns together: few scans that contradict lower it little."""
        agreeing = self.detail + STRAIGHT_WEIGHT * (self.agreement - self.detail)
        return agreeing / max(agreeing + 1.0 - self.agreement, 1e-9)


class FitJudge:
    """Judges how well scans fit to the cells of a map.

    Parameters
    ----------
    grid : of the map.
    """

    def __init__(self, grid: CellGrid) -> None:
        resolution = grid.resolution
        self._grid = grid
        self._limits = FitLimits(
            math.floor(mean_value(WALL)),
            math.floor(mean_value(FLOOR)),
            math.ceil(ON_WALL_M / resolution),
            math.ceil(OFF_WALL_M / resolution),
            CLEARANCE_M / resolution,
            MAX_COUNTED_RANGE_M,
        )
        angles = np.arange(NUM_HEADINGS) * (math.pi / NUM_HEADINGS)
        self._marks = np.zeros_like(grid.cells)
        mark_straight_walls(
            grid.cells,
            self._limits.wall,
            max(round(STRAIGHT_M / resolution), 1),
            np.column_stack((np.cos(angles), np.sin(angles))),
            self._marks,
        )
        self._marks *= STRAIGHT
        self._thin = _thin_objects(grid, self._limits)
        self._marks[self._thin] |= SEEN_THROUGH
        self._knows_passes = False

    def passes(self, scans: ScanPoints, beam_origins: FloatArray, poses: FloatArray) -> IntArray:
        """Return how many beams pass through each wall, int64, shape of the map.

        Parameters
        ----------
        scans, beam_origins, poses : as for `fit`.
        """
        passes = np.zeros(self._grid.cells.shape, dtype=np.int64)
        count_passes(
            self._grid, self._limits, ScanBatch(scans.points, scans.firsts, scans.ends),
            np.ascontiguousarray(beam_origins), poses, passes,
        )  # fmt: skip
        return passes

    def set_passes(self, passes: IntArray) -> None:
        """Set which walls are seen through, given how many beams of the map's scans pass."""
        self._marks &= STRAIGHT
        self._marks[self._thin] |= SEEN_THROUGH
        self._marks[passes >= MIN_PASSES] |= SEEN_THROUGH
        self._knows_passes = True

    def score(self, scans: ScanPoints, poses: FloatArray) -> float:
        """Return the mean probability at the returns of scans, at least one; see :meth:`fit`."""
        grid = self._grid
        total = sum_at_points(
            grid.cells, 1, grid.origin_x, grid.origin_y, grid.resolution,
            scans.points, scans.firsts, scans.ends, poses,
        )  # fmt: skip
        return mean_probability(float(total) / int(scans.counts.sum()))

    def fit(self, scans: ScanPoints, beam_origins: FloatArray, poses: FloatArray) -> Fit:
        """Return how well scans fit together.

        Parameters
        ----------
        scans : k of them.
        beam_origins : float64, shape (k, 2), where their beams start, tracking frame [m].
        poses : float64, shape (k, 3), of each in the grid's frame.
        """
        num_points = int(scans.counts.sum())
        if num_points == 0:
            return Fit(0.0, math.nan, math.nan, 0)
        grid = self._grid
        counts = np.zeros((len(scans), 5), dtype=np.int64)
        count_fit(
            grid, self._marks, self._limits, ScanBatch(scans.points, scans.firsts, scans.ends),
            np.ascontiguousarray(beam_origins), poses, counts,
        )  # fmt: skip
        solid_agreement, num_solid = _agreement(counts)
        if not self._knows_passes and _is_behind_glass(counts, num_solid):
            counts[:, BEHIND_WALL] -= counts[:, ON_WALL_BEHIND]
        agreement, num_counted = _agreement(counts)
        columns = [ON_WALL, ON_STRAIGHT_WALL, ON_WALL_BEHIND]
        on_wall, straight, through = counts[:, columns].sum(axis=0).tolist()
        explained = on_wall + UNKNOWN_WEIGHT * (num_points - num_counted)
        if_glass = on_wall + through + UNKNOWN_WEIGHT * (num_points - num_solid)
        return Fit(
            self.score(scans, poses),
            agreement,
            _distinctness(counts),
            num_counted,
            (on_wall - straight) / max(num_counted, 1),
            solid_agreement,
            explained / num_points,
            if_glass / num_points,
        )


def _thin_objects(grid: CellGrid, limits: FitLimits) -> tuple[IntArray, ...]:
    """Return the rows and columns of the cells of thin objects, see :data:`THIN_M`."""
    from scipy import ndimage  # heavy, and needed for localisation only

    square = np.ones((3, 3))
    labels, count = ndimage.label(grid.cells >= limits.wall, structure=square)
    is_floor = (grid.cells > 0) & (grid.cells <= limits.floor)
    is_thin = np.zeros(count + 1, dtype=np.bool_)
    for number, box in enumerate(ndimage.find_objects(labels), 1):
        if max(side.stop - side.start for side in box) > THIN_M / grid.resolution:
            continue
        near = tuple(slice(max(side.start - 2, 0), side.stop + 2) for side in box)
        beside = ndimage.binary_dilation(labels[near] == number, square)
        around = ndimage.binary_dilation(beside, square) & ~beside
        is_thin[number] = is_floor[near][around].mean() >= FREE_SHARE
    return np.nonzero(is_thin[labels])


def _agreement(counts: IntArray) -> tuple[float, int]:
    """Return the share of returns on walls, NaN of none, and the number that is counted."""
    on_wall, on_floor, behind = counts[:, [ON_WALL, ON_FLOOR, BEHIND_WALL]].sum(axis=0).tolist()
    num_counted = on_wall + on_floor + behind
    return on_wall / num_counted if num_counted else math.nan, num_counted


def _is_behind_glass(counts: IntArray, num_counted: int) -> bool:
    """Return whether the returns behind walls are seen through them."""
    if len(counts) < MIN_GLASS_SCANS:
        return False
    behind, on_wall_behind = counts[:, [BEHIND_WALL, ON_WALL_BEHIND]].sum(axis=0).tolist()
    return bool(behind >= GLASS_SHARE * num_counted and on_wall_behind >= GLASS_ON_WALL * behind)


def _distinctness(counts: IntArray) -> float:
    """Return the distinctness that nine of ten scans reach, given what they count."""
    straight = counts[:, ON_STRAIGHT_WALL]
    agreeing = counts[:, ON_WALL] - (1.0 - STRAIGHT_WEIGHT) * straight
    counted = agreeing + counts[:, ON_FLOOR] + counts[:, BEHIND_WALL]
    is_counted = counted >= MIN_DISTINCT
    if not is_counted.any():
        return math.nan
    shares = np.sort(agreeing[is_counted] / counted[is_counted])
    return float(shares[math.floor(LOW_SHARE * len(shares))])
