# SPDX-License-Identifier: Apache-2.0
"""Which submaps later sessions have superseded, and what fades in those that stay."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cartoloop.arrays import BoolArray, ByteArray, FloatArray, IntArray
from cartoloop.config import LifelongConfig, SubmapConfig
from cartoloop.kernels.fading import clear_inside, fade_submap, hand_over, review_walls
from cartoloop.kernels.map_composition import NEUTRAL
from cartoloop.map_output.evidence_sum import EvidenceSum, cell_log_odds, cells_covering
from cartoloop.sensor.pose import Pose, relative
from cartoloop.submaps.finished_grid import FinishedGrid

MAX_RECEIVERS = 16
"""What a removed submap knows better is handed over to this many of the nearest later submaps."""

SURE = 0.82
"""Probability that a cell is free, or a wall, from which no more evidence is needed: it is drawn as
such."""

BESIDE_M = 0.1
"""What is at most this far from a wall is at the wall, since poses err by a cell [m]."""

MIN_THROUGH, BEHIND_FEW_M = 1.5, 0.2
"""A wall fades, too, where later sessions show floor by less evidence than `min_certainty`, as by a
look through a door: where they saw no wall beside it, but floor this far off on both sides [m], and
more than this number of beams passed through the walls of the submap beside it, all together."""

BEHIND_MANY_M = 0.4
"""A wall that has no later one beside it does not fade, however many beams saw floor there, if they
saw none this far off on both sides [m]: beams along a corridor whose heading errs pass behind the
wall of an older session, and hit little of it."""


@dataclass(frozen=True, slots=True)
class Selection:
    """What becomes of the submaps of a map.

    Attributes
    ----------
    kept : bool, shape (num_submaps,).
    grids : of all submaps, faded, and with what those that are removed have handed over.
    num_faded : cells that faded in submaps that stay.
    """

    kept: BoolArray
    grids: list[FinishedGrid]
    num_faded: int


def select(
    grids: Sequence[FinishedGrid],
    poses: FloatArray,
    sessions: IntArray,
    is_driven_again: BoolArray,
    submaps: SubmapConfig,
    config: LifelongConfig,
) -> Selection:
    """Return which submaps stay, and the grids of all.

    Sessions are compared from the newest back, each with what later ones have seen: walls where a
    later session has seen floor on both sides fade, also by a few beams, and so does floor where
    one has seen walls. A submap that was driven through again, and was seen almost as a whole, is
    removed. What later sessions have not seen, or had a glance at only, as with a few beams from
    afar, is handed over to their submaps.

    Parameters
    ----------
    grids : of the submaps.
    poses : float64, shape (m, 3), tf_map_submap of each.
    sessions : int64, shape (m,), of each, ascending; those of the last stay, and take evidence.
    is_driven_again : bool, shape (m,), whether later sessions drove through each; others stay.
    submaps : resolution, and what a hit and a miss weigh.
    config : limits.
    """
    selector = _Selector(grids, poses, submaps, config)
    if len(grids):
        for session in range(int(sessions[-1]), int(sessions[0]) - 1, -1):
            selector.add(np.flatnonzero(sessions == session), is_driven_again)
    return Selection(selector.kept, selector.grids, selector.num_faded)


class _Compared(NamedTuple):
    """A submap beside what later sessions have seen.

    Attributes
    ----------
    observed, covered : number of cells that it has seen, and of those that were seen later.
    faded, left : its cells without what was contradicted, and those about which later sessions are
        not sure.
    """

    observed: int
    covered: int
    faded: ByteArray
    left: ByteArray


class _Selector:
    """Compares session after session with those that came later."""

    def __init__(
        self,
        grids: Sequence[FinishedGrid],
        poses: FloatArray,
        submaps: SubmapConfig,
        config: LifelongConfig,
    ) -> None:
        self.grids = list(grids)
        self.kept: BoolArray = np.ones(len(grids), dtype=bool)
        self.num_faded = 0
        self._poses = [Pose(*pose) for pose in poses.tolist()]
        self._min_covered_share = config.min_covered_share
        self._max_lost_wall_cells = config.max_lost_wall / submaps.resolution
        self._max_growth_cells = math.ceil(config.max_growth / submaps.resolution)
        odds = math.log(config.min_certainty / (1.0 - config.min_certainty))
        hit = math.log(submaps.hit_probability / (1.0 - submaps.hit_probability))
        miss = math.log((1.0 - submaps.miss_probability) / submaps.miss_probability)
        wall_weight = max(1.0, hit / miss)
        self._free_below, self._wall_above = -odds, odds * wall_weight
        self._few_below = -MIN_THROUGH * miss
        self._beside, self._behind_few, self._behind_many = (
            round(length / submaps.resolution) for length in (BESIDE_M, BEHIND_FEW_M, BEHIND_MANY_M)
        )
        sure = math.log(SURE / (1.0 - SURE))
        self._sure_free, self._sure_wall = -sure, sure * wall_weight
        self._sums = _sums_of_evidence(cell_log_odds(submaps))
        self._max_lost_floor_cells = config.max_lost_floor / submaps.resolution**2
        self._later: list[int] = []
        seen = [pair for pair in zip(grids, self._poses, strict=True) if pair[0].size]
        place = (
            cells_covering(seen, submaps.resolution, 1) if seen else (np.zeros(2, np.int64), (1, 1))
        )
        self._evidence = EvidenceSum(*place, submaps)

    def add(self, submaps: IntArray, may_go: BoolArray) -> None:
        """Decide about the submaps of the session before those added so far."""
        older = submaps[::-1] if self._later else submaps[:0]
        waiting = older[may_go[older]].tolist()
        is_final = False
        while not is_final:
            # What one of them has handed over may be all that another one was needed for.
            removed = {index for index in waiting if self._is_superseded(index)}
            is_final = not removed
            waiting = [index for index in waiting if index not in removed]
        for index in older[self.kept[older]].tolist():
            self._fade(index)
        stay = submaps[self.kept[submaps]].tolist()
        for index in stay:
            if self.grids[index].size:
                self._evidence.add(self.grids[index], self._poses[index])
        self._later += stay

    def _is_superseded(self, index: int) -> bool:
        """Return whether a submap is not needed any more; if so, hand over what it knows better."""
        compared = self._compared(index)
        enough = self._min_covered_share * compared.observed
        if compared.covered < enough or not self._hand_over(
            self.grids[index], self._poses[index], compared.left
        ):
            return False
        self.kept[index] = False
        return True

    def _fade(self, index: int) -> None:
        """Fade what later sessions contradict in a submap that stays."""
        cells, faded = self.grids[index].cells, self._compared(index).faded
        num_faded = int(np.count_nonzero(cells) - np.count_nonzero(faded))
        if num_faded:
            self.num_faded += num_faded
            self.grids[index] = _like(self.grids[index], faded)

    def _compared(self, index: int) -> _Compared:
        """Compare a submap with what is known by later sessions."""
        grid, pose = self.grids[index], self._poses[index]
        cells = grid.cells
        faded, left = np.empty_like(cells), np.empty_like(cells)
        evidence = self._evidence
        affine = _cell_to_cell(grid, pose, evidence.lower, evidence.resolution)
        observed, covered = fade_submap(
            cells,
            affine,
            evidence.total,
            evidence.known,
            self._free_below,
            self._wall_above,
            self._sure_free,
            self._sure_wall,
            faded,
            left,
        )
        review_walls(
            cells,
            affine,
            evidence.total,
            self._few_below,
            self._beside,
            self._behind_few,
            self._behind_many,
            faded,
            left,
        )
        return _Compared(observed, covered, faded, left)

    def _hand_over(self, grid: FinishedGrid, pose: Pose, left: ByteArray) -> bool:
        """Add the evidence in some cells to later submaps; return whether nothing is lost."""
        changed: dict[int, FinishedGrid] = {}
        additions: list[tuple[FinishedGrid, Pose]] = []
        left, receivers = left.copy(), self._nearest(pose)
        for growth in (0, self._max_growth_cells):
            for receiver in receivers:
                if not left.any():
                    break
                before = _grown(changed.get(receiver, self.grids[receiver]), growth)
                cells, target_pose = before.cells.copy(), self._poses[receiver]
                affine, taken = _grid_to_grid(before, target_pose, grid, pose), np.empty_like(cells)
                if hand_over(affine, left, self._sums, cells, taken):
                    after = _like(before, cells)
                    changed[receiver] = _cropped(after) if growth else after
                    additions.append((_like(before, taken), target_pose))
                clear_inside(_grid_to_grid(grid, pose, before, target_pose), *before.shape, left)
        num_walls = np.count_nonzero(left > NEUTRAL)
        if (
            num_walls > self._max_lost_wall_cells
            or np.count_nonzero(left) - num_walls > self._max_lost_floor_cells
        ):
            return False
        self.grids = [changed.get(index, old) for index, old in enumerate(self.grids)]
        for addition in additions:
            self._evidence.add(*addition)
        return True

    def _nearest(self, pose: Pose) -> list[int]:
        """Return later submaps whose grids overlap, those with the nearest middles first."""
        apart = {
            other: _distance_to_middle(self.grids[other], relative(self._poses[other], pose))
            for other in self._later
            if self.grids[other].size
        }
        return sorted(apart, key=lambda other: (apart[other], other))[:MAX_RECEIVERS]


def _sums_of_evidence(log_odds: NDArray[np.float32]) -> ByteArray:
    """Return the value of a cell with the evidence of two, uint8, shape (256, 256).

    Parameters
    ----------
    log_odds : shape (256,), of each value.
    """
    known = log_odds[1:].astype(np.float64)
    middles = 0.5 * (known[1:] + known[:-1])
    values = np.arange(256)
    evidence = log_odds.astype(np.float64)
    sums = np.searchsorted(middles, evidence[:, np.newaxis] + evidence) + 1
    sums[0], sums[:, 0] = values, values
    return sums.astype(np.uint8)


def _distance_to_middle(grid: FinishedGrid, place: Pose) -> float:
    """Return how far a place in a submap's frame is from the middle of its grid [m]."""
    num_rows, num_cols = grid.shape
    middle_x = grid.origin_x + (num_cols - 1) * grid.resolution / 2
    middle_y = grid.origin_y + (num_rows - 1) * grid.resolution / 2
    return math.hypot(place.x - middle_x, place.y - middle_y)


