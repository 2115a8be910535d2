# SPDX-License-Identifier: Apache-2.0
"""Output of live mapping on the terminal and in the view."""

from __future__ import annotations

import sys
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

import typer

from cartoloop.cli.lost_output import would_wait
from cartoloop.cli.mapping import compilation_notice, show_stage, summary
from cartoloop.cli.session_lines import session_lines
from cartoloop.cli.stop_signals import stop_signals
from cartoloop.cli.view_command import wait_for_stop
from cartoloop.errors import OutputError
from cartoloop.live.live_run import LiveObserver, LiveOptions, map_live
from cartoloop.live.poses import open_poses
from cartoloop.map_file.file_set import require_no_map_file
from cartoloop.plain_text import one_line
from cartoloop.runtime.process_memory import relax_gc, set_malloc_thresholds

if TYPE_CHECKING:
    from cartoloop.config_file import LoadedConfig
    from cartoloop.live.source import Source
    from cartoloop.map_output.picture import Layer
    from cartoloop.mapper import Mapper
    from cartoloop.result import Result
    from cartoloop.viewer.view import LiveView


def map_source(
    source: Source,
    loaded: LoadedConfig | None,
    out: Path,
    options: LiveOptions,
    layers: Collection[Layer],
    view_address: tuple[str | None, int | None] | None = None,
    *,
    is_quiet: bool = False,
    overwrite: bool = False,
    onto: Path | None = None,
    lifelong: bool = False,
) -> Result:
    """Map what a source sends, save the map and print the summary; see `live_run.map_live`.

    Parameters
    ----------
    source : of messages.
    loaded : the configuration; None: that of the map that is added to.
    out : folder for the map.
    options : how messages are treated.
    layers : drawn over the picture.
    view_address : host and port of the view, None each for the default; None: no view.
    is_quiet : whether standard output is for poses.
    overwrite : whether a map in `out` may be replaced.
    onto : the map that the drive is added to, or None.
    lifelong : whether what the drive shows again gives way to it.
    """
    set_malloc_thresholds()
    relax_gc()
    with (
        stop_signals() as stop,
        compilation_notice(),
        _view(source, loaded, view_address, is_quiet) as view,
    ):
        display = _Display(out, view, is_quiet)
        result = map_live(
            source,
            loaded,
            out,
            options,
            layers=layers,
            observer=display,
            stop=stop,
            overwrite=overwrite,
            onto=onto,
            lifelong=lifelong,
        )
        if view is not None:
            wait_for_stop(f"view           {view.url}")
    return result


class _Display(LiveObserver):
    """Shows a live run on the terminal and in the view.

    Parameters
    ----------
    out : folder of the map.
    view : shows the map while it grows, or None.
    is_quiet : whether standard output is used otherwise.
    """

    def __init__(self, out: Path, view: LiveView | None, is_quiet: bool) -> None:
        self._out, self._view, self._is_quiet = out, view, is_quiet
        self._is_due = False

    def say(self, line: str) -> None:
        """Print a line, unless that would hold up the mapping."""
        if not would_wait(sys.stderr):
            typer.echo(line, err=True)

    def changed(self, mapper: Mapper) -> None:
        """Update the view, in the thread that owns the pose graph."""
        view = self._view
        if view is None or self._is_due:
            return

        def update() -> None:
            self._is_due = False
            view.after_event(mapper)

        self._is_due = True
        mapper.run_on_graph_thread(update)

    def finishing(self, mapper: Mapper, stage: str | None) -> None:
        if stage is None:
            self.say("closing the last loops (Ctrl-C skips this)")
        show_stage(self._view, mapper, stage)

    def mapped(self, result: Result, failure: Exception | None) -> None:
        if self._view is not None:
            self._view.finished(result, failure)

    def saving(self, folder: Path) -> None:
        self._out = folder
        self.say(f"writing {one_line(str(folder))}")

    def saved(self, result: Result, failure: Exception | None) -> None:
        text = summary(result.report, self._out)
        text = "\n".join((text, *session_lines(result)))
        if self._is_quiet:
            self.say(text)
        else:
            typer.echo(text)


@contextmanager
def poses_stream(name: str | None, *inputs: str | Path) -> Iterator[BinaryIO | None]:
    """Yield the stream for poses: a file, standard output for ``-``, or None.

    Parameters
    ----------
    name : of the file.
    inputs : what is read, which it must not replace.

    Raises
    ------
    OutputError
        The file cannot be written or is read, or nobody reads the pipe.
    """
    if name is None:
        yield None
        return
    if name != "-":
        path = Path(name)
        require_no_map_file(path)
        if path.is_file() and any(Path(each).is_file() and path.samefile(each) for each in inputs):
            raise OutputError(f"--poses {name}: is read by this command; give another file")
    file: BinaryIO
    try:
        # Not sys.stdout, which forgets what is lost: the loss of poses is reported.
        if name == "-":
            file = open(sys.stdout.fileno(), "wb", buffering=0, closefd=False)  # noqa: SIM115
        else:
            file = open_poses(Path(name))
    except OSError as error:
        raise OutputError(f"--poses {name}: cannot be written: {error.strerror}") from error
    with file:
        yield file


@contextmanager
def _view(
    source: Source,
    loaded: LoadedConfig | None,
    address: tuple[str | None, int | None] | None,
    is_quiet: bool,
) -> Iterator[LiveView | None]:
    """Yield the view, if there is one."""
    if address is None:
        yield None
        return
    from cartoloop.config import Config
    from cartoloop.viewer.site import DEFAULT_HOST, DEFAULT_PORT
    from cartoloop.viewer.view import LiveView

    view = LiveView(
        source.name,
        loaded.config if loaded else Config(),
        host=address[0] or DEFAULT_HOST,
        port=address[1] or DEFAULT_PORT,
        live=True,
    )
    typer.echo(f"view           {view.url}", err=is_quiet)
    try:
        yield view
    finally:
        view.close()
