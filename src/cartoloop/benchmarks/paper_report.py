# SPDX-License-Identifier: Apache-2.0
"""The record of the paper's experiments as sections of a report, table by table."""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any

from cartoloop.benchmarks.document import Picture, Section, Table
from cartoloop.benchmarks.paper import SIMULATED
from cartoloop.benchmarks.paper_pictures import PICTURES
from cartoloop.benchmarks.published import SOURCES, published
from cartoloop.benchmarks.record import Figure, Record, Row, format_number

TITLES = {
    "absolute_translational": "absolute translational [m]",
    "squared_translational": "squared translational [m²]",
    "absolute_rotational_deg": "absolute rotational [deg]",
    "squared_rotational_deg2": "squared rotational [deg²]",
}
BOUNDS = ("p50", "p75", "p90", "p95", "p99", "max")


def sections(record: Record, pictures: Path | None = None, prefix: str = "paper") -> list[Section]:
    """Return the report.

    Parameters
    ----------
    record : of ``cartoloop bench paper``.
    pictures : folder with a folder of pictures for each recording; None for a short report,
        without them and without what takes a page of rows.
    prefix : path of that folder as seen from the report.
    """
    found = [
        _relations(record),
        _percentiles(record),
        _closures(record),
        _performance(record),
        _museum(record),
        None if pictures is None else _adjustment_runs(record),
        _lines(record),
        _truth(record),
        _variants(record),
        _behind(record),
        _missing(record),
        *_pictures(record, pictures, prefix),
    ]
    return [section for section in found if section is not None]


def title_of(log: str) -> str:
    """Return a recording's name as the paper writes it."""
    found: str = published()["logs"].get(log, {}).get("title", log)
    return found


def rows_of(record: Record, experiment: str, **case: str) -> list[Row]:
    """Return the rows of an experiment that have figures."""
    wanted = {"experiment": experiment, **case}
    return [row for row in record.rows if row.figures and wanted.items() <= row.case.items()]


def _relations(record: Record) -> Section | None:
    rows = rows_of(record, "relations")
    if not rows:
        return None
    lines = []
    for row in rows:
        figures = row.figures
        others = [figures[source].value for source in SOURCES.values() if source in figures]
        is_best = not others or figures["mean"].value <= min(others)
        ours = _mean_std(figures, "mean", "std")
        lines.append(
            [
                title_of(str(row.case["log"])),
                TITLES[str(row.case["error"])],
                f"**{ours}**" if is_best else ours,
                _mean_std(figures, "mean before", "std before"),
                *(_quoted(figures, source) for source in SOURCES.values()),
            ]
        )
    heads = ["", "error", "cartoloop", "before loop closure", *SOURCES.values()]
    text = (
        "Mean ± standard deviation over all relations; bold where no other program's is lower. The "
        "columns of others are quoted, not reproduced by this repository: the paper's from other "
        "hardware and the original recordings, those of the C++ program from these files, its "
        "settings tuned by looking at the truth. One set of defaults serves all recordings; it was "
        "settled while looking at the scores of MIT CSAIL, Freiburg and Intel and at the maps of "
        "ACES and Killian Court, so on these the figures are those of a development set."
    )
    return Section(
        "Tables II and III: error against verified relations", (text, Table(heads, lines))
    )


def _percentiles(record: Record) -> Section | None:
    rows = [row for row in rows_of(record, "relations") if BOUNDS[0] in row.figures]
    if not rows:
        return None
    lines = [
        [
            title_of(str(row.case["log"])),
            TITLES[str(row.case["error"])],
            *(format_number(row.figures[bound].value) for bound in BOUNDS),
        ]
        for row in rows
    ]
    heads = ["", "error", *(bound.replace("p", "") + " %" for bound in BOUNDS[:-1]), "max"]
    return Section(
        "The same by percentiles",
        ("So many of the relations have no larger error.", Table(heads, lines)),
        level=3,
    )


def _closures(record: Record) -> Section | None:
    rows = rows_of(record, "closures")
    if not rows:
        return None
    columns = {
        "constraints": "constraints",
        "precision": "precision [%]",
        "found while mapping": "found while mapping",
        "precision of found": "their precision [%]",
        SOURCES["paper"]: "paper",
        f"{SOURCES['paper']} precision": "paper's precision [%]",
        SOURCES["cpp"]: "C++",
        f"{SOURCES['cpp']} precision": "C++ precision [%]",
    }
    text = (
        "Loop closure constraints, and the share of them that the solution of (SPA) does not "
        "violate by more than 20 cm or 1°. *Constraints* are those of the finished graph: in the "
        "end every node is matched anew, from where it stands, to the submaps that it overlaps, "
        "and these matches take the place of what was found while mapping; those rejected as "
        "contradicting the rest count as wrong. *Found while mapping* is what branch and bound "
        "found, which is what the paper counts."
    )
    return Section("Table IV: loop closure precision", (text, _table(rows, columns)))


