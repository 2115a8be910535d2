# SPDX-License-Identifier: Apache-2.0
"""Names, rows and cells that the tables of the report share."""

from __future__ import annotations

from collections.abc import Sequence

from bench.document import Table
from bench.paper.published import published
from bench.record import Figure, Record, Row, format_number

TITLES = {
    "absolute_translational": "absolute translational [m]",
    "squared_translational": "squared translational [m²]",
    "absolute_rotational_deg": "absolute rotational [deg]",
    "squared_rotational_deg2": "squared rotational [deg²]",
}
"""The errors of table II as the report names them."""


def title_of(log: str) -> str:
    """Return a recording's name as the paper writes it."""
    found: str = published()["logs"].get(log, {}).get("title", log)
    return found


def rows_of(record: Record, experiment: str, **case: str) -> list[Row]:
    """Return the rows of an experiment that have figures."""
    wanted = {"experiment": experiment, **case}
    return [row for row in record.rows if row.figures and wanted.items() <= row.case.items()]


def table(rows: Sequence[Row], columns: dict[str, str]) -> Table:
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


def mean_std(figures: dict[str, Figure], mean: str, std: str) -> str:
    """Return a mean and its standard deviation, empty where there is none."""
    if mean not in figures:
        return ""
    return f"{format_number(figures[mean].value)} ± {format_number(figures[std].value)}"


def quoted(figures: dict[str, Figure], source: str) -> str:
    """Return a quoted figure with the digits of its source."""
    if source not in figures:
        return ""
    return f"{figures[source].value:g} ± {figures[f'{source} std'].value:g}"
