# SPDX-License-Identifier: Apache-2.0
"""Output of a mapping run on the terminal: progress, problems, summary."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from contextlib import ExitStack, contextmanager
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from cartoloop.cli.progress import Progress, format_duration, progress
from cartoloop.cli.second_process import start_second_process
from cartoloop.cli.session_lines import show_sessions
from cartoloop.cli.stop_signals import SignalStop, stop_signals
from cartoloop.plain_text import one_line
from cartoloop.report import sensor_warnings
from cartoloop.runs.observer import RunObserver
from cartoloop.runs.recording import map_recording
from cartoloop.runs.resuming import resume_recording
from cartoloop.runtime.process_memory import relax_gc, set_malloc_thresholds

if TYPE_CHECKING:
    from cartoloop._jit import CompileWatch
    from cartoloop.config_file import LoadedConfig
    from cartoloop.map_output.picture import Layer
    from cartoloop.mapper import Mapper
    from cartoloop.readers import Log, ReadOptions
    from cartoloop.report import Report
    from cartoloop.result import Result
    from cartoloop.sensor.events import SensorEvent
    from cartoloop.sensor.pose import Pose
    from cartoloop.viewer.view import LiveView

COMPILE_TIME_S = 26
"""Time in which one process compiles all kernels [s], measured on two cores of 2.5 GHz."""

SHARED_COMPILE_TIME_S = 20
"""The same with a second process to help [s]."""

MAX_PROBLEMS_SHOWN = 5
"""Problems of a recording that are printed; more than these hide the summary."""


def map_log(
    log: Log,
    loaded: LoadedConfig,
    out: Path,
    layers: Collection[Layer] | None,
    view: LiveView | None = None,
    *,
    options: ReadOptions | None = None,
    overwrite: bool = False,
    resume: bool = False,
    onto: Path | None = None,
    pose: Pose | None = None,
) -> Result:
    """Map a recording, save the map and print the summary; see `runs.recording.map_recording`."""
    set_malloc_thresholds()
    relax_gc()
    with (
        stop_signals() as stop,
        compilation_notice() as compiler,
        _Display(log, out, stop, compiler, view) as display,
    ):
        if resume:
            return resume_recording(
                log,
                out,
                loaded,
                options=options,
                layers=layers,
                observer=display,
                stop=stop,
                onto=onto,
            )
        return map_recording(
            log,
            loaded,
            out,
            options=options,
            layers=layers,
            observer=display,
            stop=stop,
            overwrite=overwrite,
            onto=onto,
            onto_pose=pose,
        )


class _Display(RunObserver):
    """Shows a run on the terminal and in the view.

    Parameters
    ----------
    log : to be mapped.
    out : folder of the map.
    stop : whether the user wants to stop.
    compiler : the time that it takes is not part of the progress.
    view : shows the map while it grows, or None.
    """

    def __init__(
        self,
        log: Log,
        out: Path,
        stop: SignalStop,
        compiler: CompileWatch,
        view: LiveView | None,
    ) -> None:
        self._log, self._out, self._stop, self._view = log, out, stop, view
        self._compiler = compiler
        self._first_time: float | None = None
        self._bar = ExitStack()
        self._progress: Progress | None = None

    def __enter__(self) -> _Display:
        return self

    def __exit__(self, *_: object) -> None:
        self._bar.close()

    def started(self, num_scans: int) -> None:
        typer.echo(f"mapping {num_scans} scans", err=True)
        self._progress = self._bar.enter_context(progress(num_scans, paused_s=self._paused_s))

    def resumed(self, num_scans: int) -> None:
        typer.echo(f"resuming: {num_scans} scans were mapped before", err=True)

    def already_finished(self, folder: Path) -> None:
        typer.echo(
            f"{one_line(str(folder))} holds the finished map of this recording: nothing to resume"
        )

    def already_added(self, name: str) -> None:
        typer.echo(
            f"warning: {name} is in the map already: its scans will be in it twice", err=True
        )

    def journal_failed(self, problem: str) -> None:
        typer.echo(f"warning: {problem}", err=True)

    def before_event(self, mapper: Mapper, event: SensorEvent) -> None:
        if self._view is not None:
            self._view.before_event(mapper, event, lambda: self._stop.made)

    def after_event(self, mapper: Mapper, event: SensorEvent) -> None:
        if self._view is not None:
            self._view.after_event(mapper)
        if self._first_time is None:
            self._first_time = event.time
        assert self._progress is not None
        self._progress.update(
            mapper.num_scans, event.time - self._first_time, mapper.num_loop_closures
        )

    def finishing(self, mapper: Mapper, stage: str | None) -> None:
        self._bar.close()
        if stage is None:
            typer.echo("closing the last loops", err=True)
        show_stage(self._view, mapper, stage)

    def mapped(self, result: Result, failure: Exception | None) -> None:
        self._bar.close()
        if self._view is not None:
            self._view.finished(result, failure)

    def saving(self, folder: Path) -> None:
        self._out = folder
        typer.echo(f"writing {one_line(str(folder))}", err=True)

    def saved(self, result: Result, failure: Exception | None) -> None:
        show_problems(self._log, "report.json")
        for warning in sensor_warnings(result.report):
            typer.echo(f"warning: {warning}", err=True)
        typer.echo(summary(result.report, self._out))
        show_sessions(result)
        if failure is not None:
            typer.echo(f"the map until the failure is in {one_line(str(self._out))}", err=True)

    def _paused_s(self) -> float:
        return self._compiler.seconds + (self._view.paused_s if self._view is not None else 0.0)


class UnsavedDisplay(_Display):
    """Shows a run whose map the caller saves, or does not."""

    def __init__(self, log: Log, stop: SignalStop, compiler: CompileWatch) -> None:
        super().__init__(log, Path(), stop, compiler, None)

    def saved(self, result: Result, failure: Exception | None) -> None:
        """Show what is wrong with the recording, and no summary."""
        show_problems(self._log, "report.json")


def show_problems(log: Log, all_of_them: str) -> None:
    """Print the first problems of a recording, and where all of them are found."""
    for problem in log.problems[:MAX_PROBLEMS_SHOWN]:
        typer.echo(f"{problem.severity}: {problem.message}", err=True)
    if log.num_problems > MAX_PROBLEMS_SHOWN:
        rest = log.num_problems - MAX_PROBLEMS_SHOWN
        typer.echo(f"and {rest} more problems; see {all_of_them}", err=True)


def show_stage(view: LiveView | None, mapper: Mapper, stage: str | None) -> None:
    """Show the steps after the last scan in the view, if there is one."""
    if view is None:
        return
    if stage is None:
        view.finishing()
    else:
        view.finishing(stage, mapper)


@contextmanager
def compilation_notice() -> Iterator[CompileWatch]:
    """Yield a watch over the compiler, and inform the user if kernels must be compiled."""
    from cartoloop._jit import watch_compilation

    with watch_compilation(_announce_compilation) as watch:
        yield watch


@cache
def _announce_compilation() -> None:
    """Print how long compiling takes, and start a second process to help, at the first call."""
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


DOUBTFUL_STATUS = 3
"""Exit status with --strict where the map is doubtful, wrong, or was not examined."""


def require_good(report: Report, strict: bool) -> None:
    """End the program with :data:`DOUBTFUL_STATUS` if only a good map is wanted and it is none."""
    if strict and report.quality.verdict != "good":
        raise typer.Exit(DOUBTFUL_STATUS)


def summary(report: Report, out: Path) -> str:
    """Return the summary of a run for the terminal."""
    constraints = report.constraints
    closures = f"{constraints.loop_closure} in the map"
    if constraints.rejected:
        closures += f", {constraints.rejected} rejected because the others contradict them"
    skipped = ", ".join(f"{count} {reason}" for reason, count in sorted(report.skipped.items()))
    rows = {
        "recording": f"{report.input.name}: {report.input.scans} scans, "
        f"{format_duration(report.input.duration_s)}, {report.input.path_length_m:.0f} m",
        "time": f"{report.wall_s:.1f} s, {report.real_time_factor:.0f}x real time",
        "graph": f"{report.nodes} nodes, {report.submaps} submaps",
        "loop closures": closures,
    }
    if constraints.searched:
        rows["searches"] = (
            f"{constraints.searched} pairs of a scan and a submap compared while mapping, "
            f"{constraints.found} matched"
        )
    rows |= {
        "skipped": skipped or "nothing",
        "quality": report.quality.summary(),
        "map": one_line(str(out / "map.png")),
    }
    return "\n".join(f"{name:<15}{value}" for name, value in rows.items())
