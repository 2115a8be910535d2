# SPDX-License-Identifier: Apache-2.0
"""Simulated buildings on another day: which changes a robot could see, and which it reported.

The truth is the simulator's: the outlines of all that stands there on one day and not on the other,
and the beams of the later drive from its true poses. Nothing of it is read by the localiser.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from bench.localisation.drives import Drive, aligned, mapped
from bench.localisation.measures import Followed, follow, points_of
from cartoloop.arrays import BoolArray, FloatArray, IntArray
from cartoloop.localisation.changes.areas import Changes, Kind
from cartoloop.localisation.known_map import KnownMap
from cartoloop.localisation.localizer import Localizer
from cartoloop.mapper import Mapper
from cartoloop.quality.pairs import FLOOR, WALL
from cartoloop.result import Result
from cartoloop.sensor.pose import Pose, compose_all, transform_points
from cartoloop.simulation import Difficulties, Recording, make_world, simulate
from cartoloop.submaps.finished_grid import mean_value

WORLD = "office"

SPACING_M = 0.02
"""Outlines are sampled at this distance [m]."""

MOVED_M, SAME_M = 0.15, 0.03
"""An outline has changed surely if none of the other day is within the first distance, and not at
all if one is within the second [m]."""

NEAR_M = 0.12
"""A reported cell and an outline are of the same thing within this distance [m]."""

MIN_SCANS = 10
"""A place of an outline could be seen if this number of scans showed it."""

MIN_LENGTH_M = 0.4
"""What could be seen of a thing counts from this length on [m]."""

APART_M = 0.3
"""Outlines farther apart are of different things [m]."""

COVERED = 0.3
"""A thing is found if this share of what could be seen of it was reported."""


@dataclass(frozen=True)
class LaterDay:
    """A building on a later day.

    Attributes
    ----------
    drive : through it, in the map of the first day.
    before, after : float64, shape (n, 4), walls of both days, map frame [m].
    doors : number of doors that are open on the first day and closed on the later one.
    """

    drive: Drive
    before: FloatArray
    after: FloatArray
    doors: int


def later_day(seed: int, people: int = 0, number: int = 2) -> LaterDay:
    """Map a building, and drive through it on another day, on another route.

    Parameters
    ----------
    seed : of the building.
    people : who walk near the robot on the later day.
    number : of the later drive, see `cartoloop.simulation.office`.
    """
    first, result = _first_day(seed)
    later = make_world(WORLD, seed, number)
    recording = simulate(later, seed=seed, difficulties=Difficulties(people=people))
    tf_map_world = aligned(first.true_poses[: len(result.stamps)], result.trajectory)
    truth = compose_all(np.array(tf_map_world), recording.true_poses)
    drive = Drive(f"{WORLD} {seed}", result, list(recording.events()), truth)
    before, after = (_moved(world.walls, tf_map_world) for world in (first.world, later))
    return LaterDay(drive, before, after, _num_closed(first.world.walls, later.walls))


@cache
def _first_day(seed: int) -> tuple[Recording, Result]:
    first = simulate(make_world(WORLD, seed), seed=seed)
    return first, mapped(list(first.events()), Mapper())


def _moved(walls: FloatArray, tf_map_world: Pose) -> FloatArray:
    return transform_points(tf_map_world, walls.reshape(-1, 2)).reshape(-1, 4)


def _num_closed(before: FloatArray, after: FloatArray) -> int:
    """Return how many door leaves, the only lines of two ends alone, are gone."""
    return len(_leaves(before)) - len(_leaves(after))


def _leaves(walls: FloatArray) -> FloatArray:
    length = np.hypot(walls[:, 2] - walls[:, 0], walls[:, 3] - walls[:, 1])
    is_slanted = np.abs(walls[:, 2:] - walls[:, :2]).min(axis=1) > 1e-6
    ends, counts = np.unique(np.round(walls.reshape(-1, 2), 6), axis=0, return_counts=True)
    free = {tuple(end) for end in ends[counts == 1].tolist()}
    alone = np.array([tuple(end) in free for end in np.round(walls[:, 2:], 6).tolist()])
    leaves: FloatArray = walls[is_slanted & alone & (length > 0.9) & (length < 1.05)]
    return leaves


@dataclass(frozen=True)
class Found:
    """Reported areas against the truth.

    Attributes
    ----------
    num_right, num_areas : reported areas that are changes, and all.
    num_found, num_things : things that could be seen to have changed and were reported, and all.
    """

    num_right: int
    num_areas: int
    num_found: int
    num_things: int

    def __add__(self, other: Found) -> Found:
        pairs = zip(self.values, other.values, strict=True)
        return Found(*(mine + others for mine, others in pairs))

    @property
    def values(self) -> tuple[int, int, int, int]:
        """All four numbers."""
        return self.num_right, self.num_areas, self.num_found, self.num_things


def judged(day: LaterDay, known: KnownMap, changes: Changes) -> dict[Kind, Found]:
    """Return what is right and what is missing among changes, by kind."""
    outlines = {Kind.APPEARED: (day.after, day.before), Kind.DISAPPEARED: (day.before, day.after)}
    found = {}
    for kind, (present, absent) in outlines.items():
        points = sampled(present)
        apart = cKDTree(sampled(absent)).query(points)[0]
        cells = changes.appeared if kind is Kind.APPEARED else changes.disappeared
        right = _num_right(known, changes, kind, points[apart > SAME_M])
        seen = _could_be_seen(day, known, kind, points[apart > MOVED_M])
        num_found, num_things = _num_found(seen, centres(known, cells))
        found[kind] = Found(right, len(changes.of(kind)), num_found, num_things)
    return found


def sampled(walls: FloatArray) -> FloatArray:
    """Return points along walls, shape (n, 2) [m]."""
    points = []
    for x1, y1, x2, y2 in walls.tolist():
        count = max(int(np.ceil(np.hypot(x2 - x1, y2 - y1) / SPACING_M)), 1)
        at = (np.arange(count) + 0.5) / count
        points.append(np.column_stack((x1 + at * (x2 - x1), y1 + at * (y2 - y1))))
    return np.concatenate(points)


def centres(known: KnownMap, cells: BoolArray) -> FloatArray:
    """Return the centres of cells in the map frame, shape (n, 2) [m]."""
    grid = known.cell_grid
    rows, cols = np.nonzero(cells)
    return np.column_stack(
        (grid.origin_x + cols * grid.resolution, grid.origin_y + rows * grid.resolution)
    )


def follow_and_judge(day: LaterDay, known: KnownMap) -> tuple[Followed, dict[Kind, Found]]:
    """Localise along a drive of a later day; return how well, and what is right of the changes."""
    start = Pose(*day.drive.truth[0].tolist())
    localizer = Localizer(known, at=start, watch_changes=True)
    followed = follow(known, day.drive, localizer=localizer)
    localizer.finish()
    return followed, judged(day, known, localizer.changes())


def _num_right(known: KnownMap, changes: Changes, kind: Kind, changed: FloatArray) -> int:
    """Return the number of areas most of whose cells are near an outline that has changed."""
    cells = changes.appeared if kind is Kind.APPEARED else changes.disappeared
    at = centres(known, cells)
    near = (
        cKDTree(changed).query(at)[0] <= NEAR_M if len(at) and len(changed) else np.zeros(len(at))
    )
    half = 0.5 * known.cell_grid.resolution
    num_right = 0
    for area in changes.of(kind):
        x_min, y_min, x_max, y_max = area.box
        inside = (
            (at[:, 0] > x_min - 0.1 * half) & (at[:, 0] < x_max + 0.1 * half)
            & (at[:, 1] > y_min - 0.1 * half) & (at[:, 1] < y_max + 0.1 * half)
        )  # fmt: skip
        num_right += float(near[inside].mean()) >= 0.5
    return num_right


def _could_be_seen(day: LaterDay, known: KnownMap, kind: Kind, points: FloatArray) -> FloatArray:
    """Return the points that the map and enough scans of the later drive show."""
    if len(points) == 0:
        return points
    grid = known.cell_grid
    rows, cols = _cells_at(known, points)
    shape = grid.cells.shape
    inside = (rows >= 2) & (rows < shape[0] - 2) & (cols >= 2) & (cols < shape[1] - 2)
    rows, cols, points = rows[inside], cols[inside], points[inside]
    ends, passes = _counts(day.drive, known)
    around = [(i, j) for i in (-1, 0, 1) for j in (-1, 0, 1)]
    values = np.array([grid.cells[rows + i, cols + j] for i, j in around])
    if kind is Kind.APPEARED:
        mapped_so = ((values > 0) & (values <= mean_value(FLOOR))).all(axis=0)
        scans = np.max([ends[rows + i, cols + j] for i, j in around], axis=0)
    else:
        mapped_so = (values >= mean_value(WALL)).any(axis=0)
        scans = passes[rows, cols]
    seen: FloatArray = points[mapped_so & (scans >= MIN_SCANS)]
    return seen


def _cells_at(known: KnownMap, points: FloatArray) -> tuple[IntArray, IntArray]:
    grid = known.cell_grid
    at = np.floor((points - (grid.origin_x, grid.origin_y)) / grid.resolution + 0.5)
    return at[:, 1].astype(np.int64), at[:, 0].astype(np.int64)


def _counts(drive: Drive, known: KnownMap) -> tuple[IntArray, IntArray]:
    """Return in how many scans each cell has a return, and is passed through; from true poses."""
    grid = known.cell_grid
    ends, passes = (np.zeros(grid.cells.shape, dtype=np.int64) for _ in range(2))
    for scan, pose in enumerate(drive.truth.tolist()):
        points = transform_points(Pose(*pose), points_of(drive, scan))
        ranges = np.hypot(points[:, 0] - pose[0], points[:, 1] - pose[1])
        _count_once(ends, _cells_at(known, points))
        steps = np.arange(0.0, float(ranges.max(initial=0.0)), grid.resolution)
        beam, step = np.nonzero(steps[np.newaxis, :] < ranges[:, np.newaxis] - 0.3)
        share = (steps[step] / ranges[beam])[:, np.newaxis]
        start = np.array(pose[:2])
        _count_once(passes, _cells_at(known, start + share * (points[beam] - start)))
    return ends, passes


def _count_once(counts: IntArray, at: tuple[IntArray, IntArray]) -> None:
    rows, cols = at
    inside = (rows >= 0) & (rows < counts.shape[0]) & (cols >= 0) & (cols < counts.shape[1])
    counts.ravel()[np.unique(rows[inside] * counts.shape[1] + cols[inside])] += 1


def _num_found(seen: FloatArray, reported: FloatArray) -> tuple[int, int]:
    """Return how many things, given by points of their outlines, were reported, and how many."""
    if len(seen) == 0:
        return 0, 0
    graph = cKDTree(seen).sparse_distance_matrix(cKDTree(seen), APART_M)
    labels = connected_components(graph, directed=False)[1]
    near = (
        cKDTree(reported).query(seen)[0] <= NEAR_M
        if len(reported)
        else np.zeros(len(seen), dtype=np.bool_)
    )
    num_found = num_things = 0
    for label in range(int(labels.max()) + 1):
        of_thing = labels == label
        if of_thing.sum() * SPACING_M < MIN_LENGTH_M:
            continue
        num_things += 1
        num_found += float(near[of_thing].mean()) >= COVERED
    return num_found, num_things