def _performance(record: Record) -> Section | None:
    rows = rows_of(record, "performance")
    if not rows:
        return None
    columns = {
        "duration": "duration [s]",
        "wall clock": "wall clock [s]",
        "CPU": "CPU [s]",
        "peak memory": "peak memory [MB]",
        "times real time": "times real time",
        f"{SOURCES['paper']} wall clock": "paper, wall clock [s]",
        f"{SOURCES['cpp']} CPU": "C++, CPU [s]",
        f"{SOURCES['cpp']} peak memory": "C++, memory [MB]",
    }
    text = (
        "Whole runs of `cartoloop map`, start of the interpreter included, kernels compiled "
        "before; median ± half of the spread between the 10 % and 90 % quantiles."
    )
    return Section("Table V: performance", (text, _table(rows, columns)))


def _museum(record: Record) -> Section | None:
    cost = rows_of(record, "performance", log="museum")
    solved = rows_of(record, "adjustment", log="museum")
    if not (cost and solved):
        return None
    figures = cost[0].figures | solved[0].figures
    quoted = published()["museum"]
    names = {
        "duration": ("data [s]", "duration_s"),
        "path length": ("path [m]", "path_length_m"),
        "nodes": ("nodes", "nodes"),
        "constraints": ("edges", "constraints"),
        "CPU": ("CPU [s]", "cpu_s"),
        "wall clock": ("wall clock [s]", "wall_s"),
        "peak memory": ("peak memory [MB]", "memory_mb"),
        "iterations": ("iterations of a typical solution", "iterations"),
        "median run": ("time of a typical solution [ms]", "adjustment_ms"),
        "longest run": ("time of the longest solution [ms]", ""),
    }
    lines = [
        [label, figures[name].text(), format_number(quoted[key]) if key else ""]
        for name, (label, key) in names.items()
    ]
    text = (
        "The Deutsches Museum is not public: this is a simulated museum of the same size, "
        "walked through with a scanner of 1,079 beams over 270°, 30 m, 10 Hz, without odometry "
        "(`cartoloop simulate museum`)."
    )
    parts: list[str | Table] = [text, Table(["", "cartoloop", "paper"], lines)]
    parts += [
        f"To simulate the recording took {row.figures['wall clock'].text()} s before that."
        for row in rows_of(record, "simulation", log="museum")
    ]
    return Section("Section VI-A: a museum", parts)


def _adjustment_runs(record: Record) -> Section | None:
    """Return each solution of the museum's pose graph: too long a table for a short report."""
    rows = rows_of(record, "adjustment run", log="museum")
    if not rows:
        return None
    names = ("nodes", "constraints", "iterations", "time")
    lines = [[str(row.case["run"]), *(row.figures[name].text() for name in names)] for row in rows]
    return Section(
        "Each run of the museum's pose adjustment",
        (Table(["run", "nodes", "edges", "iterations", "time [ms]"], lines),),
        level=3,
    )


def _lines(record: Record) -> Section | None:
    rows = rows_of(record, "lines")
    if not rows:
        return None
    columns = {
        "tape": "laser tape [m]",
        "map": "cartoloop [m]",
        "error": "error (absolute) [m]",
        "relative": "error (relative) [%]",
        "pixels an end": "pixels an end",
    }
    quoted = published()["lines"]
    paper = [
        [f"{tape:.2f}", f"{found:.2f}", f"{found - tape:+.2f}", f"{(found / tape - 1) * 100:+.1f}"]
        for tape, found in zip(quoted["tape_m"], quoted["map_m"], strict=True)
    ]
    signed = {"error", "relative"}
    lines = [
        [f"{row.figures[name].value:{'+' if name in signed else ''}.3f}" for name in columns]
        for row in rows
    ]
    return Section(
        "Section VI-B, table I: straight lines in the map of a cheap scanner",
        (
            "A simulated scanner in the class of the Revo LDS: 360 beams, 0.15 to 6 m, noise of 1 "
            "to 3 %, 2 Hz, pushed through a flat without odometry (`cartoloop simulate flat`). "
            "Lengths are measured from wall to wall in the finished map's picture "
            "(`cartoloop evaluate lines`); a pixel is 5 cm.",
            Table(list(columns.values()), lines),
            "The paper's lines, with the real scanner in another flat:",
            Table(["laser tape [m]", "Cartographer [m]", "absolute [m]", "relative [%]"], paper),
        ),
    )


def _truth(record: Record) -> Section | None:
    rows = rows_of(record, "trajectory")
    if not rows:
        return None
    errors = {
        "mean": "mean [m]",
        "max": "max [m]",
        "rotation": "rotation [deg]",
        "over 1 m": "over 1 m [m]",
        "mean before": "mean before loop closure [m]",
        "max before": "max before [m]",
    }
    closures = {
        "final": "closures",
        "true precision": "true precision [%]",
        "found": "found while mapping",
        "true precision of found": "their true precision [%]",
        "pairs that could close": "pairs that could close",
        "recall of pairs": "recall [%]",
        "revisits": "revisits",
        "recall of revisits": "recall of revisits [%]",
    }
    what = "; ".join(f"*{name}*: {text}" for name, text in SIMULATED.items())
    return Section(
        "Against the truth",
        (
            f"Simulated recordings, where everything is known. {what}. The trajectory is laid on "
            "the truth as a rigid whole:",
            _table(rows, errors),
            "A closure is true if its relative pose is within 20 cm and 1° of the truth. A pair of "
            "submap and node could close if at least 60 % of the node's points, placed by the "
            "truth, fall on what the submap's own scans hit; recall is the share of these that the "
            "graph holds a true closure of, though by design only every so many nodes are searched;"
            " a revisit is a pair of submaps, and is recalled if one closure joins them:",
            _table(rows_of(record, "true closures"), closures),
        ),
    )


