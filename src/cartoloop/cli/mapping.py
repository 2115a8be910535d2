# SPDX-License-Identifier: Apache-2.0
"""Mapping a recording from the command line: progress, stopping, saving, summary."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from cartoloop.cli.progress import format_duration, progress
from cartoloop.cli.second_process import start_second_process
from cartoloop.cli.stop_signals import StopRequest, stop_signals
from cartoloop.errors import InputError, Interrupted
from cartoloop.runtime.process_memory import (
    relax_gc,
    release_unused_memory,
    set_malloc_thresholds,
)

if TYPE_CHECKING:
    from cartoloop._jit import CompileWatch
    from cartoloop.config_file import LoadedConfig
    from cartoloop.map_output.picture import Layer
    from cartoloop.map_output.report import Report
    from cartoloop.map_output.result import Result
    from cartoloop.mapper import Mapper
    from cartoloop.readers import Log
    from cartoloop.viewer.view import LiveView

COMPILE_TIME_S = 26
"""About how long compiling all kernels takes one process."""

SHARED_COMPILE_TIME_S = 20
"""About how long it takes two."""

_MAX_PROBLEMS_SHOWN = 5


def map_recording(
    log: Log,
    loaded: LoadedConfig,
    out: Path,
    layers: Collection[Layer],
    view: LiveView | None = None,
) -> Result:
    """Map a recording, save the result and tell about it; the `view` shows how it comes about.

    Raises
    ------
    OutputError
        The folder `out` cannot be written; told before mapping starts where that can be known.
    Interrupted
        The user stopped it; what was mapped until then is saved.
    """
    from cartoloop.map_output.save import prepare_folder, save, save_report

    start = time.perf_counter()
    set_malloc_thresholds()
    relax_gc()
    prepare_folder(out)

    from cartoloop.mapper import Mapper

    with stop_signals() as stop, compilation_told() as compiler:
        typer.echo(f"mapping {log.num_scans} scans", err=True)
        try:
            result, failure = _run(Mapper(loaded.config), log, stop, compiler, view)
            typer.echo(f"writing {out}", err=True)
            report = _of_log(log, result, time.perf_counter() - start)
            result = replace(result, report=report)
            if view is not None:
                view.finished(result, failure)
            release_unused_memory()
            save(result, out, layers=layers, origins=loaded.origins)
        except KeyboardInterrupt as interrupt:
            raise Interrupted(f"stopped at once; files in {out} may be missing") from interrupt
    report = timed(report, time.perf_counter() - start)
    save_report(report, out)
    _tell_problems(log)
    typer.echo(summary(report, out))
    if failure is not None:
        typer.echo(f"what was mapped before the failure is in {out}", err=True)
        raise failure
    if stop.made:
        raise Interrupted(f"stopped after {len(result.stamps)} scans; the map of these is in {out}")
    if report.nodes == 0:
        raise InputError(
            f"{log.name}: no scan shows enough to be mapped, the map in {out} is empty; "
            "`cartoloop doctor` tells what the recording holds"
        )
    if lost := next((p.message for p in log.problems if p.severity == "error"), None):
        raise InputError(f"the map in {out} is of a part of the recording: {lost}")
    return replace(result, report=report)


@contextmanager
def compilation_told() -> Iterator[CompileWatch]:
    """Yield a watch over the compiler, which tells the user if kernels must be compiled."""
    from cartoloop._jit import watch_compilation

    with watch_compilation(_tell_of_compilation) as watch:
        yield watch


@cache
def _tell_of_compilation() -> None:
    """Tell the user, and get help, the first time that this is called."""
    from cartoloop._jit import can_keep_kernels, kernel_cache_folder

    if can_keep_kernels():
        has_help = start_second_process()
        seconds = SHARED_COMPILE_TIME_S if has_help else COMPILE_TIME_S
        typer.echo(f"compiling kernels, once: about {seconds} s", err=True)
        return
    typer.echo(
        f"compiling kernels, about {COMPILE_TIME_S} s in each run: {kernel_cache_folder()} cannot "
        "be written or is full; set CARTOLOOP_CACHE_DIR to a folder that can",
        err=True,
    )


def _run(
    mapper: Mapper, log: Log, stop: StopRequest, compiler: CompileWatch, view: LiveView | None
) -> tuple[Result, Exception | None]:
    """Return the result of the log, or of what was mapped until a stop or a failure, and that."""
    try:
        _add_all(mapper, log, stop, compiler, view)
        if not stop.made:
            if view is not None:
                view.finishing()
            typer.echo("closing the last loops", err=True)
            with stop.at_once():
                return mapper.finish(finishing_note(view, mapper)), None
    except KeyboardInterrupt:
        pass
    except Exception as failure:
        if mapper.num_scans == 0:
            raise
        return mapper.result(), failure
    finally:
        mapper.close()
    return mapper.result(), None


def finishing_note(view: LiveView | None, mapper: Mapper) -> Callable[[str], None] | None:
    """Return what shows in the view what is done in the end."""
    return None if view is None else lambda stage: view.finishing(stage, mapper)


def _add_all(
    mapper: Mapper, log: Log, stop: StopRequest, compiler: CompileWatch, view: LiveView | None
) -> None:
    first_time = None

    def paused_s() -> float:
        return compiler.seconds + (view.paused_s if view is not None else 0.0)

    with progress(log.num_scans, paused_s=paused_s) as shown:
        for event in log:
            if stop.made:
                return
            if view is not None:
                view.before_event(mapper, event, lambda: stop.made)
            mapper.add(event)
            if view is not None:
                view.after_event(mapper)
            first_time = event.time if first_time is None else first_time
            shown.update(mapper.num_scans, event.time - first_time, mapper.num_loop_closures)


def _of_log(log: Log, result: Result, wall_s: float) -> Report:
    problems = [problem.message for problem in log.problems]
    return completed(result, log.name, log.skipped, problems, wall_s)


def completed(
    result: Result,
    name: str,
    also_skipped: Mapping[str, int],
    problems: Sequence[str],
    wall_s: float,
) -> Report:
    """Return the report with what only the command knows: names, times, what the reader skipped."""
    from cartoloop.config_file import config_hash

    report = result.report
    skipped = dict(report.skipped)
    for reason, count in also_skipped.items():
        skipped[reason] = skipped.get(reason, 0) + count
    extra = dict(report.extra)
    if problems:
        extra["problems"] = list(problems)
    filled = replace(
        report,
        input=replace(report.input, name=name),
        skipped=skipped,
        config_hash=config_hash(result.config),
        extra=extra,
    )
    return timed(filled, wall_s)


def timed(report: Report, wall_s: float) -> Report:
    """Return the report with what the run has taken so far."""
    from cartoloop.map_output.report import peak_memory_mb

    return replace(
        report,
        wall_s=wall_s,
        cpu_s=time.process_time(),
        peak_memory_mb=peak_memory_mb(),
        real_time_factor=report.input.duration_s / wall_s,
    )


def _tell_problems(log: Log) -> None:
    for problem in log.problems[:_MAX_PROBLEMS_SHOWN]:
        typer.echo(f"{problem.severity}: {problem.message}", err=True)
    if log.num_problems > _MAX_PROBLEMS_SHOWN:
        rest = log.num_problems - _MAX_PROBLEMS_SHOWN
        typer.echo(f"and {rest} more problems; see report.json", err=True)


def summary(report: Report, out: Path) -> str:
    """Return what the user reads in the end."""
    constraints = report.constraints
    closures = f"{constraints.found} in {constraints.searched} pairs searched"
    if constraints.precision is not None:
        closures += (
            f", {constraints.loop_closure} when matched again in the end: "
            f"{100.0 * constraints.precision:.1f}% agree with the map"
        )
    skipped = ", ".join(f"{count} {reason}" for reason, count in sorted(report.skipped.items()))
    return "\n".join(
        (
            f"recording      {report.input.name}: {report.input.scans} scans, "
            f"{format_duration(report.input.duration_s)}, {report.input.path_length_m:.0f} m",
            f"time           {report.wall_s:.1f} s, {report.real_time_factor:.0f}x real time",
            f"graph          {report.nodes} nodes, {report.submaps} submaps",
            f"loop closures  {closures}",
            f"skipped        {skipped or 'nothing'}",
            f"map            {out / 'map.png'}",
        )
    )
