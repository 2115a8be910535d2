# SPDX-License-Identifier: Apache-2.0
"""``cartoloop view``: a finished map in the browser; and the options of ``--view``."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar

import typer

from cartoloop.cli.commands import GroupedCommand
from cartoloop.cli.options import VIEW
from cartoloop.cli.stop_signals import stop_signals

if TYPE_CHECKING:
    from cartoloop.config import Config
    from cartoloop.stop_request import StopRequest
    from cartoloop.viewer.opening import Opening
    from cartoloop.viewer.server import ViewServer
    from cartoloop.viewer.view import LiveView

ViewOption = Annotated[
    bool,
    typer.Option(
        "--view", help="Show the map in a browser while it grows, and after.", rich_help_panel=VIEW
    ),
]
ViewHostOption = Annotated[
    str | None,
    typer.Option(
        "--view-host",
        metavar="ADDRESS",
        help="Serve the view to other machines, too: 0.0.0.0, or one address of this machine.",
        rich_help_panel=VIEW,
    ),
]
ViewPortOption = Annotated[
    int | None,
    typer.Option(
        "--view-port",
        metavar="PORT",
        min=1,
        max=65535,
        help="Port of the view; if it is in use, the next free one.",
        rich_help_panel=VIEW,
    ),
]


class ViewingCommand(GroupedCommand):
    """A command that serves a view; options of the view once had shorter names."""

    renamed: ClassVar[Mapping[str, str]] = {"--host": "--view-host", "--port": "--view-port"}


@dataclass(frozen=True, kw_only=True)
class ViewOptions:
    """Options of the view of a recording that is being mapped."""

    view: ViewOption = False
    view_host: ViewHostOption = None
    view_port: ViewPortOption = None
    speed: Annotated[
        float | None,
        typer.Option(
            metavar="FACTOR",
            min=0.1,
            max=1000.0,
            help="Speed of the recording in the view, 1 for real time; by default as fast as "
            "possible. The view can change it.",
            rich_help_panel=VIEW,
        ),
    ] = None

    def require_view(self) -> None:
        """Refuse options that have no effect without a view.

        Raises
        ------
        typer.BadParameter
            One was given.
        """
        require_view(
            self.view, view_host=self.view_host, view_port=self.view_port, speed=self.speed
        )

    def open_view(self, name: str, config: Config, num_scans: int, duration: float) -> LiveView:
        """Serve the view of a recording that is about to be mapped, and print its address.

        Parameters
        ----------
        name : of the recording.
        config : of the mapper.
        num_scans : of the recording.
        duration : of the recording [s].

        Raises
        ------
        ServeError
            It cannot be served there.
        """
        from cartoloop.viewer.site import DEFAULT_HOST, DEFAULT_PORT
        from cartoloop.viewer.view import LiveView

        view = LiveView(
            name,
            config,
            scans_total=num_scans,
            duration_s=duration,
            speed=self.speed,
            host=self.view_host or DEFAULT_HOST,
            port=self.view_port or DEFAULT_PORT,
        )
        typer.echo(f"view           {view.url}")
        return view


@dataclass(frozen=True, kw_only=True)
class ViewCommandOptions:
    """Options of ``cartoloop view``."""

    out: Annotated[
        Path, typer.Argument(metavar="OUT", help="Folder that 'cartoloop map' has written.")
    ]
    view_host: ViewHostOption = None
    view_port: ViewPortOption = None
    edit: Annotated[
        bool,
        typer.Option(
            "--edit",
            help="Pages may drop loop closures and undo edits; the files in OUT follow.",
            rich_help_panel=VIEW,
        ),
    ] = False


def view_command(options: ViewCommandOptions) -> None:
    """Show a finished map in a browser."""
    from cartoloop.viewer.site import DEFAULT_HOST, DEFAULT_PORT

    host, port = options.view_host or DEFAULT_HOST, options.view_port or DEFAULT_PORT
    with stop_signals() as stop, _opening(options.out, host, port) as opening:
        with stop.at_once():
            server, name = _view_of(options, host, port, opening)
        try:
            if opening is None:
                _invite(f"{name}: {server.url}")
            _wait(stop)
        finally:
            server.close()
    if server.failure is not None:
        raise server.failure


@contextmanager
def _opening(out: Path, host: str, port: int) -> Iterator[Opening | None]:
    """Serve the saved picture of a map, if there is one, until the view takes over or it ends."""
    # To import what reads a map takes longer than a reader likes to wait for a picture of it.
    from cartoloop.map_file.first_look import first_look
    from cartoloop.viewer.opening import Opening
    from cartoloop.viewer.site import listen, url_of

    look = first_look(out) if out.is_dir() else None
    if look is None:
        yield None
        return
    place = listen(host, port)
    with closing(Opening(look.picture, place)) as opening:
        _invite(f"{look.name or out.name}: {url_of(host, place)}")
        yield opening


def _view_of(
    options: ViewCommandOptions, host: str, port: int, opening: Opening | None
) -> tuple[ViewServer, str]:
    """Return the server of the view, which takes the place of what was served before, and a name.

    Raises
    ------
    InputError
        There is no map, or it is damaged.
    ServeError
        It cannot be served there.
    """
    from cartoloop.cli.opened_map import open_map
    from cartoloop.result import edit
    from cartoloop.viewer.view import serve_result

    editor = edit(options.out) if options.edit else None
    result = open_map(options.out) if editor is None else editor.map
    name = result.report.input.name or options.out.name
    return serve_result(result, name, host, port, editor=editor, opening=opening), name


def require_view(view: bool, **options: object) -> None:
    """Refuse options that have no effect without a view.

    Raises
    ------
    typer.BadParameter
        One was given.
    """
    for name, value in options.items():
        if value is not None and not view:
            raise typer.BadParameter(
                "has no effect without --view", param_hint=f"--{name.replace('_', '-')}"
            )


def wait_for_stop(what: str, *, is_quiet: bool = False) -> None:
    """Print the address of the view, and return when the user stops it.

    Parameters
    ----------
    what : the address, and what is shown.
    is_quiet : whether standard output is for something else.
    """
    with stop_signals() as stop:  # before the line that invites to Ctrl-C
        _invite(what, is_quiet=is_quiet)
        _wait(stop)


def _invite(what: str, *, is_quiet: bool = False) -> None:
    typer.echo(f"{what} (Ctrl-C ends)", err=is_quiet)


def _wait(stop: StopRequest) -> None:
    while not stop.made:
        time.sleep(0.1)
