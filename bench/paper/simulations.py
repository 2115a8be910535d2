# SPDX-License-Identifier: Apache-2.0
"""Sections VI-A and VI-B on simulated recordings, and the errors against their truth."""

from __future__ import annotations

from bench.document import Section, Table
from bench.page_text import page_text
from bench.paper.cells import rows_of, table
from bench.paper.experiments import SIMULATED
from bench.paper.published import published
from bench.record import Record, format_number


def museum(record: Record) -> Section | None:
    """Return section VI-A, None where the museum was not mapped."""
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
    text = page_text()["paper"]["museum"]
    parts: list[str | Table] = [text["text"], Table(["", "cartoloop", "paper"], lines)]
    parts += [
        text["simulation"].format(wall_clock=row.figures["wall clock"].text())
        for row in rows_of(record, "simulation", log="museum")
    ]
    return Section(text["title"], parts)


def adjustment_runs(record: Record) -> Section | None:
    """Return each solution of the museum's pose graph: too long a table for a short report."""
    rows = rows_of(record, "adjustment run", log="museum")
    if not rows:
        return None
    names = ("nodes", "constraints", "iterations", "time")
    lines = [[str(row.case["run"]), *(row.figures[name].text() for name in names)] for row in rows]
    heads = ["run", "nodes", "edges", "iterations", "time [ms]"]
    title = page_text()["paper"]["adjustment_runs"]["title"]
    return Section(title, (Table(heads, lines),), level=3)


def lines(record: Record) -> Section | None:
    """Return table I, None where no lines were measured."""
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
    text = page_text()["paper"]["lines"]
    heads = ["laser tape [m]", "Cartographer [m]", "absolute [m]", "relative [%]"]
    measured = Table(list(columns.values()), lines)
    return Section(text["title"], (text["text"], measured, text["quoted"], Table(heads, paper)))


def truth(record: Record) -> Section | None:
    """Return errors, precision and recall by the truth, None where nothing was simulated."""
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
    recordings = "; ".join(f"*{name}*: {what}" for name, what in SIMULATED.items())
    text = page_text()["paper"]["truth"]
    return Section(
        text["title"],
        (
            text["errors"].format(recordings=recordings),
            table(rows, errors),
            text["closures"],
            table(rows_of(record, "true closures"), closures),
        ),
    )
