# SPDX-License-Identifier: Apache-2.0
"""The live view against its targets: bytes, first picture, frame rate, slow-down, latency."""

from __future__ import annotations

import asyncio
import json
import re
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bench.browser import NoBrowserError, browser
from bench.command_runs import CommandFailed, failure
from bench.environment import environment
from bench.museum_log import museum_or
from bench.record import Case, Figure, Record, Row
from bench.view.clients import Seen, join_once, watch_closures
from bench.view.mapping import MappingRun
from bench.view.page import PageRun, closures_seen, open_page, show_map

VIEWERS = (1, 10)

TARGETS = {
    "sent": (15.0, "less"),
    "first full picture": (1.0, "less"),
    "frames a second, panning": (30.0, "more"),
    "CPU more": (5.0, "less"),
    "wall clock more": (5.0, "less"),
    "seen after": (0.5, "less"),
}
"""Targets by the name of the figure, in its unit."""

_NO_VIEWER = "pages that draw nothing"
_BROWSER = "Chromium, WebGL on the processor"


@dataclass(frozen=True, slots=True)
class ViewOptions:
    """What to measure.

    Attributes
    ----------
    log : a recording instead of the museum.
    scans : of the recording are mapped, 0 for all.
    pace : times real time at which loop closures are watched for.
    watched_scans : number of scans that are mapped meanwhile.
    repeats : of all measurements.
    """

    log: Path | None = None
    scans: int = 0
    pace: float = 8.0
    watched_scans: int = 5000
    repeats: int = 3


def run(options: ViewOptions, progress: Callable[[str], None], seed: int = 0) -> Record:
    """Return all figures of the view.

    Parameters
    ----------
    options : what to measure.
    progress : called with a line on progress.
    seed : of the building, the walk and all noise.

    Raises
    ------
    CommandFailed
        A process that was started failed.
    """
    with tempfile.TemporaryDirectory(prefix="cartoloop-view-") as folder:
        log = museum_or(options.log, Path(folder), seed, progress)
        out = Path(folder) / "map"
        progress(
            f"mapping {log.name} without a view and with {VIEWERS} viewers, {options.repeats} times"
        )
        runs = _cost(log, out, options)
        progress("showing the finished map")
        rows = _finished_map(out, options.repeats)
        rows += [_slow_down(runs, viewers) for viewers in VIEWERS]
        progress("watching for loop closures")
        rows += _closures(log, options)
    return Record("viewer", tuple(rows), environment())


def misses(record: Record) -> list[str]:
    """Return the figures that miss their targets, one line each."""
    missed = []
    for row in record.rows:
        for name, figure in row.figures.items():
            target, better = TARGETS.get(name, (figure.value, "less"))
            if figure.value > target if better == "less" else figure.value < target:
                case = ", ".join(str(value) for value in row.case.values())
                missed.append(
                    f"{case}: {name} {figure.text()} {figure.unit}, target {better} than {target:g}"
                )
    return missed


def _cost(log: Path, out: Path, options: ViewOptions) -> list[MappingRun]:
    numbers = [str(number) for number in VIEWERS]
    with _mapping("cost", log, options.scans, options.repeats, out, *numbers) as process:
        output, errors = process.communicate()
    if process.returncode != 0:
        raise failure(f"mapping {log.name}", process.returncode, errors)
    return [MappingRun(**run) for run in json.loads(output)]


@contextmanager
def _mapping(*arguments: object) -> Iterator[subprocess.Popen[str]]:
    command = [sys.executable, "-m", "bench.view.mapping", *map(str, arguments)]
    with _started(command) as process:
        yield process


@contextmanager
def _started(command: Sequence[str]) -> Iterator[subprocess.Popen[str]]:
    """Yield a process; end it if it has not ended."""
    pipe = subprocess.PIPE
    with subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=pipe, text=True) as process:
        try:
            yield process
        finally:
            process.kill()


def _url(process: subprocess.Popen[str]) -> str:
    """Return the first URL that a process prints."""
    assert process.stdout is not None and process.stderr is not None
    while line := process.stdout.readline():
        if found := re.search(r"http://\S+", line):
            return found[0]
    raise CommandFailed(f"the view was not served: {process.stderr.read().strip()[-300:]}")


