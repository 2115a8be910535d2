# SPDX-License-Identifier: Apache-2.0
"""What is measured in maps of several sessions: errors, and the areas that sessions share."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from cartoloop.arrays import BoolArray, FloatArray, IntArray
from cartoloop.evaluation.relations import evaluate_relations, read_relations
from cartoloop.evaluation.trajectories import Trajectory, absolute_trajectory_error, align
from cartoloop.global_slam.pose_graph import ConstraintKind
from cartoloop.result import Result
from cartoloop.sensor.events import SensorEvent
from cartoloop.sensor.pose import compose_all, relative_all
from cartoloop.session import session_numbers
from cartoloop.simulation.recording import Recording

CELL_M, EVERY_NTH_CELL = 0.5, 5
"""Cells in which overlap is counted [m], and how densely submaps are sampled."""

MAX_ERROR_M = 5.0
"""Wings are 30 m apart or more; drives of them are true to half a metre [m]."""

MAX_SESSION_M = 0.5
"""A session is joined wrongly if its scans are farther from the uncut run on average [m].

Walls that stand twice, half a metre apart, are two walls for whatever uses the map. What drift of
local SLAM and a scale of the odometry that is learnt once more leave is a few centimetres."""

_ALIGNMENTS = 20
"""Rounds of the alignment to the uncut run."""


@dataclass
class Drive:
    """A recording as events.

    Attributes
    ----------
    name : of the recording.
    events : all of them.
    relations : file of verified relations, or None.
    truth : simulated, or None.
    """

    name: str
    events: list[SensorEvent]
    relations: Path | None = None
    truth: Recording | None = None


def error(drive: Drive, stamps: FloatArray, poses: FloatArray) -> float | None:
    """Return the mean error of scans of a drive [m]; None if nothing is known to compare with.

    Parameters
    ----------
    stamps, poses : of the scans, shapes (n,), (n, 3); by relations, of those that both are of.
    """
    if drive.relations is not None:
        relations = read_relations(drive.relations)
        found = evaluate_relations(Trajectory(stamps, poses), relations)
        return float(found.absolute_translational.mean)
    if drive.truth is None:
        return None
    true = drive.truth.true_poses[_rows(drive.truth.stamps, stamps)]
    return float(absolute_trajectory_error(poses, true).mean())


def errors(drive: Drive, uncut: Result, merged: Result, part: int) -> tuple[float, float] | None:
    """Return the mean error of the merged map's largest part, and of the uncut run [m].

    None if neither relations nor the truth are known.
    """
    chosen = merged.scan_parts == part
    ours = error(drive, merged.stamps[chosen], merged.trajectory[chosen])
    whole = error(drive, uncut.stamps, uncut.trajectory)
    return None if ours is None or whole is None else (ours, whole)


class Distances(NamedTuple):
    """How far the scans of joined sessions are from where the uncut run has them [m].

    Attributes
    ----------
    largest, mean : of all scans.
    of_sessions : float64, the mean of each session of the merged map; NaN if it is apart.
    """

    largest: float
    mean: float
    of_sessions: FloatArray

    @property
    def num_wrong(self) -> int:
        """Number of sessions that are joined wrongly."""
        return int(np.count_nonzero(self.of_sessions > MAX_SESSION_M))


def distances(uncut: Result, merged: Result, part: int) -> Distances:
    """Return how far the scans of a part of the merged map are from the uncut run.

    Relations do not look everywhere; this does. The two maps are first aligned as rigid wholes,
    such that the sum of the distances, each at most :data:`MAX_SESSION_M`, is least: sessions that
    stand far off do not move the others.
    """
    chosen = np.flatnonzero(merged.scan_parts == part)
    poses = merged.trajectory[chosen]
    reference = uncut.trajectory[_rows(uncut.stamps, merged.stamps[chosen])]
    firsts = [session.first_scan for session in merged.sessions]
    numbers = session_numbers(firsts, len(merged.stamps))[chosen]
    # Most of the map may agree with any one of the sessions.
    tried = [
        _aligned_distances(poses, reference, numbers == session) for session in np.unique(numbers)
    ]
    apart = min(tried, key=lambda each: float(np.minimum(each, MAX_SESSION_M).sum()))
    sums = np.bincount(numbers, apart, len(firsts))
    counts = np.bincount(numbers, minlength=len(firsts))
    means = np.full(len(firsts), np.nan)
    np.divide(sums, counts, out=means, where=counts > 0)
    return Distances(float(apart.max()), float(apart.mean()), means)


def _aligned_distances(poses: FloatArray, reference: FloatArray, first: BoolArray) -> FloatArray:
    """Return the distances of positions after a rigid alignment that what is far off hardly moves.

    By least squares, weighted again and again by the loss of Geman and McClure.

    Parameters
    ----------
    first : rows that it begins with, shape (n,).
    """
    weights = first.astype(np.float64)
    apart = np.zeros(len(poses))
    for _ in range(_ALIGNMENTS):
        tf_reference_poses = align(poses[:, :2], reference[:, :2], weights)
        moved = compose_all(np.array(tf_reference_poses), poses)
        apart = np.hypot(*(moved[:, :2] - reference[:, :2]).T)
        weights = (1.0 + (apart / MAX_SESSION_M) ** 2) ** -2
    return apart


def _rows(known: FloatArray, stamps: FloatArray) -> IntArray:
    """Return the rows of stamps among known ones, which may run backwards."""
    order = np.argsort(known, kind="stable")
    places = np.searchsorted(known[order], stamps - 1e-6)
    rows: IntArray = order[np.minimum(places, len(order) - 1)]
    return rows


def overlaps(maps: Sequence[Result], uncut: Result) -> list[float]:
    """Return the area that each map shares with the others, by the poses of the uncut run [m^2]."""
    seen = [_seen_cells(each, uncut) for each in maps]
    areas = []
    for number, own in enumerate(seen):
        others = set().union(*(cells for other, cells in enumerate(seen) if other != number))
        areas.append(len(own & others) * CELL_M**2)
    return areas


def _seen_cells(result: Result, uncut: Result) -> set[tuple[int, int]]:
    """Return the cells that a map has seen, in the frame of the uncut run."""
    graph = result.graph
    own = np.flatnonzero(graph.kinds == ConstraintKind.INTRA_SUBMAP)
    cells: set[tuple[int, int]] = set()
    for submap, grid in enumerate(result.submap_grids):
        rows = own[graph.index_a[own] == submap]
        if grid.size == 0 or len(rows) == 0:
            continue
        middle = rows[len(rows) // 2]
        scan = result.node_scan_index[graph.index_b[middle]]
        pose = uncut.trajectory[_rows(uncut.stamps, result.stamps[scan : scan + 1])]
        back = relative_all(graph.relative_poses[middle], np.zeros((1, 3)))
        tf_map_submap = compose_all(pose, back)[0]
        known: BoolArray = grid.cells[::EVERY_NTH_CELL, ::EVERY_NTH_CELL] > 0
        places = np.argwhere(known)[:, ::-1] * EVERY_NTH_CELL * grid.resolution
        points = np.column_stack(
            (places + np.array((grid.origin_x, grid.origin_y)), np.zeros(len(places)))
        )
        placed = np.floor(compose_all(tf_map_submap, points)[:, :2] / CELL_M).astype(np.int64)
        cells.update(map(tuple, placed.tolist()))
    return cells


def is_displaced(merged: Result, simulated: Recording) -> bool:
    """Return whether the two sessions are elsewhere than they truly are: by metres."""
    true = simulated.true_poses[_rows(simulated.stamps, merged.stamps)]
    return float(absolute_trajectory_error(merged.trajectory, true).max()) > MAX_ERROR_M
