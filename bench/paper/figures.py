# SPDX-License-Identifier: Apache-2.0
"""The figures of one finished map for the tables of the paper.

Reads finished output only. A row's case names the experiment and the recording. Figures of other
programs are in the same row, under the names of :data:`.published.SOURCES`.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from bench.command_runs import CommandRun
from bench.paper.mapped_log import MappedLog
from bench.paper.published import SOURCES, published
from bench.record import Case, Figure, Row
from cartoloop.evaluation.closure_scores import evaluate_closures
from cartoloop.evaluation.finished_run import read_run
from cartoloop.evaluation.lines import LinesError, MeasuredLine, measure_lines, read_lines
from cartoloop.evaluation.map_image import read_map
from cartoloop.evaluation.relations import RelationsError, evaluate_relations, read_relations
from cartoloop.evaluation.trajectories import read_tum
from cartoloop.evaluation.trajectory_error import TrajectoryError, evaluate_trajectory
from cartoloop.readers import open_log

ERRORS = {
    "absolute_translational": "m",
    "squared_translational": "m²",
    "absolute_rotational_deg": "deg",
    "squared_rotational_deg2": "deg²",
}
"""The errors of table II, and their units."""


def relations_rows(
    name: str, folder: Path, relations: Path
) -> tuple[list[Row], RelationsError, RelationsError]:
    """Return the rows of tables II and III, and the errors after and before loop closure.

    Parameters
    ----------
    name : of the recording.
    folder : what ``cartoloop map`` wrote.
    relations : file of verified relative poses.
    """
    expected = read_relations(relations)
    after = evaluate_relations(read_tum(folder / "trajectory.tum"), expected)
    before = evaluate_relations(read_tum(folder / "local_trajectory.tum"), expected)
    rows = [_relations_row(name, error, unit, after, before) for error, unit in ERRORS.items()]
    return rows, after, before


def _relations_row(
    name: str, error: str, unit: str, after: RelationsError, before: RelationsError
) -> Row:
    found, local = getattr(after, error), getattr(before, error)
    figures = {
        "mean": Figure.exact(found.mean, unit),
        "std": Figure.exact(found.std, unit),
        "mean before": Figure.exact(local.mean, unit),
        "std before": Figure.exact(local.std, unit),
    }
    bounds: dict[str, float] = getattr(after, f"{error}_percentiles", {})
    figures |= {bound: Figure.exact(value, unit) for bound, value in bounds.items()}
    quoted: dict[str, list[float]] = _published_log(name).get("errors", {}).get(error, {})
    for source, (mean, std) in quoted.items():
        figures[SOURCES[source]] = Figure.exact(mean, unit, better=None)
        figures[f"{SOURCES[source]} std"] = Figure.exact(std, unit, better=None)
    note = f"{after.num_missing} relations name no scan with a pose" if after.num_missing else ""
    return Row({"experiment": "relations", "log": name, "error": error}, figures, note)


def closures_row(name: str, mapped: MappedLog) -> Row:
    """Return the row of table IV: closures, and the share that agrees with the adjusted poses."""
    constraints = mapped.report["constraints"]
    figures = {
        "constraints": Figure.exact(constraints["loop_closure"], better=None),
        "found while mapping": Figure.exact(constraints["found"], better=None),
        "pairs searched": Figure.exact(constraints["searched"], better=None),
    }
    for figure, key in (("precision", "precision"), ("precision of found", "found_precision")):
        if constraints[key] is not None:
            figures[figure] = Figure.exact(100.0 * constraints[key], "%", better="more")
    quoted = _published_log(name)
    for source, value in quoted.get("closures", {}).items():
        figures[SOURCES[source]] = Figure.exact(value, better=None)
    for source, value in quoted.get("precision_percent", {}).items():
        figures[f"{SOURCES[source]} precision"] = Figure.exact(value, "%", better=None)
    return Row({"experiment": "closures", "log": name}, figures)


def performance_row(name: str, mapped: MappedLog) -> Row:
    """Return the row of table V: time and memory of mapping."""
    figures = mapped.cost() | mapped.size()
    quoted = _published_log(name)
    for key, unit, label in (
        ("wall_s", "s", "wall clock"),
        ("cpu_s", "s", "CPU"),
        ("memory_mb", "MB", "peak memory"),
    ):
        for source, value in quoted.get(key, {}).items():
            figures[f"{SOURCES[source]} {label}"] = Figure.exact(value, unit, better=None)
    return Row({"experiment": "performance", "log": name}, figures)


def stages_rows(name: str, mapped: MappedLog) -> list[Row]:
    """Return the time of each stage, including those in background threads."""
    stages: dict[str, dict[str, float]] = mapped.report["stages"]
    return [
        Row(
            {"experiment": "stages", "log": name, "stage": stage},
            {
                "calls": Figure.exact(times["calls"], better=None),
                "total": Figure(times["total_s"], "s"),
                "median": Figure(times["median_ms"], "ms"),
                "99 %": Figure(times["p99_ms"], "ms"),
            },
        )
        for stage, times in stages.items()
    ]


def adjustment_row(name: str, mapped: MappedLog) -> Row:
    """Return sizes, iterations and times of the adjustment of the pose graph (section VI-A)."""
    runs: list[dict[str, float]] = mapped.report["adjustment"]["each"]
    times = [run["ms"] for run in runs]
    largest = max(runs, key=lambda run: run["constraints"])
    figures = {
        "runs": Figure.exact(len(runs), better=None),
        "iterations": Figure.exact(float(np.mean([run["iterations"] for run in runs]))),
        "median run": Figure(float(np.median(times)), "ms"),
        "longest run": Figure(max(times), "ms"),
        "largest graph": Figure.exact(largest["constraints"], better=None),
        "its iterations": Figure.exact(largest["iterations"]),
        "its time": Figure(largest["ms"], "ms"),
    }
    return Row({"experiment": "adjustment", "log": name}, figures)


def adjustment_run_rows(name: str, mapped: MappedLog) -> list[Row]:
    """Return every solution of the pose graph in order: size, iterations and time."""
    return [
        Row(
            {"experiment": "adjustment run", "log": name, "run": number},
            {
                "nodes": Figure.exact(run["nodes"], better=None),
                "constraints": Figure.exact(run["constraints"], better=None),
                "iterations": Figure.exact(run["iterations"], better=None),
                "time": Figure(run["ms"], "ms", better=None),
            },
        )
        for number, run in enumerate(mapped.report["adjustment"]["each"], start=1)
    ]


def trajectory_row(
    name: str, folder: Path, truth: Path
) -> tuple[Row, TrajectoryError, TrajectoryError]:
    """Return the row of errors against the truth, and the errors after and before loop closure."""
    true = read_tum(truth)
    after = evaluate_trajectory(read_tum(folder / "trajectory.tum"), true)
    before = evaluate_trajectory(read_tum(folder / "local_trajectory.tum"), true)
    figures = {
        "mean": Figure.exact(float(after.absolute.translation.mean()), "m"),
        "rmse": Figure.exact(_rmse(after), "m"),
        "max": Figure.exact(float(after.absolute.translation.max()), "m"),
        "rotation": Figure.exact(float(after.absolute.rotation_deg.mean()), "deg"),
        "over 1 m": Figure.exact(float(after.relative.translation.mean()), "m"),
        "over 1 m, rotation": Figure.exact(float(after.relative.rotation_deg.mean()), "deg"),
        "mean before": Figure.exact(float(before.absolute.translation.mean()), "m"),
        "max before": Figure.exact(float(before.absolute.translation.max()), "m"),
    }
    return Row({"experiment": "trajectory", "log": name}, figures), after, before


def true_closures_row(name: str, folder: Path, truth: Path, log: Path) -> Row:
    """Return precision and recall of the closures by the truth."""
    score = evaluate_closures(read_run(folder), read_tum(truth), open_log(log))
    figures = {
        "final": Figure.exact(score.final.constraints, better=None),
        "found": Figure.exact(score.found.constraints, better=None),
    }
    shares = {
        "true precision": score.final.true_precision,
        "true precision of found": score.found.true_precision,
    }
    if score.final.recall is not None:
        figures["pairs that could close"] = Figure.exact(score.final.recall.pairs, better=None)
        figures["revisits"] = Figure.exact(score.final.recall.revisits, better=None)
        shares["recall of pairs"] = score.final.recall.of_pairs
        shares["recall of revisits"] = score.final.recall.of_revisits
    for label, share in shares.items():
        if share is not None:
            figures[label] = Figure.exact(100.0 * share, "%", better="more")
    return Row({"experiment": "true closures", "log": name}, figures)


def lines_rows(name: str, folder: Path, lines: Path) -> tuple[list[Row], LinesError]:
    """Return table I: each line measured in the map's picture, against its true length."""
    measured = measure_lines(read_map(folder), read_lines(lines))
    return [
        _line_row(name, number, line, measured.resolution)
        for number, line in enumerate(measured.lines, start=1)
    ], measured


