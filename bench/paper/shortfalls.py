# SPDX-License-Identifier: Apache-2.0
"""Figures for which another program is better, and the reasons from ``remarks.toml``."""

from __future__ import annotations

import tomllib
from functools import cache
from importlib.resources import files
from typing import Any

from bench.document import Section, Table
from bench.page_text import page_text
from bench.paper.cells import TITLES, rows_of, title_of
from bench.paper.published import SOURCES
from bench.record import Record, format_number


def behind(record: Record) -> Section | None:
    """Return the figures for which another program is better, None where there are none."""
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
            reason = remarks().get(log, {}).get(error, "not known")
            lines.append(
                [title_of(log), TITLES[error], format_number(figures["mean"].value), named, reason]
            )
    if not lines:
        return None
    text = page_text()["paper"]["behind"]
    heads = ["", "figure", "cartoloop", "others", "why"]
    return Section(text["title"], (text["text"], Table(heads, lines)))


def _costlier(record: Record) -> list[list[str]]:
    """Return the figures of tables IV and V for which another program is better."""
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
                reason = remarks().get(log, {}).get(name) or remarks()["any"].get(name)
                lines.append(
                    [title_of(log), label, own.text(), ", ".join(better), reason or "not known"]
                )
    return lines


def limits() -> Section:
    """Return the known limits, each with a command that shows it."""
    return Section(page_text()["paper"]["limits"]["title"], tuple(remarks()["limits"]))


@cache
def remarks() -> dict[str, Any]:
    """Return the reasons in ``remarks.toml``, by recording and figure, and the known limits."""
    return tomllib.loads(files("bench.paper").joinpath("remarks.toml").read_text("utf-8"))
