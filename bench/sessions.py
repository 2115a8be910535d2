# SPDX-License-Identifier: Apache-2.0
"""Recordings cut into sessions, mapped each by itself and merged; places that must stay apart.

Each session is in a frame of its own, and they are merged in shuffled order. The error of the
merged map is compared with that of the uncut run.
"""

from __future__ import annotations

import random
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bench.environment import environment
from bench.record import Figure, Record, Row
from cartoloop.arrays import BoolArray, FloatArray, IntArray
from cartoloop.evaluation.relations import evaluate_relations, read_relations
from cartoloop.evaluation.trajectories import Trajectory, absolute_trajectory_error
from cartoloop.global_slam.pose_graph import ConstraintKind
from cartoloop.mapper import Mapper
from cartoloop.merging import merge
from cartoloop.readers import open_log
from cartoloop.result import Result
from cartoloop.sensor.events import LaserScan, PointCloud, SensorEvent
from cartoloop.sensor.pose import compose_all, relative_all
from cartoloop.session import MAIN_PART
from cartoloop.simulation import make_world, simulate
from cartoloop.simulation.recording import Recording

RECORDINGS = ("intel", "mit-killian", "mit-csail", "fr079", "aces", "museum")
STRANGERS = (
    ("fr079", "intel"),
    ("aces", "mit-csail"),
    *((name, "museum") for name in RECORDINGS[:-1]),
)
"""Places that must not be joined."""

RELATIONS = {"intel": "intel-exact", "mit-csail": "mit-csail", "fr079": "fr079"}
"""Files of verified relations; of other recordings, the uncut run is the measure."""

CELL_M, EVERY_NTH_CELL = 0.5, 5
"""Cells in which overlap is counted [m], and how densely submaps are sampled."""

MIN_OVERLAP_M2 = 10.0
"""A session that overlaps the others by this area must be joined [m^2]."""

MIN_STRETCH = 200
"""Scans of a drive in one wing that are mapped; shorter stretches are a turn at the door."""


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


def run(
    data: Path,
    recordings: Sequence[str],
    cuts: Sequence[int],
    strangers: bool,
    seeds: int,
    note: Callable[[str], None],
) -> Record:
    """Return the figures of recordings cut into sessions, of strangers, and of wings.

    Parameters
    ----------
    data : folder of the recordings.
    recordings : which of `RECORDINGS` are cut.
    cuts : into how many sessions each.
    strangers : whether pairs of recordings of different places are merged.
    seeds : number of buildings with two wings.
    note : called with what is done next.
    """
    rows, uncut = [], {}

    def whole(name: str) -> tuple[Drive, Result] | None:
        if name not in uncut:
            drive = _drive(name, data)
            note(f"{name}: mapping")
            uncut[name] = None if drive is None else (drive, _mapped(drive.events))
        return uncut[name]

    for name in recordings:
        if (found := whole(name)) is None:
            rows.append(Row({"recording": name}, notes="the recording is not there"))
            continue
        for count in cuts:
            note(f"{name}: {count} sessions")
            rows.append(_cut_row(*found, count))
    for one, other in STRANGERS if strangers else ():
        if one in recordings and other in recordings:
            note(f"{one} with {other}")
            maps = [found[1] for name in (one, other) if (found := whole(name)) is not None]
            if len(maps) == 2:
                rows.append(_apart_row(f"{one} + {other}", maps))
    for seed in range(seeds):
        note(f"wings, seed {seed}")
        rows.append(_wings_row(seed))
    return Record("sessions", tuple(rows), environment())


def _drive(name: str, data: Path) -> Drive | None:
    if name == "museum":
        simulated = simulate(make_world("museum"), seed=1)
        return Drive(name, list(simulated.events()), truth=simulated)
    path = data / "radish" / f"{name}.clf.gz"
    if not path.is_file():
        return None
    relations = data / "radish" / f"{RELATIONS[name]}.relations" if name in RELATIONS else None
    return Drive(name, list(open_log(path)), relations)


def _is_scan(event: SensorEvent) -> bool:
    return isinstance(event, LaserScan | PointCloud)


