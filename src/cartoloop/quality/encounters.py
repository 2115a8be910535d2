# SPDX-License-Identifier: Apache-2.0
"""Runs of consecutive nodes that return to a submap, and by how far they are displaced."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from cartoloop.arrays import BoolArray, FloatArray, IntArray
from cartoloop.config import QualityConfig
from cartoloop.kernels.map_agreement import ShiftWindow, best_shifts
from cartoloop.quality.pairs import WALL, MapContent, Pairs, cell_grid, cell_value
from cartoloop.sensor.pose import Pose, transform_points
from cartoloop.sensor.scan_points import ScanPoints
from cartoloop.submaps.finished_grid import FinishedGrid

MAX_ENCOUNTER_M = 4.0
"""Length of a run of nodes that is judged as one [m]: in it poses hardly drift."""

CONTRADICTS = 0.5
"""Share of returns on floor from which an encounter contradicts the map, whatever the reason."""

SUSPECT = 0.1
"""Share from which a better fit elsewhere is searched for: people and doors make half of it."""

STEP_M, TURN_RAD, MAX_TURNS, NEAR_STEPS = 0.1, math.radians(1.5), 3, 2
"""Steps of the search for displacements; those of 0.2 m and less are none."""

MAX_SEARCH_POINTS = 160
"""Returns of an encounter that are searched."""

MIN_GAIN, MIN_FIT = 0.12, 0.5
"""A better fit elsewhere counts if this share of all returns more fits, and this share in all."""


@dataclass(frozen=True)
class Encounters:
    """Returns to a submap, n of them.

    Attributes
    ----------
    first, end : int64 (n,): encounter i is the pairs `first[i]` to `end[i]` of `pairs`.
    pairs : in the order of the encounters.
    length : float64 (n,), path that it stands for [m].
    contradiction : float64 (n,), share of its counted returns that lie on floor.
    displacement : float64 (n,), distance to where it fits better [m], NaN where it does not.
    contradicts : bool (n,).
    """

    first: IntArray
    end: IntArray
    pairs: Pairs
    length: FloatArray
    contradiction: FloatArray
    displacement: FloatArray
    contradicts: BoolArray

    def __len__(self) -> int:
        return len(self.first)

    @cached_property
    def middle(self) -> IntArray:
        """The pair in the middle of each encounter, int64 (n,)."""
        return (self.first + self.end - 1) // 2


def encounters(
    pairs: Pairs, paths: FloatArray, content: MapContent, scans: ScanPoints, config: QualityConfig
) -> Encounters:
    """Return the encounters that pairs make, with their displacements.

    Parameters
    ----------
    pairs : of visits apart.
    paths : float64, path length of each node [m].
    """
    order = np.lexsort((pairs.node, pairs.submap))
    pairs = pairs.take(order)
    first, end = _runs(pairs, paths)
    on_floor = np.add.reduceat(pairs.on_floor, first) if len(first) else np.zeros(0, np.int64)
    on_wall = np.add.reduceat(pairs.on_wall, first) if len(first) else np.zeros(0, np.int64)
    contradiction = on_floor / np.maximum(on_floor + on_wall, 1)
    displacement = np.full(len(first), np.nan)
    suspects = np.argsort(-contradiction, kind="stable")
    suspects = suspects[contradiction[suspects] >= SUSPECT]
    searched = np.sort(_spread(suspects, config.max_searches))
    for submap in np.unique(pairs.submap[first[searched]]).tolist():
        own = searched[pairs.submap[first[searched]] == submap]
        displacement[own] = _displacements(submap, own, first, end, pairs, content, scans, config)
    length = np.array(
        [
            max(abs(paths[pairs.node[j - 1]] - paths[pairs.node[i]]), 0.2)
            for i, j in zip(first.tolist(), end.tolist(), strict=True)
        ]
    )
    contradicts = (contradiction > CONTRADICTS) | np.isfinite(displacement)
    return Encounters(first, end, pairs, length, contradiction, displacement, contradicts)


def _runs(pairs: Pairs, paths: FloatArray) -> tuple[IntArray, IntArray]:
    """Return first and end of runs of pairs of one submap, each along a short path."""
    firsts: list[int] = []
    start, submap = -math.inf, -1
    at = paths[pairs.node].tolist()
    for row, (place, of_submap) in enumerate(zip(at, pairs.submap.tolist(), strict=True)):
        if of_submap != submap or place - start > MAX_ENCOUNTER_M:
            firsts.append(row)
            start, submap = place, of_submap
    first = np.array(firsts, dtype=np.int64)
    return first, np.append(first[1:], len(pairs)).astype(np.int64)[: len(first)]


def _spread(worst_first: IntArray, limit: int) -> IntArray:
    """Return `limit` of the numbers: half of them the worst, the others spread over the rest."""
    if len(worst_first) <= limit:
        return worst_first
    half = limit // 2
    rest = worst_first[half:]
    chosen = rest[np.linspace(0, len(rest) - 1, limit - half).astype(np.int64)]
    return np.concatenate((worst_first[:half], chosen))


def _displacements(
    submap: int,
    rows: IntArray,
    first: IntArray,
    end: IntArray,
    pairs: Pairs,
    content: MapContent,
    scans: ScanPoints,
    config: QualityConfig,
) -> FloatArray:
    """Return by how far encounters with one submap fit better elsewhere; NaN: they do not."""
    groups = []
    for row in rows.tolist():
        own = slice(int(first[row]), int(end[row]))
        points = np.concatenate(
            [
                transform_points(Pose(*pose), _near(scans[node], config.max_range))
                for pose, node in zip(
                    pairs.tf_submap_node[own].tolist(), pairs.node[own].tolist(), strict=True
                )
            ]
        )
        groups.append(points[:: max(1, -(-len(points) // MAX_SEARCH_POINTS))])
    batch = ScanPoints.of(groups)
    grid = content.submap_grids[submap]
    shifts = shifts_in(grid, batch, config.max_displacement)
    here, there = shifts[:, 0] / batch.counts, shifts[:, 1] / batch.counts
    is_better = (there - here > MIN_GAIN) & (there > MIN_FIT)
    return np.where(is_better, np.hypot(shifts[:, 2], shifts[:, 3]), np.nan)


def shifts_in(grid: FinishedGrid, groups: ScanPoints, max_displacement: float) -> FloatArray:
    """Return how groups of points [m, submap frame] fit near and elsewhere, shape (k, 5).

    The columns are those of :func:`cartoloop.kernels.map_agreement.best_shifts`.
    """
    step_cells = max(1, round(STEP_M / grid.resolution))
    steps = round(max_displacement / (step_cells * grid.resolution))
    window = ShiftWindow(steps, step_cells, MAX_TURNS, TURN_RAD, NEAR_STEPS)
    shifts = np.zeros((len(groups), 5))
    best_shifts(
        cell_grid(grid), cell_value(WALL), window, groups.points, groups.firsts, groups.ends, shifts
    )
    return shifts


def _near(points: FloatArray, max_range: float) -> FloatArray:
    kept: FloatArray = points[np.hypot(points[:, 0], points[:, 1]) <= max_range]
    return kept
