# SPDX-License-Identifier: Apache-2.0
"""The benchmark: all runs that were asked for, and a table of their figures."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

import numpy as np

from bench.environment import environment
from bench.record import Better, Figure, Record, Row
from bench.robustness.changes import change_of
from bench.robustness.parts import HANDICAPPED, PARTS, WORLDS, RobustnessOptions, Runner
from bench.robustness.runs import NO_VERDICT, Run, RunStore
from bench.robustness.simulated_worlds import simulated_worlds
from cartoloop.errors import ConfigError
from cartoloop.map_output.output_folder import prepare_folder
from cartoloop.map_output.save import write_file

GROSSLY_WRONG_M = 0.3
"""Mean error against the truth from which on a map is wrong, and its verdict should say so [m]."""

RIGHT_VERDICT = "good"


def parts_named(names: Sequence[str]) -> list[str]:
    """Return the parts whose names contain one of the given words; all if there are none.

    Raises
    ------
    ConfigError
        A word is in the name of no part.
    """
    for name in names:
        if not any(name in part for part in PARTS):
            raise ConfigError(f"no part {name!r} of this benchmark; choose from {', '.join(PARTS)}")
    return [part for part in PARTS if not names or any(name in part for name in names)]


def run(options: RobustnessOptions, progress: Callable[[str], None]) -> Record:
    """Make the runs that are not there yet and return the figures of all runs of this commit.

    Runs are in the file ``runs.jsonl`` as soon as each is done: an interrupted benchmark goes on
    where it was. Logs and maps of runs whose error is above the bar are kept.

    Raises
    ------
    ConfigError
        A change or a world is unknown.
    OutputError
        The runs cannot be written.
    """
    for name in options.changes:
        change_of(name)
    table = simulated_worlds()
    if unknown := [name for name in options.worlds if name not in table]:
        raise ConfigError(
            f"no world {unknown[0]!r} of this benchmark; choose from {', '.join(table)}"
        )
    found = environment()
    prepare_folder(options.folder)
    store = RunStore(options.folder / "runs.jsonl", found["commit"])
    for _ in Runner(options, store, found["commit"], progress).run():
        # After each run, so that an interrupted benchmark leaves a record.
        record = Record("robustness", tuple(rows(store)), found)
        write_file(options.out / f"{record.benchmark}.json", record.to_json())
    return Record("robustness", tuple(rows(store)), found)


def rows(runs: Iterable[Run]) -> list[Row]:
    """Return a row for each case, its seeds together, and a row on the verdicts of wrong maps."""
    cases: dict[tuple[str, str], list[Run]] = {}
    for one in runs:
        cases.setdefault((one.part, one.case), []).append(one)
    order = {part: number for number, part in enumerate(PARTS)}
    ordered = sorted(cases.items(), key=lambda item: order[item[0][0]])
    found = [_row(part, case, same) for (part, case), same in ordered]
    everything = [one for same in cases.values() for one in same]
    return [*found, *_verdict_rows(everything)]


def _row(part: str, case: str, same: Sequence[Run]) -> Row:
    figures: dict[str, Figure] = {"runs": Figure.exact(len(same), better=None)}
    judged = [one.is_right for one in same if one.is_right is not None]
    if judged:
        figures["right"] = Figure.exact(sum(judged), better="more")
    for name, label, unit, share in (
        ("error", "error", "m", 1.0),
        ("bar", "bar", "m", 1.0),
        ("precision", "precision of found", "%", 100.0),
        ("false joins", "false joins", "", 1.0),
        ("scale", "odometry scale", "", 1.0),
        ("yaw", "odometry yaw", "deg", 1.0),
        ("calibration", "calibration off, of its bar", "", 1.0),
        ("cpu", "CPU", "s", 1.0),
    ):
        values = [share * one.figures[name] for one in same if name in one.figures]
        if not values:
            continue
        better: Better = None if name in ("bar", "scale", "yaw") else "less"
        if name == "cpu":
            figures[label] = Figure.of_samples(values, unit)
        elif name == "precision":
            figures[label] = Figure.exact_of_inputs(values, unit, better="more")
        else:
            figures[label] = Figure.exact_of_inputs(values, unit, better=better)
        if name == "error" and len(values) > 1:
            figures["largest error"] = Figure.exact(max(values), unit)
    return Row({"part": part, "case": case}, figures, "; ".join(_notes(same)))


def _notes(same: Sequence[Run]) -> list[str]:
    """Return the verdicts, the seeds that are wrong, and failures."""
    verdicts: dict[str, int] = {}
    for one in same:
        if not one.failure:
            verdicts[one.verdict] = verdicts.get(one.verdict, 0) + 1
    notes = []
    if set(verdicts) - {NO_VERDICT}:
        notes.append("verdict " + ", ".join(f"{name}: {n}" for name, n in sorted(verdicts.items())))
    wrong = [one for one in same if one.is_right is False and not one.failure]
    if wrong and len(same) > 1:
        notes.append("wrong seeds " + ", ".join(str(one.seed) for one in wrong))
    notes += [f"seed {one.seed}: {one.failure}" for one in same if one.failure][:1]
    return notes


def _verdict_rows(runs: Sequence[Run]) -> list[Row]:
    """Return how many maps of worlds, right and wrong by the truth, have which verdict."""
    with_truth = [one for one in runs if one.part in (WORLDS, HANDICAPPED)]
    judged = [one for one in with_truth if one.verdict != NO_VERDICT and "error" in one.figures]
    found = []
    for label, is_wrong in (("right maps", False), ("wrong maps", True)):
        same = [one for one in judged if (one.figures["error"] > GROSSLY_WRONG_M) == is_wrong]
        if same:
            flagged = 100.0 * float(np.mean([one.verdict != RIGHT_VERDICT for one in same]))
            figures = {
                "runs": Figure.exact(len(same), better=None),
                "flagged": Figure.exact(flagged, "%", better="more" if is_wrong else "less"),
            }
            found.append(Row({"part": "verdicts", "case": label}, figures))
    return found
