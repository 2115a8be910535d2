# SPDX-License-Identifier: Apache-2.0
"""Localisation in maps that other scans made: of recordings cut in two, and of simulated worlds."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np

from bench.environment import environment
from bench.localisation import measures
from bench.localisation.changed_places import Found, follow_and_judge, later_day
from bench.localisation.drives import (
    CutRecording,
    Drive,
    carried_away,
    simulated_drive,
    with_moved_boxes,
)
from bench.localisation.world_rows import carried_row, live_row, share, stranger_row
from bench.record import Case, Figure, Record, Row
from cartoloop.arrays import FloatArray
from cartoloop.evaluation.map_image import MapImage
from cartoloop.localisation.changes.areas import Kind
from cartoloop.localisation.known_map import KnownMap, known_map_of, known_map_of_image
from cartoloop.map_output.occupancy_map import OccupancyMap
from cartoloop.sensor.pose import Pose

RECORDINGS = ("intel", "fr079", "mit-csail", "aces")
"""Recordings whose second half is localised in the map of the first."""

WORLD = "office"
PEOPLE = 3
"""Who walk near the robot in a part of the drives."""

MAX_PATH_M = 20.0
"""Path of each drive from nowhere [m]."""

LEAST_PATH_M = 12.0
"""Drives from nowhere begin where at least this path is left [m], where there is any such place."""

PARTICLES = 5000
"""Of the particle filter at its start; AMCL's default of 2,000 rarely finds the place."""

Progress = Callable[[str], None]


def run(
    data: Path,
    scans: int,
    drives: int,
    seeds: int,
    recordings: Sequence[str],
    progress: Progress,
    *,
    changes_alone: bool = False,
) -> Record:
    """Return the figures of all parts.

    Parameters
    ----------
    data : folder of the recordings; those that are absent are left out.
    scans : single scans of each recording.
    drives : drives from nowhere in each recording, and robots carried away in each world.
    seeds : simulated worlds.
    recordings : names of the recordings.
    progress : called with a line now and then.
    changes_alone : whether of the simulated worlds only drives on a later day are measured.
    """
    rows: list[Row] = []
    for name in recordings:
        path = data / "radish" / f"{name}.clf.gz"
        if not path.exists():
            progress(f"{path}: absent, left out")
            continue
        progress(f"{name}: mapping both halves")
        drive = CutRecording(path).drive()
        rows += _reported(_recording_rows(drive, scans, drives, progress), progress)
    if not changes_alone:
        rows += _reported(_simulated_rows(seeds, drives, progress), progress)
    rows += _reported(_changed_rows(seeds, progress), progress)
    return Record("localisation", tuple(rows), environment())


def _reported(rows: Iterator[Row], progress: Progress) -> Iterator[Row]:
    """Yield rows, and report each as it is known."""
    for row in rows:
        figures = (f"{name} {figure.text()} {figure.unit}" for name, figure in row.figures.items())
        progress(f"{', '.join(map(str, row.case.values()))}: {', '.join(figures)}")
        yield row


def _recording_rows(drive: Drive, scans: int, drives: int, progress: Progress) -> Iterator[Row]:
    own = known_map_of(drive.result, drive.name)
    for map_name, known in (("ours", own), ("pgm and yaml", _as_image(drive))):
        case: Case = {"drive": drive.name, "map": map_name}
        progress(f"{drive.name}, {map_name}: single scans")
        yield _single_row(case, measures.single_scans(known, drive, scans))
        progress(f"{drive.name}, {map_name}: drives")
        yield _driving_row(case, known, drive, drives)
    progress(f"{drive.name}: particle filter")
    yield _particle_row({"drive": drive.name, "map": "ours"}, own, drive, drives)


def _as_image(drive: Drive) -> KnownMap:
    """Return the map as a reader of its ``map.pgm`` and ``map.yaml`` sees it."""
    occupancy_map = drive.result.occupancy_map()
    options = drive.result.config.map_output
    return known_map_of_image(
        _image_of(occupancy_map, options.occupied_thresh, options.free_thresh)
    )


