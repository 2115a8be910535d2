# SPDX-License-Identifier: Apache-2.0
"""``python -m bench page``: one page of all figures, made from the records."""

from __future__ import annotations

import io
from dataclasses import replace
from pathlib import Path
from typing import Final

from bench.document import Picture, Section, Table, to_markdown
from bench.kept_sections import with_kept_sections
from bench.page_text import page_text
from bench.paper.cells import title_of
from bench.paper.report import sections as paper_sections
from bench.record import Record, Row, read_record
from bench.speed_bounds import speed_bounds
from cartoloop.errors import InputError
from cartoloop.map_output.output_folder import prepare_folder
from cartoloop.map_output.save import write_file

BENCHMARKS: Final = ("paper", *page_text()["benchmarks"])
"""The benchmarks in the order of the page."""

MAX_PICTURE_PIXELS = 1100
"""Longest side of a picture on the page [pixels]."""

PICTURE_COLORS = 64
"""Number of colours of a picture on the page; a map is mostly grey."""


def write_results_page(folder: Path, page: Path) -> None:
    """Write the page of all records in a folder, and pictures of the maps beside it.

    What the page has of benchmarks without a record there stays.

    Parameters
    ----------
    folder : where the benchmarks wrote their records.
    page : the Markdown file; pictures go into the folder ``images`` beside it.

    Raises
    ------
    InputError
        There are no records.
    OutputError
        The page cannot be written.
    """
    records = {
        name: read_record(folder / f"{name}.json")
        for name in BENCHMARKS
        if (folder / f"{name}.json").exists()
    }
    if not records:
        raise InputError(f"{folder}: has no records; run 'python -m bench paper' first")
    prepare_folder(page.parent)
    parts = [_introduction(records)]
    for name, record in records.items():
        if name == "paper":
            parts += paper_sections(record)
        else:
            parts += _benchmark(record)
    if (bounds := speed_bounds(records)) is not None:
        parts.append(bounds)
    if "paper" in records:
        parts += _maps(records["paper"], folder / "paper", page.parent / "images")
    text = to_markdown("Results", parts)
    if page.exists():
        titles = {name: text_of["title"] for name, text_of in page_text()["benchmarks"].items()}
        earlier = page.read_text(encoding="utf-8")
        text = with_kept_sections(text, earlier, titles, records, first="paper")
    write_file(page, text)


def _introduction(records: dict[str, Record]) -> Section:
    commands = [
        [
            f"`python -m bench {_command(name)}`",
            record.environment.get("date", ""),
            _where(record),
        ]
        for name, record in records.items()
    ]
    text = page_text()["introduction"]
    return Section(text["title"], (text["text"], Table(["command", "date", "where"], commands)))


def _command(name: str) -> str:
    """Return the command that writes a record: ``scaling --again`` writes ``scaling-again``."""
    return name.removesuffix("-again") + " --again" if name.endswith("-again") else name


def _where(record: Record) -> str:
    found = record.environment
    return ", ".join(
        f"{name} {value}" if name not in ("processor", "system") else value
        for name, value in found.items()
        if name != "date"
    )


def _benchmark(record: Record) -> list[Section]:
    """Return a section, with a table for each value of the case that it is split by."""
    text = page_text()["benchmarks"][record.benchmark]
    split_by = text.get("split_by")
    if split_by is None:
        return [Section(text["title"], (text["text"], record.to_table()))]
    groups: dict[str, list[Row]] = {}
    for row in record.rows:
        groups.setdefault(str(row.case.get(split_by, "")), []).append(row)
    sections = [Section(text["title"], (text["text"],))]
    for value, rows in groups.items():
        own = tuple(
            replace(row, case={k: v for k, v in row.case.items() if k != split_by}) for row in rows
        )
        sections.append(Section(value, (Record(record.benchmark, own).to_table(),), level=3))
    return sections


def _maps(record: Record, folder: Path, images: Path) -> list[Section]:
    """Return the pictures of the maps, copied beside the page."""
    logs = dict.fromkeys(
        str(row.case["log"])
        for row in record.rows
        if row.figures and row.case["experiment"] == "performance"
    )
    pictures = []
    for log in logs:
        picture = folder / log / "map.png"
        if picture.exists():
            images.mkdir(exist_ok=True)
            write_file(images / f"{log}.png", _shrunk(picture))
            pictures.append(Picture(f"images/{log}.png", title_of(log)))
    if not pictures:
        return []
    text = page_text()["maps"]
    return [Section(text["title"], (text["text"], *pictures))]


def _shrunk(picture: Path) -> bytes:
    """Return a picture as PNG, made small enough for a page."""
    from PIL import Image

    with Image.open(picture) as opened:
        small = opened.convert("RGB")
        small.thumbnail((MAX_PICTURE_PIXELS, MAX_PICTURE_PIXELS), Image.Resampling.LANCZOS)
        buffer = io.BytesIO()
        small.quantize(PICTURE_COLORS).save(buffer, format="png", optimize=True)
    return buffer.getvalue()
