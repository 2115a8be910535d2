# SPDX-License-Identifier: Apache-2.0
"""The sections of the report of the paper's experiments."""

from __future__ import annotations

from pathlib import Path

from bench.document import Picture, Section, Table
from bench.page_text import page_text
from bench.paper.cells import mean_std, rows_of, title_of
from bench.paper.pictures import PICTURES
from bench.paper.shortfalls import behind, limits
from bench.paper.simulations import adjustment_runs, lines, museum, truth
from bench.paper.tables import closures, percentiles, performance, relations, stages
from bench.record import Record


def sections(record: Record, pictures: Path | None = None, prefix: str = "paper") -> list[Section]:
    """Return the report.

    Parameters
    ----------
    record : of ``python -m bench paper``.
    pictures : folder with a folder of pictures for each recording; None for a short report, without
        pictures and without the longest tables.
    prefix : path of that folder as seen from the report.
    """
    found = [
        relations(record),
        percentiles(record),
        closures(record),
        performance(record),
        stages(record),
        museum(record),
        None if pictures is None else adjustment_runs(record),
        lines(record),
        truth(record),
        _variants(record),
        behind(record),
        limits(),
        _missing(record),
        *_pictures(record, pictures, prefix),
    ]
    return [section for section in found if section is not None]


def _variants(record: Record) -> Section | None:
    rows = rows_of(record, "variants")
    if not rows:
        return None
    lines = [
        [
            title_of(str(row.case["log"])),
            f"`--set {row.case['setting']}`",
            mean_std(row.figures, "translation", "translation std"),
            mean_std(row.figures, "rotation", "rotation std"),
        ]
        for row in rows
    ]
    text = page_text()["paper"]["variants"]
    heads = ["", "setting", "translation [m]", "rotation [deg]"]
    return Section(text["title"], (text["text"], Table(heads, lines)))


def _missing(record: Record) -> Section | None:
    lines = [
        [title_of(str(row.case["log"])), str(row.case["experiment"]), row.notes]
        for row in record.rows
        if row.notes
    ]
    if not lines:
        return None
    title = page_text()["paper"]["missing"]["title"]
    return Section(title, (Table(["", "experiment", "reason"], lines),))


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
    title = page_text()["paper"]["pictures"]["title"]
    return [Section(title), *found] if found else []