def _finished_map(out: Path, repeats: int) -> list[Row]:
    """Return the times until pages show a finished map."""
    case: Case = {"part": "a finished map"}
    command = [sys.executable, "-u", "-m", "cartoloop", "view", str(out)]
    with _started(command) as server:
        url = _url(server)
        joined = [asyncio.run(join_once(url)) for _ in range(repeats)]
        rows = [
            Row(
                case | {"page": _NO_VIEWER},
                {
                    "sent": Figure.exact(joined[0][1] / 1e6, "MB"),
                    "all sent after": Figure.of_samples([seconds for seconds, _ in joined], "s"),
                },
            )
        ]
        try:
            with browser() as started:
                shown = [show_map(started, url) for _ in range(repeats)]
        except NoBrowserError as none:
            rows.append(Row(case | {"page": _BROWSER}, notes=str(none)))
        else:
            rows.append(Row(case | {"page": _BROWSER}, _of_pages(shown)))
    return rows


def _of_pages(runs: Sequence[PageRun]) -> dict[str, Figure]:
    return {
        "sent": Figure.of_samples([run.sent_mb for run in runs], "MB"),
        "first full picture": Figure.of_samples([run.picture_s for run in runs], "s"),
        "sharp": Figure.of_samples([run.sharp_s for run in runs], "s"),
        "page opened and shown": Figure.of_samples([run.opening_s for run in runs], "s"),
        "frames a second, panning": Figure.of_samples(
            [run.frames_per_s for run in runs], "", "more"
        ),
        "99% of frames within": Figure.of_samples([run.frames_within_ms for run in runs], "ms"),
    }


def _slow_down(runs: Sequence[MappingRun], viewers: int) -> Row:
    """Return the cost of viewers: the additional time of mapping against mapping without a view."""
    own = [run for run in runs if run.viewers == viewers]
    none = [run for run in runs if run.viewers is None]

    def more(value: Callable[[MappingRun], float]) -> Figure:
        ratios = [value(run) / value(base) for run, base in zip(own, none, strict=True)]
        return Figure.of_samples([100.0 * (ratio - 1.0) for ratio in ratios], "%")

    return Row(
        {"part": "while mapping", "page": _NO_VIEWER, "viewers": viewers},
        {
            "CPU more": more(lambda run: run.cpu_s),
            "wall clock more": more(lambda run: run.wall_s),
            "CPU more, last pass": more(lambda run: run.finish_cpu_s),
            "CPU without a view": Figure.of_samples([run.cpu_s for run in none], "s"),
            "wall clock without a view": Figure.of_samples([run.wall_s for run in none], "s"),
            "sent to each": Figure.of_samples([run.sent_mb for run in own], "MB", None),
        },
    )


def _closures(log: Path, options: ViewOptions) -> list[Row]:
    """Return the times until pages show a loop closure after it was found."""
    rows = [_seen_row(_NO_VIEWER, *_watch_by_client(log, options))]
    case: Case = {"part": "loop closures", "page": _BROWSER}
    try:
        with browser() as started, _mapping(*_closure_arguments(log, options)) as process:
            page = open_page(started, _url(process))
            page.wait_for_function("cartoloopHeard.isComplete")
            found = _go(process)
            rows.append(_seen_row(_BROWSER, found, closures_seen(page)))
    except NoBrowserError as none:
        rows.append(Row(case, notes=str(none)))
    return rows


def _watch_by_client(log: Path, options: ViewOptions) -> tuple[list[Seen], list[Seen]]:
    async def watch(process: subprocess.Popen[str]) -> tuple[list[Seen], list[Seen]]:
        is_joined = asyncio.Event()
        watching = asyncio.create_task(watch_closures(_url(process), is_joined))
        await is_joined.wait()
        found = await asyncio.to_thread(_go, process)
        return found, await watching

    with _mapping(*_closure_arguments(log, options)) as process:
        return asyncio.run(watch(process))


def _closure_arguments(log: Path, options: ViewOptions) -> tuple[object, ...]:
    return "closures", log, options.watched_scans, options.pace


def _go(process: subprocess.Popen[str]) -> list[Seen]:
    """Start mapping in a process; return the numbers of loop closures with the times."""
    output, errors = process.communicate("\n")
    if process.returncode != 0:
        raise failure("mapping", process.returncode, errors)
    return [(int(number), float(at)) for number, at in json.loads(output)]


def _seen_row(page: str, found: Sequence[Seen], seen: Sequence[Seen]) -> Row:
    """Return the delays between finding closures and seeing them."""
    case: Case = {"part": "loop closures", "page": page}
    delays = [
        min((at for number, at in seen if number >= wanted), default=float("inf")) - since
        for wanted, since in found
    ]
    if not delays or not np.isfinite(delays).all():
        return Row(case, notes="no closure was found, or not all were seen")
    return Row(
        case,
        {
            "times closures were found": Figure.of_samples([len(found)], "", None),
            "seen after": Figure.of_samples([statistics.median(delays)], "s"),
            "90% seen after": Figure.of_samples([float(np.quantile(delays, 0.9))], "s"),
        },
    )
