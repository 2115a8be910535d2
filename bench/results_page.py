# SPDX-License-Identifier: Apache-2.0
"""One page of all figures: ``docs/results.md``, made of what the benchmarks wrote."""

from __future__ import annotations

import io
from dataclasses import dataclass, replace
from pathlib import Path

from bench.document import Picture, Section, Table, to_markdown
from bench.paper.cells import title_of
from bench.paper.report import sections as paper_sections
from bench.record import Record, Row, read_record
from bench.speed_bounds import speed_bounds
from cartoloop.errors import InputError
from cartoloop.map_output.save import prepare_folder, write_file


@dataclass(frozen=True, slots=True)
class _Part:
    """How a benchmark is shown: its title, what it is, and the case that its tables differ in."""

    title: str
    text: str = ""
    split_by: str = ""


BENCHMARKS = {
    "paper": _Part("The experiments of the paper"),
    "matching": _Part(
        "Branch and bound",
        "Section V-B: the search of a scan in a finished submap, on pairs taken from the "
        "recordings. All searches of a row return the same pose and score, to the last bit. "
        "*Exhaustive* is algorithm 1, once as the paper writes it and once as fast as we know how "
        "to; *bounds* compares, in the same plain search, the bounds of eq. (17) with those of "
        "grids of halved resolution, the alternative that the paper rejects.",
        "part",
    ),
    "adjustment": _Part(
        "Pose adjustment",
        "Eq. (SPA) against other solvers on the same graphs, from the same start, in the same "
        "run, in turn, each on one thread; they stop at a relative change of the cost of 1e-6. "
        "Costs are computed by one evaluator for all. *Times ours* is the solver's time divided "
        "by ours. That is one call that has all yet to do. Where a row or column says *graph "
        "held*, our constraints were sorted and packed before, as they are while mapping, and as "
        "the others' graphs are built before their clock starts.",
        "graph",
    ),
    "kernels": _Part(
        "Kernels",
        "Time of a call, compilation excluded, on inputs from a simulated drive.",
    ),
    "scaling": _Part(
        "Growth: one long walk through ever more rooms",
        "One run through a building that grows with the way, in parts of a museum's length; "
        "reading of the recording included.",
    ),
    "scaling-again": _Part(
        "Growth: one museum again and again",
        "One run as long, that stays in one museum.",
    ),
    "live": _Part(
        "Live: how long a pose takes",
        "The museum's scans as from a robot, each when it is due, in the middle of the walk: from "
        "its arrival until its pose is out, while loops are being closed behind it and the map is "
        "saved now and then.",
    ),
    "viewer": _Part(
        "The live view",
        "The museum. *While mapping*: as fast as it can, in turn without a view and with so many "
        "viewers, which run on the same machine; by how much more processor time the mapping "
        "process takes, all its threads, and how much longer. *A finished map*: what joining it "
        "takes. *Loop closures*: from the adjustment that takes closures in to the first frame "
        "after a page knows of them, in a recording that is mapped at some times real time.",
        "part",
    ),
}
"""The benchmarks in the order of the page."""

MAX_PICTURE_PIXELS = 1100
"""Longest side of a picture on the page."""

PICTURE_COLORS = 64
"""Colours of a picture on the page: a map is mostly grey."""


def write_results_page(folder: Path, page: Path) -> None:
    """Write the page of all records in a folder, and pictures of the maps beside it.

    Parameters
    ----------
    folder : where ``python -m bench`` wrote.
    page : the Markdown file; pictures go into the folder ``images`` beside it.

    Raises
    ------
    InputError
        There is no record.
    OutputError
        The page cannot be written.
    """
    records = {
        name: read_record(folder / f"{name}.json")
        for name in BENCHMARKS
        if (folder / f"{name}.json").exists()
    }
    if not records:
        raise InputError(f"{folder}: no figures there; run 'python -m bench paper' first")
    prepare_folder(page.parent)
    parts = [_introduction(records)]
    for name, record in records.items():
        if name == "paper":
            parts += paper_sections(record)
        else:
            parts += _benchmark(BENCHMARKS[name], record)
    if (bounds := speed_bounds(records)) is not None:
        parts.append(bounds)
    if "paper" in records:
        parts += _maps(records["paper"], folder / "paper", page.parent / "images")
    write_file(page, to_markdown("Results", parts))


def _introduction(records: dict[str, Record]) -> Section:
    commands = [
        [
            f"`python -m bench {name.replace('-', ' --')}`",
            record.environment.get("date", ""),
            _where(record),
        ]
        for name, record in records.items()
    ]
    return Section(
        "How to get these figures",
        (
            "This page is made by `python -m bench page` of what these commands measured; none of "
            "its figures is typed by hand, but for those of others, which are quoted. Recordings "
            "are found through `CARTOLOOP_DATA` or `--data`. Times on a shared machine are rough; "
            "errors and counts do not vary at all.",
            Table(["command", "date", "where"], commands),
        ),
    )


def _where(record: Record) -> str:
    found = record.environment
    return ", ".join(
        f"{name} {value}" if name not in ("processor", "system") else value
        for name, value in found.items()
        if name != "date"
    )


def _benchmark(part: _Part, record: Record) -> list[Section]:
    """Return a section, with a table for each value of the case that the part is split by."""
    if not part.split_by:
        return [Section(part.title, (part.text, record.to_table()))]
    groups: dict[str, list[Row]] = {}
    for row in record.rows:
        groups.setdefault(str(row.case.get(part.split_by, "")), []).append(row)
    sections = [Section(part.title, (part.text,))]
    for value, rows in groups.items():
        own = tuple(
            replace(row, case={k: v for k, v in row.case.items() if k != part.split_by})
            for row in rows
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
    thanks = (
        "Rendered from recordings of C. Stachniss (MIT CSAIL, Freiburg), D. Haehnel (Intel), "
        "P. Beeson (ACES), M. Bosse and J. Leonard (Killian Court), whom we thank; the others are "
        "simulated."
    )
    return [Section("The maps", (thanks, *pictures))]


def _shrunk(picture: Path) -> bytes:
    """Return a picture as PNG, made small enough for a page."""
    from PIL import Image

    with Image.open(picture) as opened:
        small = opened.convert("RGB")
        small.thumbnail((MAX_PICTURE_PIXELS, MAX_PICTURE_PIXELS), Image.Resampling.LANCZOS)
        buffer = io.BytesIO()
        small.quantize(PICTURE_COLORS).save(buffer, format="png", optimize=True)
    return buffer.getvalue()
