# SPDX-License-Identifier: Apache-2.0
"""Where visits measure their positions along the path against each other.

Long walls fit anywhere along them. What else the scans of some metres show, doors, corners and
boxes, is compared with the submap of another visit: where it fits at one shift along the path, and
clearly worse at all others, the shift is measured. On right maps it is none.
"""

from __future__ import annotations

import numpy as np

from cartoloop.arrays import BoolArray, FloatArray, IntArray
from cartoloop.kernels.scan_batch import ScanBatch
from cartoloop.kernels.shift_costs import add_shift_costs
from cartoloop.quality.corridor_shifts import MAX_COST_SHARE, MAX_PARALLEL, MIN_POINTS
from cartoloop.quality.encounters import Encounters
from cartoloop.quality.pairs import MapContent
from cartoloop.quality.slides import path_direction
from cartoloop.scan_matching.least_squares import SmoothMap
from cartoloop.sensor.pose import compose_all, relative_all
from cartoloop.sensor.scan_points import ScanPoints
from cartoloop.submaps.finished_grid import MIN_PROBABILITY

REACH_M, STEP_M = 1.2, 0.05
"""Largest shift that is tried, and step [m]."""

SAME_M = 0.2
"""Shifts that differ by less are one, for all that walls of noise and pixels show [m]."""

MORE_NODES, MAX_SCANS = 3, 6
"""Nodes before and after those of an encounter that are used, too, and the scans used in all."""

MAX_EXAMINED = 120
"""Encounters that are examined."""

OTHER_M, SUPPORT_M = 0.5, 8.0
"""A shift of :data:`SAME_M` or more counts if other encounters measure the same, so far from it
along the paths of both visits at least and at most [m], and are not outnumbered by those there that
measure another one: doors that look alike fit to each other once, or from one side only, and
submaps that overlap show the same scans."""


def shifts_along(
    met: Encounters, content: MapContent, scans: ScanPoints, paths: FloatArray
) -> FloatArray:
    """Return by how much encounters fit better along the path, shape (n, 2) [m, map frame].

    About 0 where the visits agree; NaN where that is not measured, or was not examined.

    Parameters
    ----------
    met : encounters of visits, n of them.
    content : the map.
    scans : the returns of its nodes.
    paths : path length of each node [m].
    """
    count = round(REACH_M / STEP_M)
    tried: FloatArray = STEP_M * np.arange(-count, count + 1, dtype=np.float64)
    found = np.full((len(met), 2), np.nan)
    rows = examined(len(met))
    submaps = met.pairs.submap[met.first[rows]]
    for submap in np.unique(submaps).tolist():
        grid = content.submap_grids[submap]
        smooth = SmoothMap(grid.probabilities(), grid.origin_x, grid.origin_y, grid.resolution)
        for row in rows[submaps == submap].tolist():
            along = path_direction(met, row, content)
            costs = _costs(met, row, along, tried, smooth, content, scans)
            found[row] = _in_map(met, row, _fitting_shift(costs, tried) * along, content)
    found[~are_supported(found, paths[met_nodes(met)])] = np.nan
    return found


def examined(num_encounters: int) -> IntArray:
    """Return which of some encounters are examined."""
    count = min(num_encounters, MAX_EXAMINED)
    return np.unique(np.linspace(0, num_encounters - 1, count).astype(np.int64))


def _in_map(met: Encounters, row: int, vector: FloatArray, content: MapContent) -> FloatArray:
    """Return a vector of the frame of the submap that an encounter meets, shape (2,), map frame."""
    middle = int(met.middle[row])
    node, theta = int(met.pairs.node[middle]), met.pairs.tf_submap_node[middle, 2]
    turn = content.graph.node_poses[node, 2] - theta
    cos, sin = np.cos(turn), np.sin(turn)
    return np.array((cos * vector[0] - sin * vector[1], sin * vector[0] + cos * vector[1]))


def are_here(shifts: FloatArray) -> BoolArray:
    """Return which encounters are measured to agree along the path, shape (n,)."""
    here: BoolArray = np.hypot(shifts[:, 0], shifts[:, 1]) < SAME_M + 0.5 * STEP_M
    return here


