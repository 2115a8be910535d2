# SPDX-License-Identifier: Apache-2.0
"""Live mapping from the command line: getting ready, stopping, saving, summary."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

import typer

from cartoloop.cli.mapping import compilation_told, completed, finishing_note, summary, timed
from cartoloop.cli.stop_signals import StopRequest, stop_signals
from cartoloop.errors import InputError, Interrupted, OutputError
from cartoloop.runtime.process_memory import (
    relax_gc,
    release_unused_memory,
    set_malloc_thresholds,
)

if TYPE_CHECKING:
    from cartoloop.config_file import LoadedConfig
    from cartoloop.live.notices import Notices
    from cartoloop.live.session import AddedScan, LiveSession
    from cartoloop.live.source import Source
    from cartoloop.map_output.picture import Layer
    from cartoloop.map_output.result import Result
    from cartoloop.mapper import Mapper
    from cartoloop.sensor.pose import Pose
    from cartoloop.viewer.view import LiveView


@dataclass(frozen=True, slots=True)
class LiveOptions:
    """What the user says about live mapping.

    Attributes
    ----------
    layers : drawn over the picture.
    poses : file for the poses of scans; - is standard output.
    max_delay : how long a scan waits for late odometry [s].
    end_after : end when nothing has come for so long [s].
    waits : whether the source is held up instead of dropping scans.
    laser_pose : where the first scanner sits on the robot.
    view, view_host, view_port : whether and where the map is shown.
    """

    layers: Collection[Layer] = ()
    poses: str | None = None
    max_delay: float = 0.05
    end_after: float | None = None
    waits: bool = False
    laser_pose: Pose | None = None
    view: bool = False
    view_host: str | None = None
    view_port: int | None = None


def map_live(source: Source, loaded: LoadedConfig, out: Path, options: LiveOptions) -> Result:
    """Map what a source sends until it ends or the user has enough; save, and tell about it.

    Raises
    ------
    InputError
        The source cannot be opened, or failed; what was mapped until then is saved.
    OutputError
        The folder `out` cannot be written.
    Interrupted
        The user did not want to wait for the last loops; what was mapped is saved.
    """
    from cartoloop.live.notices import Notices
    from cartoloop.live.warm_up import get_ready
    from cartoloop.map_output.save import prepare_folder, save, save_report
    from cartoloop.mapper import Mapper

    start = time.perf_counter()
    set_malloc_thresholds()
    relax_gc()
    prepare_folder(out)
    tell = _Teller()
    notices = Notices(tell)
    with stop_signals() as stop, compilation_told():
        get_ready()
        mapper = Mapper(loaded.config, live=True)
        with _poses_file(options.poses) as poses, _view(source, loaded, options) as view:
            session, save_now = _session(source, mapper, out, notices, options, poses, view)
            tell(f"{source.open()} (Ctrl-C ends)")
            failure = _run(session, mapper, stop)
            result, is_whole, failure = _finish(mapper, stop, view, failure)
            save_now()
            name = source.name
            report = completed(result, name, notices.skipped, (), time.perf_counter() - start)
            result = replace(result, report=report)
            if view is not None:
                view.finished(result, failure)
            tell(f"writing {out}")
            release_unused_memory()
            save(result, out, layers=options.layers, origins=loaded.origins)
            report = timed(report, time.perf_counter() - start)
            save_report(report, out)
            typer.echo(summary(report, out), err=options.poses == "-")
            if failure is not None:
                raise failure
            if not is_whole:
                raise Interrupted(f"the last loops were not closed; the map so far is in {out}")
            if report.nodes == 0:
                raise InputError(
                    f"{name}: no scan came that shows enough to be mapped, the map in {out} is "
                    "empty; docs/live.md tells what to send"
                )
            if view is not None:
                from cartoloop.cli.view_command import wait_for_stop

                wait_for_stop(f"view           {view.url}")
    return result


class _Teller:
    """Tells a line on standard error, whichever thread it comes from."""

    def __call__(self, line: str) -> None:
        typer.echo(line, err=True)


def _session(
    source: Source,
    mapper: Mapper,
    out: Path,
    notices: Notices,
    options: LiveOptions,
    poses: BinaryIO | None,
    view: LiveView | None,
) -> tuple[LiveSession, Callable[[], None]]:
    """Return the session, and what waits for its files to be written in the end."""
    from cartoloop.live.autosave import Autosave
    from cartoloop.live.inbox import Inbox
    from cartoloop.live.poses import PoseWriter
    from cartoloop.live.sequencer import Sequencer
    from cartoloop.live.session import LiveSession

    autosave = Autosave(mapper, out, notices)
    writer = None if poses is None else PoseWriter(poses, notices)
    shown = None if view is None else _Shown(mapper, view)

    def after_scan(scan: AddedScan) -> None:
        if writer is not None:
            writer.put(scan.stamp, scan.tf_local_tracking, scan.tf_map_tracking, scan.latency)
        autosave.after_scan()
        if shown is not None:
            shown.refresh()

    session = LiveSession(
        source,
        mapper,
        Inbox(waits=options.waits),
        Sequencer(notices, options.max_delay, options.laser_pose),
        notices,
        after_scan=after_scan,
        idle=None if shown is None else shown.refresh,
        end_after=options.end_after,
    )

    def end() -> None:
        autosave.close()
        if writer is not None:
            writer.close()

    return session, end


class _Shown:
    """Has the view look at the map, in the thread in which the graph stands still."""

    def __init__(self, mapper: Mapper, view: LiveView) -> None:
        self._mapper, self._view = mapper, view
        self._is_due = False

    def refresh(self) -> None:
        if not self._is_due:
            self._is_due = True
            self._mapper.run_on_graph_thread(self._look)

    def _look(self) -> None:
        self._is_due = False
        self._view.after_event(self._mapper)


def _run(session: LiveSession, mapper: Mapper, stop: StopRequest) -> Exception | None:
    """Run the session; return what it failed of, if there is a map to be saved nevertheless."""
    try:
        session.run(lambda: stop.made)
    except KeyboardInterrupt:
        stop.made = True
    except Exception as failure:
        if mapper.num_scans == 0:
            mapper.close()
            raise
        return failure
    return None


def _finish(
    mapper: Mapper, stop: StopRequest, view: LiveView | None, failure: Exception | None
) -> tuple[Result, bool, Exception | None]:
    """Return the map, whether its last loops were closed, and what failed, if anything did."""
    try:
        stop.made = False  # from now on, another Ctrl-C counts
        if failure is None:
            if view is not None:
                view.finishing()
            typer.echo("closing the last loops (Ctrl-C: do without)", err=True)
            with stop.at_once():
                return mapper.finish(finishing_note(view, mapper)), True, None
    except KeyboardInterrupt:
        pass  # the user does not want to wait
    except Exception as late_failure:  # noqa: BLE001 - raised when the map is saved
        failure = late_failure
    finally:
        mapper.close()
    return mapper.result(), False, failure


@contextmanager
def _poses_file(name: str | None) -> Iterator[BinaryIO | None]:
    """Yield where poses are written to, if they are."""
    if name is None or name == "-":
        yield None if name is None else sys.stdout.buffer
        return
    try:
        file = Path(name).open("wb")  # noqa: SIM115 - closed below
    except OSError as error:
        raise OutputError(f"--poses {name}: cannot be written: {error.strerror}") from error
    with file:
        yield file


@contextmanager
def _view(source: Source, loaded: LoadedConfig, options: LiveOptions) -> Iterator[LiveView | None]:
    """Yield the view, if it is wanted."""
    if not options.view:
        yield None
        return
    from cartoloop.viewer.server import DEFAULT_HOST, DEFAULT_PORT
    from cartoloop.viewer.view import LiveView

    view = LiveView(
        source.name,
        loaded.config,
        host=options.view_host or DEFAULT_HOST,
        port=options.view_port or DEFAULT_PORT,
        live=True,
    )
    typer.echo(f"view           {view.url}", err=options.poses == "-")
    try:
        yield view
    finally:
        view.close()
