# SPDX-License-Identifier: Apache-2.0
"""Rows of the benchmark of localisation on simulated worlds."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from bench.localisation import measures
from bench.localisation.changed_places import Found, follow_and_judge, later_day
from bench.localisation.drives import Drive, carried_away, simulated_drive, with_moved_boxes
from bench.localisation.figures import driving_figures, percent, rms, share
from bench.record import Case, Figure, Row
from cartoloop.arrays import FloatArray
from cartoloop.localisation.changes.areas import Kind
from cartoloop.localisation.known_map import KnownMap, known_map_of
from cartoloop.sensor.pose import Pose

WORLD = "office"
PEOPLE = 3
"""Who walk near the robot in a part of the drives."""

ALIKE = "wings"
"""A building of two wings that are the same to the last millimetre."""

ALIKE_STARTS = (0.05, 0.35, 0.65)
"""Where drives from nowhere begin in it, as shares of the scans."""

MAX_PATH_M = 20.0
"""Path of each drive from nowhere [m]."""

Progress = Callable[[str], None]


def live_row(case: Case, runs: Sequence[measures.Followed]) -> Row:
    """Return what the thread spends that adds the scans of robots from nowhere."""
    times = 1e3 * np.concatenate([run.processor for run in runs])
    return Row(
        {"what": "a robot, from nowhere", **case},
        {
            "scans": Figure.exact(len(times), better=None),
            "time of the calling thread": Figure(float(np.median(times)), "ms"),
            "99%": Figure(float(np.quantile(times, 0.99)), "ms"),
            "longest": Figure(float(times.max()), "ms"),
        },
    )


def carried_row(case: Case, found: Sequence[measures.CarriedAway]) -> Row:
    """Return how soon robots notice that they were carried away, and where they are."""
    noticed = np.array([one.noticed_path <= 3.0 or one.noticed_s <= 5.0 for one in found])
    again = np.array([one.found_path <= 10.0 for one in found])
    paths = [one.found_path for one in found if math.isfinite(one.found_path)]
    return Row(
        {"what": "carried away", **case},
        {
            "drives": Figure.exact(len(found), better=None),
            "noticed within 3 m or 5 s": share(noticed, "more"),
            "within 10 m": share(again, "more"),
            "found after": Figure.exact_of_inputs(paths or [math.inf], "m"),
        },
    )


def simulated_rows(seeds: int, drives: int, progress: Progress) -> Iterator[Row]:
    """Return what is measured against the truth of the simulator."""
    found = _Measured()
    for seed in range(seeds):
        progress(f"{WORLD} {seed}: mapping and driving again")
        drive = simulated_drive(WORLD, seed)
        known = known_map_of(drive.result)
        found.map_errors.append(drive.map_errors)
        start = _pose(drive, 0)
        found.unchanged.append(measures.follow(known, drive, at=start))
        found.live.append(measures.follow(known, drive, max_path=MAX_PATH_M, live=True))
        later = simulated_drive(WORLD, seed, with_moved_boxes)
        found.moved.append(measures.follow(known_map_of(later.result), later, at=_pose(later, 0)))
        found.carried += _carried(known, drive, seed, drives)
    if seeds:
        yield from found.rows({"drive": f"{WORLD}, {seeds} seeds", "map": "ours"})


@dataclass
class _Measured:
    """What was measured in simulated worlds, by row."""

    unchanged: list[measures.Followed] = field(default_factory=list)
    moved: list[measures.Followed] = field(default_factory=list)
    live: list[measures.Followed] = field(default_factory=list)
    carried: list[measures.CarriedAway] = field(default_factory=list)
    map_errors: list[FloatArray] = field(default_factory=list)

    def rows(self, worlds: Case) -> Iterator[Row]:
        """Yield the rows that anything was measured for."""
        figures = driving_figures(self.unchanged, by_overlap=False)
        map_rms = rms(np.concatenate(self.map_errors))
        figures["rms of the map itself"] = Figure.exact(100.0 * map_rms, "cm")
        yield Row({"what": "tracking", **worlds}, figures)
        moved = driving_figures(self.moved, by_overlap=False)
        yield Row({"what": "tracking, boxes moved", **worlds}, moved)
        yield live_row(worlds, self.live)
        if self.carried:
            yield carried_row(worlds, self.carried)


def _carried(
    known: KnownMap, drive: Drive, seed: int, count: int
) -> Iterator[measures.CarriedAway]:
    """Yield what happened each time that a robot was carried away."""
    rng = np.random.default_rng(seed)
    for _ in range(count):
        at = int(rng.integers(20, 60))
        to = int(rng.integers(200, len(drive.truth) - 200))
        away = carried_away(drive, at, to)
        yield measures.carried_away(known, away, at, MAX_PATH_M)


def alike_rows(seeds: Sequence[int], progress: Progress) -> Iterator[Row]:
    """Return how often a robot is located in the wrong one of two wings that look alike."""
    runs: list[measures.Followed] = []
    for seed in seeds:
        progress(f"{ALIKE} {seed}: mapping and driving again")
        drive = simulated_drive(ALIKE, seed)
        known = known_map_of(drive.result)
        for share_of_drive in ALIKE_STARTS:
            first = int(share_of_drive * len(drive.truth))
            runs.append(measures.follow(known, drive, first, MAX_PATH_M))
    if runs:
        case: Case = {"drive": f"{ALIKE}, {len(seeds)} seeds", "map": "ours"}
        figures = driving_figures(runs, by_overlap=False)
        yield Row({"what": "wings that look alike, from nowhere", **case}, figures)


def changed_rows(seeds: int, progress: Progress) -> Iterator[Row]:
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
        figures = driving_figures(followed, by_overlap=False)
        figures["doors closed"] = Figure.exact(doors, better=None)
        for kind, each in found.items():
            figures[f"{kind}: areas"] = Figure.exact(each.num_areas, better=None)
            figures[f"{kind}: right"] = percent(each.num_right, each.num_areas)
            figures[f"{kind}: could be seen"] = Figure.exact(each.num_things, better=None)
            figures[f"{kind}: reported"] = percent(each.num_found, each.num_things)
        yield Row({"what": "a later day", **case}, figures)


def _pose(drive: Drive, scan: int) -> Pose:
    return Pose(*drive.truth[scan].tolist())