def _image_of(occupancy_map: OccupancyMap, occupied: float, free: float) -> MapImage:
    probability = occupancy_map.probability
    occupancy = np.full(probability.shape, -1.0, dtype=np.float32)
    occupancy[(probability >= 0.0) & (probability < free)] = 0.0
    occupancy[probability > occupied] = 1.0
    origin = Pose(occupancy_map.origin_x, occupancy_map.origin_y, 0.0)
    return MapImage(occupancy, occupancy_map.resolution, origin, 0.65, 0.196)


def _single_row(case: Case, found: measures.SingleScans) -> Row:
    claimed, right = np.array(found.claimed), np.array(found.right)
    overlapping = np.array(found.overlapping)
    figures = {
        "scans": Figure.exact(len(claimed), better=None),
        "overlapping": Figure.exact(100.0 * float(overlapping.mean()), "%", None),
        "of these claimed": share(claimed[overlapping], "more"),
        "claims that are right": share(right[claimed], "more"),
        "wrong, of all": Figure.exact(100.0 * float((claimed & ~right).mean()), "%"),
        "time": Figure.of_samples([1e3 * time for time in found.times], "ms"),
        "longest": Figure(1e3 * max(found.times), "ms"),
        "processor time": Figure.of_samples([1e3 * time for time in found.processor], "ms"),
    }
    return Row({"what": "one scan from nowhere", **case}, figures)


def _starts(drive: Drive, overlapping: Sequence[float], count: int) -> list[int]:
    """Return scans to begin with: spread over the drive, where the map shows what they show."""
    steps = np.hypot(*np.diff(drive.truth[:, :2], axis=0).T)
    left = float(steps.sum()) - np.concatenate(((0.0,), np.cumsum(steps)))
    last = int(np.count_nonzero(left >= LEAST_PATH_M)) or len(drive.truth) - 1
    chosen = []
    for start in np.linspace(0, 0.95 * last, count).astype(int).tolist():
        near = next((i for i in range(start, last) if overlapping[i]), None)
        if near is not None and near not in chosen:
            chosen.append(near)
    return chosen


