# SPDX-License-Identifier: Apache-2.0
"""Visits that are displaced along the path against each other, as along a corridor.

Long walls fit wherever a scan is along them. What is left, doors, corners and boxes, is few
returns: too few for a contradiction, but all of them fit in one other place.
"""

from __future__ import annotations

import numpy as np

from cartoloop.arrays import BoolArray, FloatArray, IntArray
from cartoloop.config import QualityConfig
from cartoloop.kernels.map_agreement import CellGrid, count_along
from cartoloop.quality.encounters import Encounters
from cartoloop.quality.pairs import WALL, MapContent, cell_grid, cell_value
from cartoloop.sensor.pose import Pose, transform_points
from cartoloop.sensor.scan_points import ScanPoints

REACHES_M, STEP_M = (5.0, 8.0), 0.1
"""Displacements that are tried [m]: far ones are rarer, and more of them fit by chance."""

LEAST_SHARES = (0.05, 0.15)
"""For each of these, the share of the encounters examined that must be displaced alike."""

HERE_M, AWAY_M, EDGE_M = 0.2, 0.3, 0.3
"""A displacement up to the first is none, one above the second counts; one as near to the end of
those tried as the third may be the slope of a larger one [m]."""

MIN_RETURNS, MIN_SHARE, LEFT_HERE = 12, 0.05, 0.35
"""Returns that fit elsewhere beyond what long walls explain: this number, and this share of all;
here, no more than this share of them fits."""

NEAR_KNOWN_M = 0.5
"""Returns farther from all that a submap has observed say nothing of it [m]: where a part of it was
forgotten, doors would fit at other doors only."""

MAX_EXAMINED, MAX_POINTS = 200, 400
"""Encounters that are examined, and returns of each."""

NEARBY_M, MOST_HERE = 4.0, 1.8
"""Encounters as near to each other are in one place [m]: those there that fit where they are must
not outnumber the displaced ones by more than this factor."""

MIN_AGREEING, TIMES_CHANCE, SPREAD_M = 4, 3.0, 0.4
"""This number of encounters is displaced by the same distance, within the last [m]; and more than
if displacements were random by this factor."""


def slides(
    met: Encounters,
    content: MapContent,
    scans: ScanPoints,
    config: QualityConfig,
    is_here: BoolArray,
) -> FloatArray:
    """Return by how far encounters fit better along the path, shape (n,) [m]: those that agree.

    Not negative; NaN for all others.

    Parameters
    ----------
    met : encounters of visits.
    content : the map.
    scans : the returns of its nodes.
    config : limits.
    is_here : bool (n,), encounters whose positions along the path were measured more closely, and
        are right: rows of doors alike fit elsewhere, too.
    """
    found = np.full((len(REACHES_M), len(met)), np.nan)
    if len(met) == 0:
        return np.zeros(0)
    chosen = np.unique(np.linspace(0, len(met) - 1, num_examined(len(met))).astype(np.int64))
    submaps = met.pairs.submap[met.first[chosen]]
    count = round(max(REACHES_M) / STEP_M)
    shifts: FloatArray = STEP_M * np.arange(-count, count + 1, dtype=np.float64)
    for submap in np.unique(submaps).tolist():
        rows = chosen[submaps == submap]
        grid = cell_grid(content.submap_grids[submap])
        groups = [
            near_known(_points(met, row, scans, config.max_range), grid) for row in rows.tolist()
        ]
        directions = np.array([path_direction(met, row, content) for row in rows.tolist()])
        batch = ScanPoints.of(groups)
        counts = fits_along(grid, batch, directions, shifts)
        for reach, displaced in zip(REACHES_M, found, strict=True):
            tried = np.abs(shifts) < reach + 0.5 * STEP_M
            displaced[rows] = _displaced(counts[:, tried], batch.counts, shifts[tried])
    places = content.graph.node_poses[met.pairs.node[met.first], :2]
    for reach, share, displaced in zip(REACHES_M, LEAST_SHARES, found, strict=True):
        displaced[is_here] = 0.0
        same = agreeing(displaced, reach, share)
        if same.any() and _num_here(displaced, places, same) > MOST_HERE * same.sum():
            same[:] = False
        displaced[~same] = np.nan
    most: FloatArray = found[np.isfinite(found).sum(axis=1).argmax()]
    return most


def fits_along(
    grid: CellGrid, batch: ScanPoints, directions: FloatArray, shifts: FloatArray
) -> IntArray:
    """Return how many returns of each group lie on walls of a grid after each shift, shape (n, m).

    Parameters
    ----------
    batch : n groups of returns, frame of the submap [m].
    directions : of the shifts, unit vectors, shape (n, 2).
    shifts : shape (m,) [m].
    """
    counts = np.zeros((len(directions), len(shifts)), dtype=np.int64)
    count_along(
        grid,
        cell_value(WALL),
        batch.points,
        batch.firsts,
        batch.ends,
        directions,
        shifts,
        counts,
    )
    return counts