def nodes_here(met: Encounters, shifts: FloatArray, num_nodes: int) -> BoolArray:
    """Return which nodes are in encounters that are measured to agree, or met, shape (n,)."""
    return nodes_between(met, np.flatnonzero(are_here(shifts)), num_nodes)


def nodes_between(met: Encounters, rows: IntArray, num_nodes: int) -> BoolArray:
    """Return which nodes are in some encounters, or met, or between such nodes, shape (n,)."""
    found = np.zeros(num_nodes, dtype=np.bool_)
    for row in rows.tolist():
        own = slice(int(met.first[row]), int(met.end[row]))
        for nodes in (met.pairs.node[own], met.pairs.own_node[own]):
            found[int(nodes.min()) : int(nodes.max()) + 1] = True
    return found


def met_nodes(met: Encounters) -> IntArray:
    """Return the node in the middle of each encounter and the one that it meets, shape (n, 2)."""
    return np.column_stack((met.pairs.node[met.middle], met.pairs.own_node[met.middle]))


def _costs(
    met: Encounters,
    row: int,
    along: FloatArray,
    shifts: FloatArray,
    smooth: SmoothMap,
    content: MapContent,
    scans: ScanPoints,
) -> FloatArray:
    """Return what shifts of an encounter along the path cost, without walls along it.

    All NaN where too few returns are off such walls.
    """
    own = slice(int(met.first[row]), int(met.end[row]))
    middle = int(met.middle[row])
    poses, nodes = content.graph.node_poses, met.pairs.node[own]
    first, end = max(int(nodes.min()) - MORE_NODES, 0), int(nodes.max()) + MORE_NODES + 1
    chosen = np.arange(first, min(end, len(poses)))
    chosen = chosen[:: -(-len(chosen) // MAX_SCANS)]
    steps = relative_all(poses[met.pairs.node[middle]], poses[chosen])
    batch = scans.take(chosen)
    costs, counts = np.zeros((1, len(shifts))), np.zeros(1, dtype=np.int64)
    add_shift_costs(
        smooth,
        MIN_PROBABILITY,
        ScanBatch(batch.points, batch.firsts, batch.ends),
        np.ascontiguousarray(compose_all(met.pairs.tf_submap_node[middle], steps)),
        np.zeros(len(chosen), dtype=np.int64),
        np.ascontiguousarray(along[np.newaxis]),
        shifts,
        MAX_PARALLEL,
        costs,
        counts,
    )
    return costs[0] if counts[0] >= MIN_POINTS else np.full(len(shifts), np.nan)


def _fitting_shift(costs: FloatArray, shifts: FloatArray) -> float:
    """Return the shift that costs clearly less than all others; NaN where there is none.

    Shifts at the ends of those tried may be the slope of a larger one.
    """
    if np.isnan(costs[0]):
        return float("nan")
    best = int(costs.argmin())
    elsewhere = np.abs(shifts - shifts[best]) > SAME_M + 0.5 * STEP_M
    is_clear = costs[best] < MAX_COST_SHARE * costs[elsewhere].min()
    is_inside = abs(shifts[best]) <= REACH_M - SAME_M
    return float(shifts[best]) if is_clear and is_inside else float("nan")


def are_supported(shifts: FloatArray, at: FloatArray) -> BoolArray:
    """Return which shifts are small, or measured by other encounters nearby, too, shape (n,).

    Parameters
    ----------
    shifts : shape (n, 2) [m].
    at : path lengths of both nodes of each encounter, shape (n, 2) [m].
    """
    supported: BoolArray = np.hypot(shifts[:, 0], shifts[:, 1]) <= SAME_M
    is_known = np.isfinite(shifts[:, 0])
    # The other visit may be the one that meets, and then its shift is the opposite one.
    for row in np.flatnonzero(np.hypot(shifts[:, 0], shifts[:, 1]) > SAME_M).tolist():
        num_same = num_other = 0
        for others, sign in ((at, -1.0), (at[:, ::-1], 1.0)):
            away = np.abs(others - at[row]).max(axis=1)
            is_near = is_known & (away > OTHER_M) & (away < SUPPORT_M)
            apart = shifts[is_near] + sign * shifts[row]
            is_same = np.hypot(apart[:, 0], apart[:, 1]) < SAME_M
            num_same += int(is_same.sum())
            num_other += int((~is_same).sum())
        supported[row] = num_same > 0 and num_same >= num_other
    return supported
