# SPDX-License-Identifier: Apache-2.0
"""Which submaps later sessions have superseded, and what fades in those that stay."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cartoloop.arrays import BoolArray, ByteArray, FloatArray, IntArray
from cartoloop.config import LifelongConfig, SubmapConfig
from cartoloop.kernels.fading import clear_inside, copy_unknown, fade_submap
from cartoloop.kernels.map_composition import NEUTRAL
from cartoloop.map_output.evidence_sum import EvidenceSum, cells_covering
from cartoloop.sensor.pose import Pose, relative
from cartoloop.submaps.finished_grid import FinishedGrid

MAX_RECEIVERS = 16
"""What only a removed submap has seen is copied to this many of the nearest later submaps."""


@dataclass(frozen=True, slots=True)
class Selection:
    """What becomes of the submaps of a map.

    Attributes
    ----------
    kept : bool, shape (num_submaps,).
    grids : of all submaps, faded, and with what was copied from those that are removed.
    num_faded : cells that faded in submaps that stay.
    """

    kept: BoolArray
    grids: list[FinishedGrid]
    num_faded: int


def select(
    grids: Sequence[FinishedGrid],
    poses: FloatArray,
    sessions: IntArray,
    submaps: SubmapConfig,
    config: LifelongConfig,
) -> Selection:
    """Return which submaps stay, and the grids of all.

    Sessions are compared from the newest back, each with what later ones have seen: walls where a
    later session has seen floor fade, and so does floor where one has seen walls. A submap of
    which almost all was seen later is removed; what was not is copied to later submaps.

    Parameters
    ----------
    grids : of the submaps.
    poses : float64, shape (m, 3), tf_map_submap of each.
    sessions : int64, shape (m,), of each, ascending; those of the last stay as they are.
    submaps : resolution, and what a hit and a miss weigh.
    config : limits.
    """
    selector = _Selector(grids, poses, submaps, config)
    if len(grids):
        for session in range(int(sessions[-1]), int(sessions[0]) - 1, -1):
            selector.add(np.flatnonzero(sessions == session))
    return Selection(selector.kept, selector.grids, selector.num_faded)


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
        self._max_lost_cells = config.max_lost_wall / submaps.resolution
        odds = math.log(config.min_certainty / (1.0 - config.min_certainty))
        hit = math.log(submaps.hit_probability / (1.0 - submaps.hit_probability))
        miss = math.log((1.0 - submaps.miss_probability) / submaps.miss_probability)
        self._free_below, self._wall_above = -odds, odds * max(1.0, hit / miss)
        self._later: list[int] = []
        seen = [pair for pair in zip(grids, self._poses, strict=True) if pair[0].size]
        place = (
            cells_covering(seen, submaps.resolution, 1) if seen else (np.zeros(2, np.int64), (1, 1))
        )
        self._evidence = EvidenceSum(*place, submaps)

    def add(self, submaps: IntArray) -> None:
        """Decide about the submaps of the session before those added so far."""
        if self._later:
            for index in submaps[::-1].tolist():
                self._decide(index)
        stay = submaps[self.kept[submaps]].tolist()
        for index in stay:
            if self.grids[index].size:
                self._evidence.add(self.grids[index], self._poses[index])
        self._later += stay

    def _decide(self, index: int) -> None:
        grid, pose = self.grids[index], self._poses[index]
        cells = grid.cells
        faded, unseen = np.empty_like(cells), np.empty_like(cells)
        observed, covered = fade_submap(
            cells,
            _cell_to_cell(grid, pose, self._evidence.lower, self._evidence.resolution),
            self._evidence.total,
            self._evidence.known,
            self._free_below,
            self._wall_above,
            faded,
            unseen,
        )
        if covered >= self._min_covered_share * observed and self._copy_rest(grid, pose, unseen):
            self.kept[index] = False
            return
        num_faded = int(np.count_nonzero(cells) - np.count_nonzero(faded))
        if num_faded:
            self.num_faded += num_faded
            self.grids[index] = _like(grid, faded)

    def _copy_rest(self, grid: FinishedGrid, pose: Pose, unseen: ByteArray) -> bool:
        """Copy cells that were not seen later to later submaps; return whether no wall is lost."""
        copies: dict[int, ByteArray] = {}
        additions: list[tuple[FinishedGrid, Pose]] = []
        left = unseen.copy()
        for receiver in self._nearest(pose):
            if not left.any():
                break
            target, target_pose = self.grids[receiver], self._poses[receiver]
            cells = target.cells.copy()
            before = cells.copy()
            affine = _grid_to_grid(target, target_pose, grid, pose)
            if copy_unknown(affine, left, cells):
                copies[receiver] = cells
                additions.append((_like(target, np.where(before == 0, cells, 0)), target_pose))
            clear_inside(_grid_to_grid(grid, pose, target, target_pose), *target.shape, left)
        if np.count_nonzero(left > NEUTRAL) > self._max_lost_cells:
            return False
        for receiver, cells in copies.items():
            self.grids[receiver] = _like(self.grids[receiver], cells)
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


def _like(grid: FinishedGrid, cells: ByteArray) -> FinishedGrid:
    """Return a grid in the same place with other cells."""
    return FinishedGrid(cells, grid.origin_x, grid.origin_y, grid.resolution)
