# SPDX-License-Identifier: Apache-2.0
"""Rows of the benchmark of localisation on maps of other buildings, and of offices alike."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from bench.localisation import measures
from bench.localisation.drives import Drive, simulated_drive
from bench.localisation.figures import percent, share
from bench.localisation.images import IMAGE, OURS, known_maps_of
from bench.localisation.world_rows import Progress
from bench.record import Case, Figure, Row
from cartoloop.arrays import FloatArray
from cartoloop.localisation.known_map import KnownMap
from cartoloop.sensor.pose import Pose, compose, compose_all, inverse

OFFICE = "office"
"""Offices of all seeds have the outline, the lobby and the corridors in common, and no room."""

OTHERS = ("flat", "ring", "wings")
"""Worlds that have nothing in common with it."""

RING = "ring"
"""Rings of all seeds have corridors of one length and width; their alcoves and doors differ."""

OTHERS_S = 200.0
"""Duration of the drives that map these, and of those in them [s]."""

PATH_M = 20.0
"""Within this path a robot in the map of another building is to say so [m]."""

NUM_SCANS = 60
"""Single scans that are searched in the map of another building."""

FIRST_PATH_M = 8.0
"""Path of the drives in a map of the same plan [m]: on the first metres, a search comes after each
half metre."""

LAST_START = 0.9
"""The last drive of several begins after this share of the scans."""


def stranger_rows(seeds: Sequence[int], drives: int, progress: Progress) -> Iterator[Row]:
    """Return how often a place is claimed in the map of another building.

    Parameters
    ----------
    seeds : of worlds.
    drives : in each map, from scans spread over the drive.
    """
    found = {given: _Strangers() for given in (OURS, IMAGE)}
    for seed in seeds:
        office = simulated_drive(OFFICE, seed)
        for name in OTHERS:
            other = simulated_drive(name, seed, duration=OTHERS_S)
            for drive, mapped in ((office, other), (other, office)):
                for given, known in known_maps_of(mapped.result).items():
                    progress(f"{drive.name} in the map of {mapped.name}, {given}")
                    found[given].measure(known, drive, mapped.truth, drives)
    if seeds:
        for given, strangers in found.items():
            yield from strangers.rows(f"{OFFICE} and {', '.join(OTHERS)}, {_range(seeds)}", given)
        yield from _same_size_rows(seeds, drives, progress)
        yield from _same_plan_rows(seeds, drives, progress)


@dataclass
class _Strangers:
    """What was measured in maps of other buildings."""

    runs: list[measures.Followed] = field(default_factory=list)
    given: list[measures.Followed] = field(default_factory=list)
    claimed: list[bool] = field(default_factory=list)

    def measure(self, known: KnownMap, drive: Drive, there: FloatArray, count: int) -> None:
        """Drive in the map of another building, from nowhere and from poses there.

        Parameters
        ----------
        there : float64, shape (n, 3), poses in the map.
        """
        self.claimed += measures.single_scans(known, drive, NUM_SCANS).claimed
        for first in _starts(drive, count):
            self.runs.append(measures.follow(known, drive, first, PATH_M))
            at = Pose(*there[int(first / len(drive.truth) * len(there))].tolist())
            self.given.append(measures.follow(known, drive, first, PATH_M, at))

    def rows(self, drives: str, given: str) -> Iterator[Row]:
        """Yield a row of each, given the drives, and what is given of the maps."""
        case: Case = {"drive": drives, "map": given}
        yield stranger_row(case, self.runs)
        yield stranger_row(case, self.given, ", from a wrong pose")
        yield stranger_scans_row(case, self.claimed)


def stranger_row(case: Case, runs: Sequence[measures.Followed], how: str = "") -> Row:
    """Return how often a robot is located in the map of another building."""
    decisions = sum(sum(run.states.values()) for run in runs)
    located = np.array([run.num_located for run in runs])
    paths = np.array([run.unlocated_path for run in runs])
    return Row(
        {"what": f"in the map of another building{how}", **case},
        {
            "drives": Figure.exact(len(runs), better=None),
            "drives with a wrong claim": share(located > 0, "less"),
            "says so within 20 m": share(paths <= PATH_M, "more"),
            "wrong": percent(int(located.sum()), decisions, "less"),
            "longest located": Figure.exact(max(run.longest_located_s for run in runs), "s"),
        },
    )


def stranger_scans_row(case: Case, claimed: Sequence[bool]) -> Row:
    """Return how often a single scan is claimed in the map of another building."""
    return Row(
        {"what": "one scan, in the map of another building", **case},
        {
            "scans": Figure.exact(len(claimed), better=None),
            "wrong": Figure.exact(100.0 * float(np.mean(claimed)), "%"),
        },
    )


def _same_size_rows(seeds: Sequence[int], drives: int, progress: Progress) -> Iterator[Row]:
    """Yield how often a place is claimed in the map of the next ring, of the same corridors."""
    runs: dict[str, list[measures.Followed]] = {OURS: [], IMAGE: []}
    for seed, other in _pairs(seeds):
        mapped = simulated_drive(RING, seed, duration=OTHERS_S)
        drive = simulated_drive(RING, other, duration=OTHERS_S)
        for given, known in known_maps_of(mapped.result).items():
            progress(f"{drive.name} in the map of {mapped.name}, {given}")
            firsts = _starts(drive, drives)
            runs[given] += [measures.follow(known, drive, first, PATH_M) for first in firsts]
    for given, each in runs.items():
        if each:
            case: Case = {"drive": f"{RING}, {_range(seeds)}", "map": given}
            yield stranger_row(case, each, " of the same size")


def _pairs(seeds: Sequence[int]) -> list[tuple[int, int]]:
    """Return each seed with the next one, and the last with the first; none of a single seed."""
    return list(zip(seeds, (*seeds[1:], *seeds[:1]), strict=True)) if len(seeds) > 1 else []


def _same_plan_rows(seeds: Sequence[int], drives: int, progress: Progress) -> Iterator[Row]:
    """Yield where places are claimed in the map of the next office, given those of one plan."""
    runs: dict[str, list[measures.Followed]] = {OURS: [], IMAGE: []}
    for seed, other in _pairs(seeds):
        mapped, drive = simulated_drive(OFFICE, seed), simulated_drive(OFFICE, other)
        drive = in_map_of(mapped, drive)
        firsts = _starts(drive, drives)
        for given, known in known_maps_of(mapped.result).items():
            progress(f"{OFFICE} {other} in the map of {seed}, which has the same plan, {given}")
            runs[given] += [measures.follow(known, drive, first, FIRST_PATH_M) for first in firsts]
    for given, each in runs.items():
        if each:
            yield same_plan_row({"drive": f"{OFFICE}, {_range(seeds)}", "map": given}, each)


def same_plan_row(case: Case, runs: Sequence[measures.Followed]) -> Row:
    """Return how often a robot is located where it is in the plan, and how often elsewhere."""
    decisions = sum(sum(run.states.values()) for run in runs)
    wrong = np.array([run.num_wrong for run in runs])
    located = np.array([run.num_located for run in runs])
    return Row(
        {"what": "the first metres in the map of an office of the same plan", **case},
        {
            "drives": Figure.exact(len(runs), better=None),
            "located where it is in the plan": percent(
                int((located - wrong).sum()), decisions, None
            ),
            "drives with a wrong claim": share(wrong > 0, "less"),
            "wrong": percent(int(wrong.sum()), decisions, "less"),
        },
    )


def in_map_of(mapped: Drive, drive: Drive) -> Drive:
    """Return a drive with its true poses in the map of another world, which has the same plan."""
    tf_map_drive_map = compose(mapped.tf_map_world, inverse(drive.tf_map_world))
    return replace(drive, truth=compose_all(np.array(tf_map_drive_map), drive.truth))


def _starts(drive: Drive, count: int) -> list[int]:
    """Return the scans that drives begin with."""
    return [int(share * len(drive.truth)) for share in np.linspace(0.0, LAST_START, count)]


def _range(seeds: Sequence[int]) -> str:
    return f"seeds {seeds[0]} to {seeds[-1]}"