def _variants(record: Record) -> Section | None:
    rows = rows_of(record, "variants")
    if not rows:
        return None
    lines = [
        [
            title_of(str(row.case["log"])),
            f"`--set {row.case['setting']}`",
            _mean_std(row.figures, "translation", "translation std"),
            _mean_std(row.figures, "rotation", "rotation std"),
        ]
        for row in rows
    ]
    return Section(
        "What depends on what",
        (
            "The same recordings with a parameter that is not the default.",
            Table(["", "setting", "translation [m]", "rotation [deg]"], lines),
        ),
    )


def _behind(record: Record) -> Section | None:
    """Return what others do better, found by comparison, and why as far as it is known."""
    lines = _costlier(record)
    for row in rows_of(record, "relations"):
        figures = row.figures
        better = [
            source
            for source in SOURCES.values()
            if source in figures and figures[source].value < figures["mean"].value
        ]
        if better:
            log, error = str(row.case["log"]), str(row.case["error"])
            named = ", ".join(f"{source} {figures[source].value:g}" for source in better)
            reason = _remarks().get(log, {}).get(error, "not known")
            lines.append(
                [title_of(log), TITLES[error], format_number(figures["mean"].value), named, reason]
            )
    if not lines:
        return None
    return Section(
        "Where we are behind, and why",
        (
            "Every error of tables II and III where another program's is lower, and whatever of "
            "tables IV and V another program does better.",
            Table(["", "figure", "cartoloop", "others", "why"], lines),
        ),
    )


def _costlier(record: Record) -> list[list[str]]:
    """Return where others have more precise closures, or take less time, processor or memory."""
    compared = (
        ("closures", "precision", "", "precision [%]"),
        ("closures", "precision of found", "precision", "precision of found [%]"),
        ("performance", "wall clock", "", "wall clock [s]"),
        ("performance", "CPU", "", "CPU [s]"),
        ("performance", "peak memory", "", "peak memory [MB]"),
    )
    lines = []
    for experiment, name, theirs, label in compared:
        for row in rows_of(record, experiment):
            if name not in row.figures:
                continue
            own, sign = row.figures[name], 1 if row.figures[name].better == "less" else -1
            better = [
                f"{source} {row.figures[f'{source} {theirs or name}'].value:g}"
                for source in SOURCES.values()
                if f"{source} {theirs or name}" in row.figures
                and sign * row.figures[f"{source} {theirs or name}"].value < sign * own.value
            ]
            if better:
                log = str(row.case["log"])
                reason = _remarks().get(log, {}).get(name) or _remarks()["any"].get(name)
                lines.append(
                    [title_of(log), label, own.text(), ", ".join(better), reason or "not known"]
                )
    return lines


def _missing(record: Record) -> Section | None:
    lines = [
        [title_of(str(row.case["log"])), str(row.case["experiment"]), row.notes]
        for row in record.rows
        if row.notes
    ]
    if not lines:
        return None
    return Section("What is missing, or failed", (Table(["", "experiment", "reason"], lines),))


def _pictures(record: Record, folder: Path | None, prefix: str) -> list[Section]:
    if folder is None:
        return []
    found = []
    for log in dict.fromkeys(str(row.case["log"]) for row in rows_of(record, "performance")):
        pictures = [
            Picture(f"{prefix}/{log}/{name}", f"{title_of(log)}: {what}")
            for name, what in PICTURES.items()
            if (folder / log / name).exists()
        ]
        if pictures:
            found.append(Section(title_of(log), pictures, level=3))
    return [Section("Pictures"), *found] if found else []


def _table(rows: Sequence[Row], columns: dict[str, str]) -> Table:
    """Return a table of the columns that any row has, one row a recording."""
    shown = {
        name: head for name, head in columns.items() if any(name in row.figures for row in rows)
    }
    lines = [
        [
            title_of(str(row.case["log"])),
            *(row.figures[name].text() if name in row.figures else "" for name in shown),
        ]
        for row in rows
    ]
    return Table(["", *shown.values()], lines)


def _mean_std(figures: dict[str, Figure], mean: str, std: str) -> str:
    if mean not in figures:
        return ""
    return f"{format_number(figures[mean].value)} ± {format_number(figures[std].value)}"


def _quoted(figures: dict[str, Figure], source: str) -> str:
    """Return a figure of others as they wrote it."""
    if source not in figures:
        return ""
    return f"{figures[source].value:g} ± {figures[f'{source} std'].value:g}"


@cache
def _remarks() -> dict[str, Any]:
    return tomllib.loads(files("cartoloop.benchmarks").joinpath("remarks.toml").read_text("utf-8"))
