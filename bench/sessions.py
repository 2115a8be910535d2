# SPDX-License-Identifier: Apache-2.0
"""Recordings cut into sessions, mapped each by itself and merged; places that must stay apart.

Each session is in a frame of its own, and they are merged in shuffled order. The error of the
merged map is compared with that of the uncut run. Rows are kept in a file as soon as they are
measured, so that the benchmark can be interrupted, and measured in pieces.
"""

from __future__ import annotations

import random
import re
import time
from collections import Counter
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, cast

import numpy as np

from bench.environment import environment
from bench.record import Case, Figure, Record, Row
from bench.row_store import RowStore
from bench.session_chance import chance_row
from bench.session_measures import (
    MAX_SESSION_M,
    Drive,
    distances,
    errors,
    is_displaced,
    overlaps,
)
from cartoloop.config import Config
from cartoloop.errors import ConfigError
from cartoloop.first_pass import calibrate
from cartoloop.map_output.output_folder import prepare_folder
from cartoloop.map_output.save import write_file
from cartoloop.mapper import Mapper
from cartoloop.merging import merge
from cartoloop.readers import Log, open_log
from cartoloop.result import Result
from cartoloop.sensor.events import LaserScan, PointCloud, SensorEvent
from cartoloop.session import MAIN_PART
from cartoloop.simulation import make_world, ring, simulate
from cartoloop.stop_request import StopRequest

RECORDINGS = ("intel", "mit-killian", "mit-csail", "fr079", "aces", "museum")
STRANGERS = (
    ("fr079", "intel"),
    ("aces", "mit-csail"),
    *((name, "museum") for name in RECORDINGS[:-1]),
)
"""Places that must not be joined."""

RELATIONS = {"intel": "intel-exact", "mit-csail": "mit-csail", "fr079": "fr079"}
"""Files of verified relations; of other recordings, relations of an earlier map may be given, else
the distance from the uncut run alone is the measure."""

MIN_OVERLAP_M2 = 10.0
"""A session that overlaps the others by this area must be joined [m^2]."""

MIN_STRETCH = 200
"""Scans of a drive in one wing that are mapped; shorter stretches are a turn at the door."""

RING_DRIVES_S = 70.0, 40.0
"""Of two rings of corridors, as much is driven through: once around, and half [s]."""

CUT, STRANGE, WINGS = "cut into sessions", "of different places", "wings that look alike"
RINGS = "rings of one size"
CHANCE = "uncut, begun later and severed"
"""The parts of the benchmark."""


@dataclass(frozen=True)
class Chosen:
    """What is measured.

    Attributes
    ----------
    data : folder of the recordings.
    recordings : which of `RECORDINGS` are cut.
    cuts : into how many sessions each.
    strangers : whether pairs of these recordings are merged that are of different places.
    seeds : of buildings with two wings, and of rings of corridors.
    again : measure cases again that were measured with the same sources.
    relations : folder with NAME.relations of recordings without verified ones.
    later : how often each recording is mapped uncut without its first scans.
    """

    data: Path
    recordings: Sequence[str]
    cuts: Sequence[int]
    strangers: bool
    seeds: Sequence[int]
    again: bool = False
    relations: Path | None = None
    later: int = 0


def run(chosen: Chosen, out: Path, note: Callable[[str], None]) -> Record:
    """Measure what is chosen, and return all that was measured.

    Parameters
    ----------
    chosen : cases.
    out : folder of the records; rows are in ``sessions/rows.jsonl`` as soon as they are there.
    note : called with what is done next.

    Raises
    ------
    ConfigError
        A recording is unknown.
    OutputError
        The rows cannot be written.
    """
    if unknown := [name for name in chosen.recordings if name not in RECORDINGS]:
        raise ConfigError(
            f"no recording {unknown[0]!r} of this benchmark; choose from {', '.join(RECORDINGS)}"
        )
    found = environment()
    store = RowStore(prepare_folder(out / "sessions") / "rows.jsonl", found["commit"])
    for case, measure in _cases(chosen, note):
        if not chosen.again and store.has(case):
            continue
        note(", ".join(map(str, case.values())))
        store.add(measure(case))
        # After each case, so that an interrupted benchmark leaves a record.
        record = Record("sessions", tuple(rows(store)), found)
        write_file(out / f"{record.benchmark}.json", record.to_json())
    return Record("sessions", tuple(rows(store)), found)


