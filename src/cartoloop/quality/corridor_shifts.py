# SPDX-License-Identifier: Apache-2.0
"""Visits that are displaced by some decimetres along a corridor.

Along a corridor few returns determine the position: those at door frames, corners and boxes. Where
two visits are apart there, each scan is held by the long walls and by what it meets by chance, and
its match is called good. But the returns of several scans in turn, without those of walls along the
corridor, fit clearly better in one other place.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cartoloop.arrays import BoolArray, FloatArray, IntArray
from cartoloop.global_slam.pose_graph import ConstraintKind, PoseGraph
from cartoloop.kernels.scan_batch import ScanBatch
from cartoloop.kernels.shift_costs import add_shift_costs
from cartoloop.quality.clusters import clusters
from cartoloop.quality.pairs import MapContent
from cartoloop.quality.places import MAX_PLACES, extent, place_around, stamps_of
from cartoloop.quality.verdict import Kind, Place, Severity
from cartoloop.scan_matching.least_squares import SmoothMap
from cartoloop.sensor.scan_points import ScanPoints
from cartoloop.session import session_numbers
from cartoloop.submaps.finished_grid import MIN_PROBABILITY, FinishedGrid

MAX_GAP, RUN_NODES, MIN_RUN_NODES = 8, 12, 4
"""Largest difference of the numbers of nodes that follow each other in a visit, and about how many
matches in turn are looked at together, at least."""

MAX_RUNS = 300
"""Runs that are examined."""

MAX_INFORMATION_SHARE = 0.3
"""Information of matches along a corridor, as a share of that across it, at most."""

MAX_PARALLEL = 0.87
"""Cosine of twice the angle to the corridor from which a wall is along it: 15 degrees."""

MIN_POINTS = 40
"""Returns that a run must have off such walls."""

REACH_M, STEP_M = 1.0, 0.05
"""Largest shift that is tried, and step [m]."""

HERE_M, EDGE_M = 0.1, 0.1
"""Shifts that are none, and how near to the largest one a minimum may be a slope [m]."""

MAX_COST_SHARE = 0.9
"""Cost at a shift, as a share of that here, from which a run is displaced."""

MIN_MEDIAN_M = 0.25
"""Median shift of displaced runs [m]: below, walls lie within each other's thickness."""

LONG_M = 12.0
"""A place that is as long makes the map doubtful [m], as where walls stand twice."""

LIMITS = ((4, 0.1), (8, 0.07))
"""Numbers of displaced runs, and their shares of all: one pair is enough. Where visits agree,
hardly any run is displaced."""


class Runs(NamedTuple):
    """Matches in turn that show little of the position along a corridor.

    Attributes
    ----------
    nodes : of each run.
    shift : float64, shape (n,), by how far each fits better along the corridor [m]; 0: here.
    """

    nodes: list[IntArray]
    shift: FloatArray


