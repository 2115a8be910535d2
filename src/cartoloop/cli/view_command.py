# SPDX-License-Identifier: Apache-2.0
"""``cartoloop view``: a finished map in the browser; and the options of ``--view``."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cartoloop.cli.stop_signals import stop_signals

if TYPE_CHECKING:
    from cartoloop.config import Config
    from cartoloop.readers import Log
    from cartoloop.viewer.view import LiveView

ViewOption = Annotated[
    bool, typer.Option("--view", help="Show the map in a browser while it grows, and after.")
]
HostOption = Annotated[
    str | None,
    typer.Option(
        metavar="ADDRESS",
        help="Serve the view to other machines, too: 0.0.0.0, or one address of this machine.",
    ),
]
PortOption = Annotated[
    int | None,
    typer.Option(min=1, max=65535, help="Port of the view; the next free one where it is taken."),
]
SpeedOption = Annotated[
    float | None,
    typer.Option(
        min=0.1,
        max=1000.0,
        help="Pace of the recording in the view, 1 for real time; as fast as possible if not "
        "given. The view can change it.",
    ),
]


def view_command(
    out: Annotated[
        Path, typer.Argument(metavar="OUT", help="Folder of a map, as 'cartoloop map' wrote it.")
    ],
    host: HostOption = None,
    port: PortOption = None,
) -> None:
    """Show a finished map in a browser."""
    from cartoloop.map_file.load import load_map
    from cartoloop.viewer.server import DEFAULT_HOST, DEFAULT_PORT
    from cartoloop.viewer.view import serve_result

    result = load_map(out)
    name = result.report.input.name or out.name
    server = serve_result(result, name, host or DEFAULT_HOST, port or DEFAULT_PORT)
    try:
        wait_for_stop(f"{name}: {server.url}")
    finally:
        server.close()
    if server.failure is not None:
        raise server.failure


def open_view(
    log: Log, config: Config, host: str | None, port: int | None, speed: float | None
) -> LiveView:
    """Serve the view of a recording that is about to be mapped, and tell where.

    Raises
    ------
    ServeError
        It cannot be served there.
    """
    from cartoloop.viewer.server import DEFAULT_HOST, DEFAULT_PORT
    from cartoloop.viewer.view import LiveView

    view = LiveView(
        log.name,
        config,
        scans_total=log.num_scans,
        duration_s=log.duration,
        speed=speed,
        host=host or DEFAULT_HOST,
        port=port or DEFAULT_PORT,
    )
    typer.echo(f"view           {view.url}")
    return view


def require_view(view: bool, **options: object) -> None:
    """Refuse options that mean nothing without a view.

    Raises
    ------
    typer.BadParameter
        One was given.
    """
    for name, value in options.items():
        if value is not None and not view:
            raise typer.BadParameter("means nothing without --view", param_hint=f"--{name}")


def wait_for_stop(what: str) -> None:
    """Tell that something is served, and return when the user has had enough."""
    typer.echo(f"{what} (Ctrl-C ends)")
    with stop_signals() as stop:
        while not stop.made:
            time.sleep(0.1)