def _line_row(name: str, number: int, line: MeasuredLine, resolution: float) -> Row:
    case: Case = {"experiment": "lines", "log": name, "line": number}
    length, error, relative = line.length, line.error, line.relative_error
    pixels = line.error_pixels_per_end(resolution)
    if line.tape is None or length is None or error is None or relative is None or pixels is None:
        return Row(case, notes="no wall was found at an end of the line")
    return Row(
        case,
        {
            "tape": Figure.exact(line.tape, "m", better=None),
            "map": Figure.exact(length, "m", better=None),
            "error": Figure.exact(error, "m", better=None),
            "absolute error": Figure.exact(abs(error), "m"),
            "relative": Figure.exact(100.0 * relative, "%", better=None),
            "pixels an end": Figure.exact(abs(pixels)),
        },
    )


def simulation_row(name: str, run: CommandRun) -> Row:
    """Return the cost of simulating a recording, which is not part of mapping it."""
    return Row(
        {"experiment": "simulation", "log": name},
        {
            "wall clock": Figure(run.wall_s, "s"),
            "CPU": Figure(run.cpu_s, "s"),
            "peak memory": Figure(run.peak_memory_mb, "MB"),
        },
    )


def variant_row(case: Case, folder: Path, relations: Path) -> Row:
    """Return the error of a map made with a parameter that is not the default."""
    error = evaluate_relations(read_tum(folder / "trajectory.tum"), read_relations(relations))
    return Row(
        case,
        {
            "translation": Figure.exact(error.absolute_translational.mean, "m"),
            "translation std": Figure.exact(error.absolute_translational.std, "m"),
            "rotation": Figure.exact(error.absolute_rotational_deg.mean, "deg"),
            "rotation std": Figure.exact(error.absolute_rotational_deg.std, "deg"),
        },
    )


def failed_row(case: Case, reason: str) -> Row:
    """Return a row without figures, with the reason."""
    return Row(case, notes=reason)


def _rmse(error: TrajectoryError) -> float:
    return float(np.sqrt(np.mean(error.absolute.translation**2)))


def _published_log(name: str) -> dict[str, Any]:
    found: dict[str, Any] = published()["logs"].get(name, {})
    return found