def shifted_places(content: MapContent, scans: ScanPoints) -> list[Place]:
    """Return where visits are displaced along corridors, if many are."""
    firsts = [session.first_node for session in content.sessions]
    sessions = session_numbers(firsts, content.graph.num_nodes)
    runs = corridor_runs(content.graph, sessions, content.submap_grids, scans)
    shifted = np.flatnonzero(runs.shift)
    num_shifted, apart = len(shifted), np.abs(runs.shift[shifted])
    is_enough = any(
        num_shifted >= number and num_shifted >= share * len(runs.shift) for number, share in LIMITS
    )
    if not is_enough or np.median(apart) < MIN_MEDIAN_M:
        return []
    middles = np.array([nodes[len(nodes) // 2] for nodes in (runs.nodes[run] for run in shifted)])
    groups = clusters(content.graph.node_poses[middles, :2])
    places = [
        _place(
            np.unique(np.concatenate([runs.nodes[run] for run in shifted[members].tolist()])),
            float(np.median(apart[members])),
            content,
        )
        for members in groups
    ]
    return sorted(places, key=lambda place: -place.radius)[:MAX_PLACES]


def _place(nodes: IntArray, apart: float, content: MapContent) -> Place:
    """Return the place of nodes displaced by so much [m]; a minor one if it is short."""
    points = content.graph.node_poses[nodes, :2]
    length = extent(points)
    return place_around(
        points,
        stamps_of(content, nodes),
        Kind.CONTRADICTION,
        Severity.DOUBTFUL if length >= LONG_M else Severity.MINOR,
        f"visits are displaced along a corridor by {apart:.1f} m: doors and corners fit there, "
        f"along {length:.0f} m",
        "the distance along bare walls was measured wrongly: `cartoloop doctor` examines "
        "the odometry; drive through the place once more",
    )


def corridor_runs(
    graph: PoseGraph, sessions: IntArray, grids: list[FinishedGrid], scans: ScanPoints
) -> Runs:
    """Return the runs of loop closures in corridors, and by how far each is displaced.

    Parameters
    ----------
    graph : its loop closures are the matches.
    sessions : int64, number of the session of each node.
    grids : of all submaps.
    scans : the returns of all nodes.
    """
    closures = np.flatnonzero(graph.kinds == ConstraintKind.LOOP_CLOSURE)
    submaps, nodes = graph.index_a[closures], graph.index_b[closures]
    order = np.lexsort((nodes, submaps))
    closures, submaps, nodes = closures[order], submaps[order], nodes[order]
    runs = _runs(submaps, nodes, sessions[nodes])
    chosen, directions = _corridors(graph.informations[closures], runs)
    of_run = np.full(int(runs[-1]) + 1 if len(runs) else 0, -1)
    of_run[chosen] = np.arange(len(chosen))
    rows = np.flatnonzero(of_run[runs] >= 0)
    shift, is_examined = np.zeros(len(chosen)), np.zeros(len(chosen), dtype=bool)
    for submap in np.unique(submaps[rows]).tolist():
        own = rows[submaps[rows] == submap]
        first, last = int(of_run[runs[own[0]]]), int(of_run[runs[own[-1]]]) + 1
        shift[first:last], is_examined[first:last] = fitting_shifts(
            grids[submap],
            scans.take(nodes[own]),
            graph.relative_poses[closures[own]],
            of_run[runs[own]] - first,
            directions[first:last],
        )
    members = [nodes[rows[of_run[runs[rows]] == run]] for run in np.flatnonzero(is_examined)]
    return Runs(members, shift[is_examined])


def _runs(submaps: IntArray, nodes: IntArray, sessions: IntArray) -> IntArray:
    """Return the number of the run that each match belongs to, ascending."""
    if len(nodes) == 0:
        return np.zeros(0, dtype=np.int64)
    begins = (np.diff(submaps) != 0) | (np.diff(nodes) > MAX_GAP) | (np.diff(sessions) != 0)
    visits = np.concatenate(([0], np.cumsum(begins)))
    counts = np.bincount(visits)
    within = np.arange(len(nodes)) - (np.cumsum(counts) - counts)[visits]
    parts = np.maximum(1, counts // RUN_NODES)
    runs: IntArray = (np.cumsum(parts) - parts)[visits] + within * parts[visits] // counts[visits]
    return runs


def _corridors(informations: FloatArray, runs: IntArray) -> tuple[IntArray, FloatArray]:
    """Return the runs in corridors that are examined, and their directions, shape (n, 2)."""
    num_runs = int(runs[-1]) + 1 if len(runs) else 0
    total = np.zeros((num_runs, 2, 2))
    np.add.at(total, runs, informations[:, :2, :2])
    values, vectors = np.linalg.eigh(total)
    is_corridor = (np.bincount(runs, minlength=num_runs) >= MIN_RUN_NODES) & (
        values[:, 0] <= MAX_INFORMATION_SHARE * values[:, 1]
    )
    chosen = np.flatnonzero(is_corridor)
    chosen = chosen[:: -(-len(chosen) // MAX_RUNS) or 1]
    return chosen, np.ascontiguousarray(vectors[chosen, :, 0])


def fitting_shifts(
    grid: FinishedGrid, scans: ScanPoints, poses: FloatArray, runs: IntArray, directions: FloatArray
) -> tuple[FloatArray, BoolArray]:
    """Return by how far each run fits better along a direction, and whether it shows enough to say.

    Parameters
    ----------
    grid : of the submap.
    scans, poses, runs : the returns of k scans, their poses in it, shape (k, 3), and their runs.
    directions : of each run, unit vectors, submap axes, shape (n, 2).

    Returns
    -------
    shifts : float64, shape (n,), 0 where it fits here [m].
    is_examined : bool, shape (n,).
    """
    count = round(REACH_M / STEP_M)
    shifts: FloatArray = STEP_M * np.arange(-count, count + 1, dtype=np.float64)
    costs = np.zeros((len(directions), len(shifts)))
    counts = np.zeros(len(directions), dtype=np.int64)
    add_shift_costs(
        SmoothMap(grid.probabilities(), grid.origin_x, grid.origin_y, grid.resolution),
        MIN_PROBABILITY,
        ScanBatch(scans.points, scans.firsts, scans.ends),
        poses,
        runs,
        directions,
        shifts,
        MAX_PARALLEL,
        costs,
        counts,
    )
    best = costs.argmin(axis=1)
    least = costs[np.arange(len(costs)), best]
    is_here = np.abs(shifts) < HERE_M + 0.5 * STEP_M
    is_inside = np.abs(shifts[best]) < REACH_M - EDGE_M + 0.5 * STEP_M
    is_shifted = (least < MAX_COST_SHARE * costs[:, is_here].min(axis=1)) & is_inside
    return np.where(is_shifted, shifts[best], 0.0), counts >= MIN_POINTS
