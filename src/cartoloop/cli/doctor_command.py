# SPDX-License-Identifier: Apache-2.0
"""``cartoloop doctor``: the contents and the problems of a recording."""

from __future__ import annotations

import shutil
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cartoloop.cli.lost_output import styled
from cartoloop.cli.options import ReadingOptions
from cartoloop.plain_text import one_line

if TYPE_CHECKING:
    from cartoloop.doctor.examination import ReportProgress

LINE_PERIOD_S = 5.0
"""Time between two lines of progress [s]."""


@dataclass(frozen=True, kw_only=True)
class DoctorOptions(ReadingOptions):
    """Options of ``cartoloop doctor``."""

    logs: Annotated[
        list[Path],
        typer.Argument(metavar="LOG", help="Recording; several are examined one by one."),
    ]
    as_json: Annotated[
        bool, typer.Option("--json", help="Print JSON; docs/doctor.md explains its keys.")
    ] = False


def doctor_command(options: DoctorOptions) -> None:
    """Examine a recording: its contents, its problems, and what to do about them.

    The exit status is 1 if it cannot be mapped.
    """
    read_options = options.read_options()

    from cartoloop.cli.mapping import compilation_notice
    from cartoloop.doctor import examine

    examinations = []
    with compilation_notice():
        for log in options.logs:
            with _progress(one_line(log.name)) as report:
                examinations.append(examine(log, read_options, report))
    if options.as_json:
        import json

        from cartoloop.doctor.document import document

        typer.echo(json.dumps(document(examinations), indent=2, ensure_ascii=False))
    else:
        from cartoloop.doctor.text import render

        width = shutil.get_terminal_size((100, 24)).columns
        texts = [render(e, width, colours=sys.stdout.isatty()) for e in examinations]
        typer.echo("\n\n".join(texts), file=styled(sys.stdout))
    if not all(examination.can_be_mapped for examination in examinations):
        raise typer.Exit(1)


@contextmanager
def _progress(name: str) -> Iterator[ReportProgress]:
    """Yield a progress callback: a bar on a terminal, a line every few seconds elsewhere."""
    if not sys.stderr.isatty():
        last = time.perf_counter()

        def print_line(doing: str, done: int, of: int) -> None:
            nonlocal last
            if time.perf_counter() - last > LINE_PERIOD_S:
                last = time.perf_counter()
                typer.echo(f"{name}: {doing}" + (f", {done} of {of} scans" if of else ""), err=True)

        yield print_line
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

    columns = (TextColumn("{task.description}", markup=False), BarColumn(20), MofNCompleteColumn())
    with Progress(*columns, console=Console(file=styled(sys.stderr)), transient=True) as bar:
        task = bar.add_task(f"{name}: opening", total=None)

        def update_bar(doing: str, done: int, of: int) -> None:
            bar.update(task, description=f"{name}: {doing}", completed=done, total=of or None)

        yield update_bar
