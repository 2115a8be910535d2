# SPDX-License-Identifier: Apache-2.0
"""``cartoloop doctor``: what is in a recording, and what is wrong with it."""

from __future__ import annotations

import shutil
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cartoloop.cli.options import (
    EchoOption,
    ImuTopicOption,
    LaserPoseOption,
    OdomTopicOption,
    ScanTopicOption,
    UrdfOption,
    read_options,
)

if TYPE_CHECKING:
    from cartoloop.doctor.examination import Tell

_COLOURS = {"error": typer.colors.RED, "warning": typer.colors.YELLOW, "info": typer.colors.CYAN}
_LINE_PERIOD_S = 5.0


def doctor_command(
    logs: Annotated[
        list[Path], typer.Argument(metavar="LOG", help="Recording; several are told one by one.")
    ],
    as_json: Annotated[
        bool, typer.Option("--json", help="Print JSON; docs/doctor.md explains its keys.")
    ] = False,
    scan_topics: ScanTopicOption = None,
    odom_topic: OdomTopicOption = None,
    imu_topic: ImuTopicOption = None,
    urdf: UrdfOption = None,
    laser_pose: LaserPoseOption = None,
    echo: EchoOption = "first",
) -> None:
    """Tell what is in a recording, what is wrong with it, and what to do about it.

    The exit status is 1 if it cannot be mapped.
    """
    options = read_options(scan_topics, odom_topic, imu_topic, urdf, laser_pose, echo)

    from cartoloop.cli.mapping import compilation_told
    from cartoloop.doctor import examine

    examinations = []
    with compilation_told():
        for log in logs:
            with _progress(log.name) as tell:
                examinations.append(examine(log, options, tell))
    if as_json:
        import json

        from cartoloop.doctor.document import document

        typer.echo(json.dumps(document(examinations), indent=2, ensure_ascii=False))
    else:
        from cartoloop.doctor.text import render

        width = shutil.get_terminal_size((100, 24)).columns
        typer.echo("\n\n".join(render(e, width, _paint) for e in examinations))
    if not all(examination.can_be_mapped for examination in examinations):
        raise typer.Exit(1)


def _paint(severity: str, text: str) -> str:
    return typer.style(text, fg=_COLOURS[severity])  # without colours where nobody sees them


@contextmanager
def _progress(name: str) -> Iterator[Tell]:
    """Yield what shows how far it is: a bar on a terminal, now and then a line elsewhere."""
    if not sys.stderr.isatty():
        last = time.perf_counter()

        def tell_line(doing: str, done: int, of: int) -> None:
            nonlocal last
            if time.perf_counter() - last > _LINE_PERIOD_S:
                last = time.perf_counter()
                typer.echo(f"{name}: {doing}" + (f", {done} of {of} scans" if of else ""), err=True)

        yield tell_line
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

    columns = (TextColumn("{task.description}"), BarColumn(20), MofNCompleteColumn())
    with Progress(*columns, console=Console(file=sys.stderr), transient=True) as bar:
        task = bar.add_task(f"{name}: opening", total=None)

        def tell_bar(doing: str, done: int, of: int) -> None:
            bar.update(task, description=f"{name}: {doing}", completed=done, total=of or None)

        yield tell_bar
