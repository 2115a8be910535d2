# SPDX-License-Identifier: Apache-2.0
"""Localisation in maps that other scans made: of recordings cut in two, and of simulated worlds."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from math import isfinite
from pathlib import Path

import numpy as np

from bench.environment import environment
from bench.localisation import measures
from bench.localisation.drives import CutRecording, Drive
from bench.localisation.figures import driving_figures, share
from bench.localisation.images import OURS, known_maps_of
from bench.localisation.long_drive import long_drive_rows
from bench.localisation.other_buildings import stranger_rows
from bench.localisation.search_times import time_rows
from bench.localisation.world_rows import (
    MAX_PATH_M,
    Progress,
    alike_rows,
    changed_rows,
    simulated_rows,
)
from bench.record import Case, Figure, Record, Row
from cartoloop.localisation.known_map import KnownMap

RECORDINGS = ("intel", "fr079", "mit-csail", "aces")
"""Recordings whose second half is localised in the map of the first."""

PARTS = ("worlds", "strangers", "changes", "alike", "times", "long")
"""Parts of the benchmark beside the recordings: simulated worlds, drives in maps of others, later
days, a building with two wings that look alike, times of searches, and one drive, repeated."""

LEAST_PATH_M = 12.0
"""Drives from nowhere begin where at least this path is left [m], where there is any such place."""

PARTICLES = 5000
"""Of the particle filter at its start; AMCL's default of 2,000 rarely finds the place."""


@dataclass(frozen=True)
class Options:
    """How much is measured.

    Attributes
    ----------
    scans : single scans of each recording.
    drives : drives from nowhere in each recording, and robots carried away in each world.
    seeds : simulated worlds.
    hours : of the one drive that is driven again and again.
    parts : names of recordings, and of :data:`PARTS`.
    first_seed : of the worlds whose maps are used for others, and of those with two wings.
    """

    scans: int
    drives: int
    seeds: int
    hours: float
    parts: Sequence[str]
    first_seed: int = 0


def run(data: Path, options: Options, progress: Progress) -> Record:
    """Return the figures of the parts.

    Parameters
    ----------
    data : folder of the recordings; those that are absent are left out.
    options : what is measured.
    progress : called with a line now and then.
    """
    rows: list[Row] = []
    for name in options.parts:
        path = data / "radish" / f"{name}.clf.gz"
        if name in PARTS:
            continue
        if not path.exists():
            progress(f"{path}: absent, left out")
            continue
        progress(f"{name}: mapping both halves")
        drive = CutRecording(path).drive()
        rows += _reported(_recording_rows(drive, options, progress), progress)
    seeds = range(options.first_seed, options.first_seed + options.seeds)
    makers: dict[str, Callable[[], Iterator[Row]]] = {
        "worlds": lambda: simulated_rows(options.seeds, options.drives, progress),
        "strangers": lambda: stranger_rows(seeds, options.drives, progress),
        "changes": lambda: changed_rows(options.seeds, progress),
        "alike": lambda: alike_rows(seeds, progress),
        "times": lambda: time_rows(data, options.scans, progress),
        "long": lambda: long_drive_rows(options.hours, progress),
    }
    for part, make in makers.items():
        if part in options.parts:
            rows += _reported(make(), progress)
    return Record("localisation", tuple(rows), environment())


def _reported(rows: Iterator[Row], progress: Progress) -> Iterator[Row]:
    """Yield rows without figures of what never happened, and report each as it is known."""
    for row in rows:
        known = {name: figure for name, figure in row.figures.items() if isfinite(figure.value)}
        figures = (f"{name} {figure.text()} {figure.unit}" for name, figure in known.items())
        progress(f"{', '.join(map(str, row.case.values()))}: {', '.join(figures)}")
        yield replace(row, figures=known)


def _recording_rows(drive: Drive, options: Options, progress: Progress) -> Iterator[Row]:
    maps = known_maps_of(drive.result, drive.name)
    for map_name, known in maps.items():
        case: Case = {"drive": drive.name, "map": map_name}
        progress(f"{drive.name}, {map_name}: single scans")
        yield _single_row(case, measures.single_scans(known, drive, options.scans))
        progress(f"{drive.name}, {map_name}: drives")
        yield _driving_row(case, known, drive, options.drives)
    progress(f"{drive.name}: particle filter")
    case = {"drive": drive.name, "map": OURS}
    yield _particle_row(case, maps[OURS], drive, options.drives)


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
    return Row({"what": "driving from nowhere", **case}, driving_figures(runs, by_overlap=True))


def _particle_row(case: Case, known: KnownMap, drive: Drive, count: int) -> Row:
    overlapping = _overlap(known, drive)
    runs = [
        measures.follow_by_particles(known, drive, start, MAX_PATH_M, PARTICLES)
        for start in _starts(drive, overlapping, count)
    ]
    figures = driving_figures(runs, by_overlap=False)
    return Row({"what": f"particle filter, {PARTICLES}", **case}, figures)
