# SPDX-License-Identifier: Apache-2.0
"""Sections VI-A and VI-B on simulated recordings, and what their truth tells."""

from __future__ import annotations

from bench.document import Section, Table
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


def adjustment_runs(record: Record) -> Section | None:
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
    what = "; ".join(f"*{name}*: {text}" for name, text in SIMULATED.items())
    return Section(
        "Against the truth",
        (
            f"Simulated recordings, where everything is known. {what}. The trajectory is laid on "
            "the truth as a rigid whole:",
            table(rows, errors),
            "A closure is true if its relative pose is within 20 cm and 1° of the truth. A pair of "
            "submap and node could close if at least 60 % of the node's points, placed by the "
            "truth, fall on what the submap's own scans hit; recall is the share of these that the "
            "graph holds a true closure of, though by design only every so many nodes are searched;"
            " a revisit is a pair of submaps, and is recalled if one closure joins them:",
            table(rows_of(record, "true closures"), closures),
        ),
    )