def _overlap(known: KnownMap, drive: Drive) -> list[float]:
    """Return 1 for scans that overlap the map, 0 for others; every fifth is looked at."""
    seen = [float(measures.overlaps(known, drive, i)) for i in range(0, len(drive.truth), 5)]
    return [seen[i // 5] for i in range(len(drive.truth))]


def _driving_row(case: Case, known: KnownMap, drive: Drive, count: int) -> Row:
    overlapping = _overlap(known, drive)
    runs = [
        measures.follow(known, drive, start, MAX_PATH_M, overlapping=np.array(overlapping))
        for start in _starts(drive, overlapping, count)
    ]
    return Row({"what": "driving from nowhere", **case}, _driving_figures(runs, by_overlap=True))


def _driving_figures(runs: Sequence[measures.Followed], *, by_overlap: bool) -> dict[str, Figure]:
    paths = [run.overlap_path if by_overlap else run.path for run in runs]
    errors = np.concatenate([run.errors for run in runs])
    angles = np.concatenate([run.angles for run in runs])
    located = sum(run.num_located for run in runs)
    decisions = sum(sum(run.states.values()) for run in runs)
    processor = 1e3 * np.concatenate([run.processor for run in runs])
    lost = sum(run.states["lost"] for run in runs)
    return {
        "drives": Figure.exact(len(runs), better=None),
        "located within 3 m": share(np.array(paths) <= 3.0, "more"),
        "within 10 m": share(np.array(paths) <= 10.0, "more"),
        "located": Figure.exact(100.0 * located / max(decisions, 1), "%", None),
        "wrong": Figure.exact(100.0 * sum(r.num_wrong for r in runs) / max(decisions, 1), "%"),
        "lost": Figure.exact(100.0 * lost / max(decisions, 1), "%"),
        "rmse": Figure.exact(100.0 * _rms(errors), "cm"),
        "heading rmse": Figure.exact(math.degrees(_rms(angles)), "deg"),
        "processor time of a scan": Figure(float(np.median(processor)), "ms"),
        "99%": Figure(float(np.quantile(processor, 0.99)), "ms"),
    }


def _rms(values: np.ndarray[tuple[int], np.dtype[np.float64]]) -> float:
    return math.sqrt(float(np.square(values).mean())) if len(values) else math.nan


def _particle_row(case: Case, known: KnownMap, drive: Drive, count: int) -> Row:
    overlapping = _overlap(known, drive)
    runs = [
        measures.follow_by_particles(known, drive, start, MAX_PATH_M, PARTICLES)
        for start in _starts(drive, overlapping, count)
    ]
    figures = _driving_figures(runs, by_overlap=False)
    return Row({"what": f"particle filter, {PARTICLES}", **case}, figures)


def _simulated_rows(seeds: int, drives: int, progress: Progress) -> Iterator[Row]:
    """Return what is measured against the truth of the simulator."""
    unchanged: list[measures.Followed] = []
    moved: list[measures.Followed] = []
    strangers: list[measures.Followed] = []
    live: list[measures.Followed] = []
    carried: list[measures.CarriedAway] = []
    map_errors: list[FloatArray] = []
    before: KnownMap | None = None
    for seed in range(seeds):
        progress(f"{WORLD} {seed}: mapping and driving again")
        drive = simulated_drive(WORLD, seed)
        known = known_map_of(drive.result)
        map_errors.append(drive.map_errors)
        start = _pose(drive, 0)
        unchanged.append(measures.follow(known, drive, at=start))
        live.append(measures.follow(known, drive, max_path=MAX_PATH_M, live=True))
        later = simulated_drive(WORLD, seed, with_moved_boxes)
        moved.append(measures.follow(known_map_of(later.result), later, at=_pose(later, 0)))
        if before is not None:
            strangers.append(measures.follow(before, drive))
        before = known
        rng = np.random.default_rng(seed)
        for _ in range(drives):
            at = int(rng.integers(20, 60))
            to = int(rng.integers(200, len(drive.truth) - 200))
            away = carried_away(drive, at, to)
            carried.append(measures.carried_away(known, away, at, MAX_PATH_M))
    if not seeds:
        return
    worlds: Case = {"drive": f"{WORLD}, {seeds} seeds", "map": "ours"}
    figures = _driving_figures(unchanged, by_overlap=False)
    figures["rms of the map itself"] = Figure.exact(100.0 * _rms(np.concatenate(map_errors)), "cm")
    yield Row({"what": "tracking", **worlds}, figures)
    yield Row(
        {"what": "tracking, boxes moved", **worlds}, _driving_figures(moved, by_overlap=False)
    )
    yield live_row(worlds, live)
    if strangers:
        yield stranger_row(worlds, strangers)
    if carried:
        yield carried_row(worlds, carried)


def _changed_rows(seeds: int, progress: Progress) -> Iterator[Row]:
    """Return how a robot is followed on a later day, and what it reports to have changed."""
    for people in (0, PEOPLE) if seeds else ():
        followed: list[measures.Followed] = []
        found: dict[Kind, Found] = {}
        doors = 0
        for seed in range(seeds):
            progress(f"{WORLD} {seed}, {people} people: mapping, and driving on a later day")
            day = later_day(seed, people)
            run, judged = follow_and_judge(day, known_map_of(day.drive.result))
            followed.append(run)
            doors += day.doors
            for kind, each in judged.items():
                found[kind] = found[kind] + each if kind in found else each
        nearby = f", {people} people" if people else ""
        case: Case = {"drive": f"{WORLD}, {seeds} seeds{nearby}", "map": "ours"}
        figures = _driving_figures(followed, by_overlap=False)
        figures["doors closed"] = Figure.exact(doors, better=None)
        for kind, each in found.items():
            figures[f"{kind}: areas"] = Figure.exact(each.num_areas, better=None)
            figures[f"{kind}: right"] = _percent(each.num_right, each.num_areas)
            figures[f"{kind}: could be seen"] = Figure.exact(each.num_things, better=None)
            figures[f"{kind}: reported"] = _percent(each.num_found, each.num_things)
        yield Row({"what": "a later day", **case}, figures)


def _percent(part: int, whole: int) -> Figure:
    return Figure.exact(100.0 * part / whole if whole else math.nan, "%", "more")


def _pose(drive: Drive, scan: int) -> Pose:
    return Pose(*drive.truth[scan].tolist())