def _cases(
    chosen: Chosen, note: Callable[[str], None]
) -> Iterator[tuple[Case, Callable[[Case], Row]]]:
    """Yield each case and what measures it; whole recordings are mapped when they are needed."""
    uncut: dict[str, tuple[Drive, Result] | None] = {}

    def whole(name: str) -> tuple[Drive, Result] | None:
        if name not in uncut:
            drive = _drive(name, chosen.data, chosen.relations)
            note(f"{name}: mapping")
            uncut[name] = None if drive is None else (drive, mapped(drive.events))
        return uncut[name]

    def cut(case: Case) -> Row:
        return _cut_row(case, whole(str(case["case"])))

    def chance(case: Case) -> Row:
        found = whole(str(case["case"]))
        if found is None:
            return Row(case, notes="the recording is not there")
        return chance_row(case, *found, mapped, chosen.later)

    def apart(case: Case) -> Row:
        return _apart_row(case, [whole(name) for name in str(case["case"]).split(" + ")])

    for name in chosen.recordings if chosen.later else ():
        yield {"part": CHANCE, "case": name}, chance
    for name in chosen.recordings:
        for count in chosen.cuts:
            yield {"part": CUT, "case": name, "sessions": count}, cut
    for pair in STRANGERS if chosen.strangers else ():
        if set(pair) <= set(chosen.recordings):
            yield {"part": STRANGE, "case": " + ".join(pair)}, apart
    for seed in chosen.seeds:
        yield {"part": WINGS, "case": f"seed {seed}"}, _wings_row
        yield {"part": RINGS, "case": f"seed {seed}"}, _rings_row


def rows(measured: Iterable[Row]) -> list[Row]:
    """Return the rows of the table: of simulated buildings that look alike, all in one."""
    names = {name: number for number, name in enumerate(RECORDINGS)}
    of_part: dict[str, list[Row]] = {CUT: [], STRANGE: [], WINGS: [], RINGS: [], CHANCE: []}
    for row in measured:
        of_part[str(row.case["part"])].append(row)
    of_part[CUT].sort(key=lambda row: (names[str(row.case["case"])], int(row.case["sessions"])))
    of_part[STRANGE].sort(key=lambda row: str(row.case["case"]))
    of_part[CHANCE].sort(key=lambda row: names[str(row.case["case"])])
    alike = (*_together(of_part[WINGS], "two wings"), *_together(of_part[RINGS], "pairs of rings"))
    return [*of_part[CUT], *of_part[CHANCE], *of_part[STRANGE], *alike]


def _together(measured: Sequence[Row], case: str) -> list[Row]:
    """Return one row for all of a kind of building, with how often which reason was given."""
    if not measured:
        return []
    counts = Counter(kind for row in measured for kind in _kinds(row.notes))
    figures = {
        "buildings": Figure.exact(len(measured), better=None),
        **{
            name: Figure.exact(sum(row.figures[name].value for row in measured))
            for name in ("wrong joins", "not explained")
        },
        "merging": Figure.of_samples([row.figures["merging"].value for row in measured], "CPU s"),
    }
    notes = "; ".join(f"{count} x {kind}" for kind, count in counts.most_common())
    return [Row({"part": measured[0].case["part"], "case": case}, figures, notes)]


def _kinds(notes: str) -> list[str]:
    """Return the reasons in notes, with N for each number."""
    return [re.sub(r"-?\d+(\.\d+)?", "N", each) for each in notes.split("; ") if each]


def _drive(name: str, data: Path, relations: Path | None = None) -> Drive | None:
    """Return a recording; None if it is not there.

    Parameters
    ----------
    data : folder of the recordings.
    relations : folder of files of those that have no verified ones.
    """
    if name == "museum":
        simulated = simulate(make_world("museum"), seed=1)
        return Drive(name, list(simulated.events()), truth=simulated)
    path = data / "radish" / f"{name}.clf.gz"
    if not path.is_file():
        return None
    known = path.parent if name in RELATIONS else relations
    file = None if known is None else known / f"{RELATIONS.get(name, name)}.relations"
    has_file = file is not None and (name in RELATIONS or file.is_file())
    return Drive(name, list(open_log(path)), file if has_file else None)


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


class _Recording:
    """Events as a recording, which the beginning is asked for first as `cartoloop map` does."""

    def __init__(self, events: Sequence[SensorEvent]) -> None:
        self._events = events
        self.num_scans = sum(map(_is_scan, events))

    def __iter__(self) -> Generator[SensorEvent]:
        yield from self._events


def mapped(events: Sequence[SensorEvent]) -> Result:
    """Return the map of events, as `cartoloop map` makes it."""
    config, recording = Config(), cast("Log", _Recording(events))
    mapper = Mapper(config, calibration=calibrate(recording, config, StopRequest()))
    for event in events:
        mapper.add(event)
    return mapper.finish()


def _cut_row(case: Case, whole: tuple[Drive, Result] | None) -> Row:
    """Return the figures of a recording cut into sessions."""
    if whole is None:
        return Row(case, notes="the recording is not there")
    count = int(case["sessions"])
    return cut_row(case, *whole, [mapped(part) for part in sessions_of(whole[0].events, count)])


