# SPDX-License-Identifier: Apache-2.0
"""Options that benchmarks share, and what they do with their record."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from bench.record import Record

DataOption = Annotated[
    Path | None,
    typer.Option("--data", metavar="DIR", help="Folder with the recordings; else $CARTOLOOP_DATA."),
]
OutOption = Annotated[
    Path, typer.Option("-o", "--out", metavar="DIR", help="Folder for figures and reports.")
]
RepeatOption = Annotated[
    int, typer.Option("--repeat", min=1, help="Number of repeats of each measurement.")
]
AgainstOption = Annotated[
    Path | None,
    typer.Option(metavar="FILE", help="An earlier JSON to compare with."),
]
StrictOption = Annotated[
    bool, typer.Option("--strict", help="Fail where data is missing or a figure got worse.")
]


def data_folder(given: Path | None) -> Path:
    """Return the folder with the recordings."""
    return given or Path(os.environ.get("CARTOLOOP_DATA", "../shared/data"))


def names_of(text: str) -> list[str]:
    """Return the names in a text, which commas separate."""
    return [name.strip() for name in text.split(",") if name.strip()]


def earlier_record(path: Path | None, benchmark: str) -> Record | None:
    """Return the record to compare with; read first, because the new one may replace it."""
    if path is None:
        return None
    from bench.record import read_record
    from cartoloop.errors import InputError

    found = read_record(path)
    if found.benchmark != benchmark:
        raise InputError(
            f"{path}: is a record of '{found.benchmark}', which '{benchmark}' cannot be compared "
            "with; give one of the same benchmark"
        )
    return found


def show_progress(line: str) -> None:
    """Print a line about a run that takes long, beside its output."""
    typer.echo(line, err=True)


def print_table(record: Record) -> None:
    """Print the figures of a record, and where they were measured."""
    typer.echo(", ".join(f"{name} {value}" for name, value in record.environment.items()))
    typer.echo(f"\n{record.to_table()}\n")


def conclude_with_table(record: Record, out: Path, before: Record | None, strict: bool) -> None:
    """Print the figures of a record, and :func:`conclude`."""
    print_table(record)
    conclude(record, out, before, strict)


def conclude(record: Record, out: Path, before: Record | None, strict: bool) -> None:
    """Write the record, report what changed, and fail if `strict` is set and a figure got worse."""
    from bench.comparison import changes_table, compare, gone
    from cartoloop.map_output.output_folder import prepare_folder
    from cartoloop.map_output.save import write_file

    path = prepare_folder(out) / f"{record.benchmark}.json"
    write_file(path, record.to_json())
    typer.echo(f"figures        {path}")
    changes = [] if before is None else compare(record, before)
    lost = [] if before is None else gone(record, before)
    if before is not None:
        machines = [found.environment.get("processor", "unknown") for found in (before, record)]
        if machines[0] != machines[1]:
            typer.echo(f"measured on another machine: {machines[0]}, now {machines[1]}", err=True)
        typer.echo(f"\n{changes_table(changes)}" if changes else "nothing changed beyond the noise")
    for case in lost:
        typer.echo(f"no figures any more: {case}", err=True)
    is_worse = bool(lost) or any(change.is_worse for change in changes)
    if strict and (is_worse or not record.is_complete):
        raise typer.Exit(1)