def _cell_to_cell(
    grid: FinishedGrid, pose: Pose, lower: IntArray | FloatArray, resolution: float
) -> FloatArray:
    """Return the transform from a submap's cells to those of a lattice, as kernels take it.

    Parameters
    ----------
    grid : of the submap.
    pose : of the submap in the frame of the lattice.
    lower : column and row where the lattice's cell (0, 0) begins, from its frame's origin [cells].
    resolution : edge of a cell of the lattice [m].
    """
    cos, sin = math.cos(pose.theta), math.sin(pose.theta)
    x = pose.x + cos * grid.origin_x - sin * grid.origin_y
    y = pose.y + sin * grid.origin_x + cos * grid.origin_y
    scale = grid.resolution / resolution
    return np.array(
        (
            x / resolution - float(lower[0]), scale * cos, -scale * sin,
            y / resolution - float(lower[1]), scale * sin, scale * cos,
        )
    )  # fmt: skip


def _grid_to_grid(
    grid: FinishedGrid, pose: Pose, other: FinishedGrid, other_pose: Pose
) -> FloatArray:
    """Return the transform from a submap's cells to those of another, as kernels take it."""
    lower = np.array((other.origin_x, other.origin_y)) / other.resolution - 0.5
    return _cell_to_cell(grid, relative(other_pose, pose), lower, other.resolution)


def _grown(grid: FinishedGrid, by: int) -> FinishedGrid:
    """Return a grid with `by` more rows and columns of unknown cells on each side."""
    if by == 0:
        return grid
    origin_x, origin_y = (o - by * grid.resolution for o in (grid.origin_x, grid.origin_y))
    return FinishedGrid(np.pad(grid.cells, by), origin_x, origin_y, grid.resolution)


def _cropped(grid: FinishedGrid) -> FinishedGrid:
    """Return a grid without the rows and columns around it in which nothing is known."""
    cells = grid.cells
    rows, cols = (np.flatnonzero((cells != 0).any(axis=axis)) for axis in (1, 0))
    first_row, first_col = int(rows[0]), int(cols[0])
    return FinishedGrid(
        np.ascontiguousarray(cells[first_row : rows[-1] + 1, first_col : cols[-1] + 1]),
        grid.origin_x + first_col * grid.resolution,
        grid.origin_y + first_row * grid.resolution,
        grid.resolution,
    )


def _like(grid: FinishedGrid, cells: ByteArray) -> FinishedGrid:
    """Return a grid in the same place with other cells."""
    return FinishedGrid(cells, grid.origin_x, grid.origin_y, grid.resolution)
