# SPDX-License-Identifier: Apache-2.0
"""The section of the results page on what bounds the speed."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

from bench.adjustment.benchmark import HELD_NAME, OWN_NAME
from bench.document import Section, Table
from bench.page_text import page_text
from bench.paper.cells import title_of
from bench.record import Record, Row, format_number

_OTHER_THREADS: Final = ("search", "wait for searches", "match again")
"""Stages that do not run, or do not run alone, in the mapping thread."""


def speed_bounds(records: dict[str, Record]) -> Section | None:
    """Return the section of the records that exist; None if none has a figure for it."""
    text = page_text()["speed"]
    makers = {
        "search": ("matching", _look_ups),
        "adjustment": ("adjustment", _evaluations),
        "threads": ("paper", _threads),
    }
    parts: list[str | Table] = []
    for name, (benchmark, make) in makers.items():
        table = make(records[benchmark].rows) if benchmark in records else None
        if table is not None:
            parts += [text[name], table]
    return Section(text["title"], tuple(parts)) if parts else None


def _look_ups(rows: Iterable[Row]) -> Table | None:
    """Return the cost of a node of branch and bound, by the number of points."""
    lines = []
    for row in rows:
        if row.case.get("part") != "points" or not row.figures:
            continue
        points = float(row.case["points"])
        nodes, ms = row.figures["nodes"].value, row.figures["search"].value
        lines.append(
            [
                title_of(str(row.case["source"])),
                str(row.case["pairs"]),
                format_number(points),
                format_number(ms),
                format_number(nodes),
                format_number(1e6 * ms / nodes),
                format_number(nodes * points / (1e6 * ms)),
            ]
        )
    heads = ["", "pairs", "points", "search [ms]", "nodes", "ns a node", "look-ups a ns"]
    return Table(heads, lines) if lines else None


def _evaluations(rows: Iterable[Row]) -> Table | None:
    """Return the time of each solver for a constraint of the museum's graph."""
    lines = []
    for row in rows:
        ours = row.case.get("solver") in (OWN_NAME, HELD_NAME)
        if row.case.get("graph") != "museum" or "time" not in row.figures:
            continue
        ms, iterations = row.figures["time"].value, row.figures["iterations"].value
        lines.append(
            [
                str(row.case["solver"]),
                format_number(ms),
                format_number(iterations),
                format_number(1e6 * ms / (float(row.case["edges"]) * (iterations + 1.0)))
                if ours
                else "",
            ]
        )
    own = [line for line in lines if line[0] in (OWN_NAME, HELD_NAME)]
    heads = ["solver", "time [ms]", "iterations", "ns a constraint and evaluation"]
    return Table(heads, own + [line for line in lines if line not in own]) if lines else None


def _threads(rows: Iterable[Row]) -> Table | None:
    """Return the share of the wall-clock time in which the mapping thread is busy."""
    rows = list(rows)
    busy: dict[str, float] = {}
    for row in rows:
        if row.case.get("experiment") == "stages" and row.case["stage"] not in _OTHER_THREADS:
            log = str(row.case["log"])
            busy[log] = busy.get(log, 0.0) + row.figures["total"].value
    lines = []
    for row in rows:
        log = str(row.case.get("log", ""))
        if row.case.get("experiment") != "performance" or not row.figures or log not in busy:
            continue
        wall, cpu = row.figures["wall clock"].value, row.figures["CPU"].value
        seconds = (cpu, wall, wall / cpu, busy[log], wall - busy[log])
        lines.append([title_of(log), *map(format_number, seconds)])
    heads = [
        "", "CPU [s]", "wall clock [s]", "wall clock of CPU", "mapping thread [s]",
        "around them [s]",
    ]  # fmt: skip
    return Table(heads, lines) if lines else None
