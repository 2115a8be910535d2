# SPDX-License-Identifier: Apache-2.0
"""``cartoloop locate --view``: what is localised in the browser."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

import typer

from cartoloop.cli.view_command import wait_for_stop

if TYPE_CHECKING:
    from cartoloop.cli.locate_command import LocateOptions
    from cartoloop.localisation.localizer import Localizer
    from cartoloop.readers import Log
    from cartoloop.viewer.locate_view import LocateView


@contextmanager
def open_view(
    options: LocateOptions, localizer: Localizer, log: Log | None, *, is_quiet: bool
) -> Iterator[LocateView | None]:
    """Yield the view of a localisation, None if it is not wanted, and print its address.

    Parameters
    ----------
    options : of the command.
    localizer : whose answers are shown.
    log : the recording; None for a live source.
    is_quiet : whether standard output is for poses.

    Raises
    ------
    ServeError
        It cannot be served there.
    """
    if not options.view:
        yield None
        return
    from cartoloop.viewer.locate_view import LocateView
    from cartoloop.viewer.site import DEFAULT_HOST, DEFAULT_PORT

    view = LocateView(
        localizer,
        log.name if log is not None else _source_name(options.source),
        scans_total=None if log is None else log.num_scans,
        duration_s=None if log is None else log.duration,
        speed=options.speed,
        host=options.view_host or DEFAULT_HOST,
        port=options.view_port or DEFAULT_PORT,
        live=log is None,
    )
    typer.echo(f"view           {view.url}", err=is_quiet)
    try:
        yield view
    finally:
        view.close()


def stay_open(view: LocateView, *, is_quiet: bool) -> None:
    """Return when the user ends the view."""
    if view.failure is not None:
        typer.echo(f"warning: the view failed: {view.failure}", err=True)
        return
    wait_for_stop(f"view           {view.url}", is_quiet=is_quiet)


def _source_name(source: str) -> str:
    return "standard input" if source == "-" else source