def num_examined(num_encounters: int) -> int:
    """Return how many of some encounters are examined."""
    return min(num_encounters, MAX_EXAMINED)


def agreeing(displacements: FloatArray, reach: float, least_share: float) -> BoolArray:
    """Return which displacements are the same, the largest such set, if there are enough.

    Parameters
    ----------
    displacements : shape (n,), 0 or NaN where there is none [m].
    reach : largest one that was tried [m].
    least_share : of the encounters examined.
    """
    is_displaced = displacements > 0.0
    order = np.argsort(np.where(is_displaced, displacements, np.inf), kind="stable")
    values = displacements[order][: int(is_displaced.sum())]
    ends = np.searchsorted(values, values + SPREAD_M, side="right")
    counts = ends - np.arange(len(values))
    same = np.zeros(len(displacements), dtype=np.bool_)
    by_chance = len(values) * SPREAD_M / (reach - EDGE_M - AWAY_M)
    least = max(MIN_AGREEING, least_share * num_examined(len(same)), TIMES_CHANCE * by_chance)
    if len(values) and counts.max() >= least:
        best = int(counts.argmax())
        same[order[best : ends[best]]] = True
    return same


def _num_here(displaced: FloatArray, places: FloatArray, same: BoolArray) -> int:
    """Return how many encounters near those that agree fit where they are.

    Parameters
    ----------
    displaced : shape (n,), 0 where features fit here [m].
    places : shape (n, 2), of the encounters [m, map frame].
    same : bool (n,), those that agree.
    """
    here = places[displaced == 0.0]
    apart = here[:, np.newaxis] - places[same]
    near = np.einsum("ijk,ijk->ij", apart, apart).min(axis=1, initial=np.inf) < NEARBY_M**2
    return int(near.sum())


def _displaced(counts: IntArray, num_points: IntArray, shifts: FloatArray) -> FloatArray:
    """Return the distance at which features fit, 0 for here, NaN where they fit nowhere."""
    walls = np.median(counts, axis=1)
    is_far = np.abs(shifts) > AWAY_M - 0.5 * STEP_M
    here = counts[:, np.abs(shifts) < HERE_M + 0.5 * STEP_M].max(axis=1) - walls
    best = np.where(is_far, counts, -1).argmax(axis=1)
    there = counts[np.arange(len(counts)), best] - walls
    least = np.maximum(MIN_RETURNS, MIN_SHARE * num_points)
    distance = np.abs(shifts[best])
    is_displaced = (there >= least) & (here < LEFT_HERE * there) & (distance <= shifts[-1] - EDGE_M)
    fits_here = (here >= least) & (here >= LEFT_HERE * there)
    return np.where(is_displaced, distance, np.where(fits_here, 0.0, np.nan))


def _points(met: Encounters, row: int, scans: ScanPoints, max_range: float) -> FloatArray:
    """Return the returns of an encounter [m, submap frame]."""
    own = slice(int(met.first[row]), int(met.end[row]))
    poses, nodes = met.pairs.tf_submap_node[own].tolist(), met.pairs.node[own].tolist()
    points = np.concatenate(
        [
            transform_points(Pose(*pose), scans[node])
            for pose, node in zip(poses, nodes, strict=True)
        ]
    )
    middle = met.pairs.tf_submap_node[own, :2].mean(axis=0)
    near: FloatArray = points[np.hypot(*(points - middle).T) <= max_range]
    return near[:: max(1, -(-len(near) // MAX_POINTS))]


def near_known(points: FloatArray, grid: CellGrid) -> FloatArray:
    """Return the points near what a submap has observed, submap frame."""
    cells = grid.cells
    is_near = np.zeros(len(points), dtype=np.bool_)
    for aside in NEAR_KNOWN_M * np.array(((0, 0), (1, 0), (-1, 0), (0, 1), (0, -1))):
        at = (points + aside - (grid.origin_x, grid.origin_y)) / grid.resolution + 0.5
        col, row = np.floor(at).astype(np.int64).T
        inside = (row >= 0) & (row < cells.shape[0]) & (col >= 0) & (col < cells.shape[1])
        is_near[inside] |= cells[row[inside], col[inside]] != 0
    near: FloatArray = points[is_near]
    return near


def path_direction(met: Encounters, row: int, content: MapContent) -> FloatArray:
    """Return the unit vector of the path at an encounter, frame of its submap, shape (2,)."""
    pair = int(met.middle[row])
    node, theta = int(met.pairs.node[pair]), met.pairs.tf_submap_node[pair, 2]
    poses = content.graph.node_poses
    before, after = poses[max(node - 2, 0)], poses[min(node + 2, len(poses) - 1)]
    angle = np.arctan2(after[1] - before[1], after[0] - before[0]) - poses[node, 2] + theta
    return np.array((np.cos(angle), np.sin(angle)))