def sessions_of(events: Sequence[SensorEvent], count: int) -> list[list[SensorEvent]]:
    """Return events cut into stretches of about the same number of scans."""
    total = sum(map(_is_scan, events))
    parts: list[list[SensorEvent]] = [[] for _ in range(count)]
    number = 0
    for event in events:
        parts[min(number * count // max(total, 1), count - 1)].append(event)
        number += _is_scan(event)
    return parts


def _mapped(events: Sequence[SensorEvent]) -> Result:
    mapper = Mapper()
    for event in events:
        mapper.add(event)
    return mapper.finish()


def _cut_row(drive: Drive, uncut: Result, count: int) -> Row:
    """Return the figures of a recording cut into `count` sessions."""
    maps = [_mapped(part) for part in sessions_of(drive.events, count)]
    areas = _overlaps(maps, uncut)
    order = list(range(count))
    random.Random(count).shuffle(order)
    start = time.process_time()
    merged = merge([maps[number] for number in order])
    seconds = time.process_time() - start
    parts = [session.part for session in merged.sessions]
    main = max(set(parts), key=parts.count)
    is_due = [areas[number] >= MIN_OVERLAP_M2 for number in order]
    joined = sum(part == main for part, due in zip(parts, is_due, strict=True) if due)
    ours, before = _errors(drive, uncut, merged, main)
    figures = {
        "joined": Figure.exact(joined, better="more"),
        "overlapping": Figure.exact(sum(is_due), better=None),
        "error": Figure.exact(ours, "m"),
        "uncut": Figure.exact(before, "m", better=None),
        "merging": Figure.of_samples([seconds], "cpu s"),
    }
    if before > 0.0:
        figures["ratio"] = Figure.exact(ours / before)
    why = {join["why_not"] for join in merged.report.extra.get("joins", []) if not join["joined"]}
    return Row({"recording": drive.name, "sessions": count}, figures, "; ".join(sorted(why)))


def _errors(drive: Drive, uncut: Result, merged: Result, part: int) -> tuple[float, float]:
    """Return the mean error of the merged map's largest part, and of the uncut run [m]."""
    chosen = merged.scan_parts == part
    stamps, poses = merged.stamps[chosen], merged.trajectory[chosen]
    if drive.relations is not None:
        relations = read_relations(drive.relations)
        errors = [
            evaluate_relations(Trajectory(*each), relations).absolute_translational.mean
            for each in ((stamps, poses), (uncut.stamps, uncut.trajectory))
        ]
        return errors[0], errors[1]
    if drive.truth is None:
        rows = _rows(uncut.stamps, stamps)
        return float(absolute_trajectory_error(poses, uncut.trajectory[rows]).mean()), 0.0
    truth = drive.truth
    ours = absolute_trajectory_error(poses, truth.true_poses[_rows(truth.stamps, stamps)])
    whole = truth.true_poses[_rows(truth.stamps, uncut.stamps)]
    return float(ours.mean()), float(absolute_trajectory_error(uncut.trajectory, whole).mean())


def _rows(known: FloatArray, stamps: FloatArray) -> IntArray:
    """Return the rows of stamps among known ones, which may run backwards."""
    order = np.argsort(known, kind="stable")
    places = np.searchsorted(known[order], stamps - 1e-6)
    rows: IntArray = order[np.minimum(places, len(order) - 1)]
    return rows


def _overlaps(maps: Sequence[Result], uncut: Result) -> list[float]:
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


def _apart_row(name: str, maps: Sequence[Result]) -> Row:
    """Return the figures of maps that must stay apart."""
    start = time.process_time()
    merged = merge(maps)
    seconds = time.process_time() - start
    return _verdict_row(name, merged, seconds, is_wrong=_num_joined(merged) > 1)


def _verdict_row(name: str, merged: Result, seconds: float, *, is_wrong: bool) -> Row:
    figures = {
        "wrong joins": Figure.exact(int(is_wrong)),
        "merging": Figure.of_samples([seconds], "cpu s"),
    }
    why = [join["why_not"] for join in merged.report.extra.get("joins", []) if not join["joined"]]
    return Row({"recording": name, "sessions": len(merged.sessions)}, figures, "; ".join(why))


def _num_joined(merged: Result) -> int:
    return sum(session.part == MAIN_PART for session in merged.sessions)


def _wings_row(seed: int) -> Row:
    """Return the figures of a building with two wings that look alike, a session in each."""
    simulated = simulate(make_world("wings", seed), seed=seed)
    walls = simulated.world.walls[:, [0, 2]]
    is_east = simulated.true_poses[:, 0] > 0.5 * (walls.min() + walls.max())
    ends = np.flatnonzero(np.diff(is_east)) + 1
    stretches = [rows for rows in np.split(np.arange(len(is_east)), ends) if len(rows)]
    stretches = [rows for rows in stretches if len(rows) >= MIN_STRETCH][:2]
    maps = []
    for rows in stretches:
        first, last = simulated.stamps[rows[0]], simulated.stamps[rows[-1]]
        events = [
            event for event in simulated.events() if first - 1e-6 <= event.stamp <= last + 1e-6
        ]
        maps.append(_mapped(events))
    start = time.process_time()
    merged = merge(maps)
    seconds = time.process_time() - start
    is_wrong = _num_joined(merged) > 1 and _is_displaced(merged, simulated)
    return _verdict_row(f"wings {seed}", merged, seconds, is_wrong=is_wrong)


def _is_displaced(merged: Result, simulated: Recording) -> bool:
    """Return whether the two sessions are elsewhere than they truly are: by metres."""
    true = simulated.true_poses[_rows(simulated.stamps, merged.stamps)]
    return float(absolute_trajectory_error(merged.trajectory, true).max()) > MAX_ERROR_M


MAX_ERROR_M = 5.0
"""Wings are 30 m apart or more; drives of them are true to half a metre [m]."""
