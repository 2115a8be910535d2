# SPDX-License-Identifier: Apache-2.0
"""Tables II to V: the recordings of the Radish data set."""

from __future__ import annotations

from bench.document import Section, Table
from bench.page_text import page_text
from bench.paper.cells import TITLES, mean_std, quoted, rows_of, table, title_of
from bench.paper.published import SOURCES
from bench.record import Record, format_number

BOUNDS = ("p50", "p75", "p90", "p95", "p99", "max")


def relations(record: Record) -> Section | None:
    """Return tables II and III, None where there are no relations."""
    rows = rows_of(record, "relations")
    if not rows:
        return None
    lines = []
    for row in rows:
        figures = row.figures
        others = [figures[source].value for source in SOURCES.values() if source in figures]
        is_best = not others or figures["mean"].value <= min(others)
        ours = mean_std(figures, "mean", "std")
        lines.append(
            [
                title_of(str(row.case["log"])),
                TITLES[str(row.case["error"])],
                f"**{ours}**" if is_best else ours,
                mean_std(figures, "mean before", "std before"),
                *(quoted(figures, source) for source in SOURCES.values()),
            ]
        )
    heads = ["", "error", "cartoloop", "before loop closure", *SOURCES.values()]
    text = page_text()["paper"]["relations"]
    return Section(text["title"], (text["text"], Table(heads, lines)))


def percentiles(record: Record) -> Section | None:
    """Return the percentiles of the errors, None where there are no relations."""
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
    text = page_text()["paper"]["percentiles"]
    return Section(text["title"], (text["text"], Table(heads, lines)), level=3)


def closures(record: Record) -> Section | None:
    """Return table IV, None where nothing was mapped."""
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
    text = page_text()["paper"]["closures"]
    return Section(text["title"], (text["text"], table(rows, columns)))


def performance(record: Record) -> Section | None:
    """Return table V, None where nothing was mapped."""
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
    text = page_text()["paper"]["performance"]
    return Section(text["title"], (text["text"], table(rows, columns)))


def stages(record: Record) -> Section | None:
    """Return where the time of a run goes, None where nothing was mapped."""
    seconds: dict[str, dict[str, str]] = {}
    for row in rows_of(record, "stages"):
        of_log = seconds.setdefault(str(row.case["log"]), {})
        of_log[str(row.case["stage"])] = format_number(row.figures["total"].value)
    if not seconds:
        return None
    names = list(dict.fromkeys(name for of_log in seconds.values() for name in of_log))
    lines = [
        [title_of(log), *(of_log.get(name, "") for name in names)]
        for log, of_log in seconds.items()
    ]
    text = page_text()["paper"]["stages"]
    parts = (text["text"], Table(["", *names], lines), text["conclusion"])
    return Section(text["title"], parts)
