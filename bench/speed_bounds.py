# SPDX-License-Identifier: Apache-2.0
"""What bounds the speed where it is not what was aimed at: the section of the results page."""

from __future__ import annotations

from collections.abc import Iterable

from bench.adjustment.benchmark import HELD_NAME, OWN_NAME
from bench.document import Section, Table
from bench.paper.cells import title_of
from bench.record import Record, Row, format_number

_SEARCH = (
    "**A search that finds nothing.** A node of the tree is bounded by one byte for each point of "
    "the scan, and these bytes lie wherever the points fall. *Look-ups* counts as if each node "
    "looked up all points, which those of the upper levels need not. With many points it nears "
    "what a core can load, a few bytes a cycle; with few points more of the time goes to the tree "
    "itself. A search that finds nothing ends when no node is left: only fewer of them, by tighter "
    "bounds, would make it much faster."
)

_ADJUSTMENT = (
    "**Pose adjustment.** An evaluation goes through all constraints once: their errors, "
    "derivatives, and what eliminating the nodes leaves to the submaps; one more than iterations "
    "is needed. Moving the nodes and solving for the submaps is counted in."
)

_THREADS = (
    "**Cores.** A scan is matched to what the scans before it left in the submap, so one thread "
    "maps; searches, and the last pass, have the other cores. *Mapping thread* is what its stages "
    "took by the clock without those in which it waits for the others, and *around them* is what "
    "is left of the wall clock: start, reading, what is between the stages, the last pass and "
    "saving. More cores would shorten the waiting and the last pass alone."
)

_OF_OTHER_THREADS = ("search", "wait for searches", "match again")


def speed_bounds(records: dict[str, Record]) -> Section | None:
    """Return the section, made of whatever records there are; None without any that tells."""
    makers = (("matching", _SEARCH, _look_ups), ("adjustment", _ADJUSTMENT, _evaluations),
              ("paper", _THREADS, _threads))  # fmt: skip
    parts: list[str | Table] = []
    for name, text, make in makers:
        table = make(records[name].rows) if name in records else None
        if table is not None:
            parts += [text, table]
    return Section("What bounds the speed", tuple(parts)) if parts else None


def _look_ups(rows: Iterable[Row]) -> Table | None:
    """Return what a node of branch and bound costs, by the number of points."""
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
    """Return what the programs take for a constraint of the museum's graph."""
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
    """Return how much of the wall clock the thread that maps is busy."""
    rows = list(rows)
    busy: dict[str, float] = {}
    for row in rows:
        if row.case.get("experiment") == "stages" and row.case["stage"] not in _OF_OTHER_THREADS:
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