def cut_row(case: Case, drive: Drive, uncut: Result, maps: Sequence[Result]) -> Row:
    """Return the figures of the maps of the sessions of a recording, merged in shuffled order."""
    areas = overlaps(maps, uncut)
    order = list(range(len(maps)))
    random.Random(len(maps)).shuffle(order)
    merged, seconds = _merged([maps[number] for number in order])
    parts = [session.part for session in merged.sessions]
    main = max(set(parts), key=parts.count)
    is_due = [areas[number] >= MIN_OVERLAP_M2 for number in order]
    is_joined = [part == main for part in parts]
    figures = {
        "joined": Figure.exact(int(np.sum(np.logical_and(is_due, is_joined))), better="more"),
        "overlapping": Figure.exact(sum(is_due), better=None),
    }
    apart = distances(uncut, merged, main)
    figures["wrong joins"] = Figure.exact(apart.num_wrong)
    if (error := errors(drive, uncut, merged, main)) is not None:
        ours, before = error
        figures["error"] = Figure.exact(ours, "m")
        figures["uncut"] = Figure.exact(before, "m", better=None)
        figures["ratio"] = Figure.exact(ours / before)
    figures["from uncut"] = Figure.exact(apart.mean, "m")
    figures["farthest scan"] = Figure.exact(apart.largest, "m")
    figures["farthest session"] = Figure.exact(float(np.nanmax(apart.of_sessions)), "m")
    figures["merging"] = Figure.of_samples([seconds], "CPU s")
    notes = [
        f"session {number + 1}, which shares {areas[number]:.0f} m2, is apart"
        for number, joined in sorted(zip(order, is_joined, strict=True))
        if not joined
    ]
    notes += [
        f"session {number + 1} is {distance:.2f} m from the uncut run, and joined wrongly"
        for number, distance in sorted(zip(order, apart.of_sessions.tolist(), strict=True))
        if distance > MAX_SESSION_M
    ]
    return Row(case, figures, "; ".join(notes + sorted(set(_reasons(merged)))))


def _merged(maps: Sequence[Result]) -> tuple[Result, float]:
    """Return the map of several, and the processor time of making it [s]."""
    start = time.process_time()
    merged = merge(maps)
    return merged, time.process_time() - start


def _reasons(merged: Result) -> list[str]:
    """Return why parts were not joined, as far as they are still apart."""
    joins: list[dict[str, Any]] = merged.report.extra.get("joins", [])
    return [str(join["why_not"]) for join in joins if not join["joined"]]


def _apart_row(case: Case, wholes: Sequence[tuple[Drive, Result] | None]) -> Row:
    """Return the figures of maps that must stay apart."""
    maps = [whole[1] for whole in wholes if whole is not None]
    if len(maps) < len(wholes):
        return Row(case, notes="a recording is not there")
    return apart_row(case, maps)


def apart_row(case: Case, maps: Sequence[Result]) -> Row:
    """Return the figures of maps of different places."""
    merged, seconds = _merged(maps)
    return _verdict_row(case, merged, seconds, is_wrong=_num_joined(merged) > 1)


def _verdict_row(case: Case, merged: Result, seconds: float, *, is_wrong: bool) -> Row:
    why = _reasons(merged)
    figures = {
        "wrong joins": Figure.exact(int(is_wrong)),
        "not explained": Figure.exact(sum(not reason for reason in why)),
        "merging": Figure.of_samples([seconds], "CPU s"),
    }
    return Row(case, figures, "; ".join(why))


def _num_joined(merged: Result) -> int:
    return sum(session.part == MAIN_PART for session in merged.sessions)


def _wings_row(case: Case) -> Row:
    """Return the figures of a building with two wings that look alike, a session in each."""
    seed = int(str(case["case"]).removeprefix("seed "))
    simulated = simulate(make_world("wings", seed), seed=seed)
    walls = simulated.world.walls[:, [0, 2]]
    is_east = simulated.true_poses[:, 0] > 0.5 * (walls.min() + walls.max())
    ends = np.flatnonzero(np.diff(is_east)) + 1
    stretches = [part for part in np.split(np.arange(len(is_east)), ends) if len(part)]
    stretches = [part for part in stretches if len(part) >= MIN_STRETCH][:2]
    maps = []
    for part in stretches:
        first, last = simulated.stamps[part[0]], simulated.stamps[part[-1]]
        events = [
            event for event in simulated.events() if first - 1e-6 <= event.stamp <= last + 1e-6
        ]
        maps.append(mapped(events))
    merged, seconds = _merged(maps)
    is_wrong = _num_joined(merged) > 1 and is_displaced(merged, simulated)
    row = _verdict_row(case, merged, seconds, is_wrong=is_wrong)
    if _num_joined(merged) > 1 and not is_wrong:
        return replace(row, notes="joined rightly")
    return row


def _rings_row(case: Case) -> Row:
    """Return the figures of two rings of corridors as long and as wide, with other alcoves."""
    seed = int(str(case["case"]).removeprefix("seed "))
    drives = [
        simulate(ring(seed + number), seed=seed + number, duration=duration)
        for number, duration in enumerate(RING_DRIVES_S)
    ]
    return apart_row(case, [mapped(list(drive.events())) for drive in drives])
