# SPDX-License-Identifier: Apache-2.0
"""``cartoloop map``: a recording to a floor plan."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from cartoloop.cli.options import ConfigOptions, OutputOptions, ReadingOptions
from cartoloop.cli.view_command import ViewOptions, wait_for_stop
from cartoloop.readers.formats import format_names

_LOG_HELP = (
    "Recording; several are parts of one, in order. Its format is recognised by its content: "
    f"{', '.join(format_names())}, or a format of an installed package."
)


@dataclass(frozen=True, kw_only=True)
class MapOptions(ViewOptions, ReadingOptions, ConfigOptions, OutputOptions):
    """Options of ``cartoloop map``."""

    logs: Annotated[
        list[Path],
        typer.Argument(metavar="LOG", help=_LOG_HELP),
    ]


def map_command(options: MapOptions) -> None:
    """Map a recording: a text log, a ROS 1 bag or a ROS 2 recording."""
    layers = options.layers
    options.require_view()
    read_options = options.read_options()
    loaded = options.load()

    from cartoloop.readers import open_logs
    from cartoloop.readers.spool import regular_files
    from cartoloop.recording_run import folder_of

    files = regular_files(options.logs)
    folder_of(options.out, files, overwrite=options.overwrite).check()

    from cartoloop.cli.mapping import compilation_notice, map_log, require_good

    with compilation_notice():
        log = open_logs(files, read_options)
    typer.echo(log.description)
    if not options.view:
        result = map_log(log, loaded, options.out, layers, overwrite=options.overwrite)
        require_good(result.report, options.strict)
        return
    view = options.open_view(log.name, loaded.config, log.num_scans, log.duration)
    try:
        result = map_log(log, loaded, options.out, layers, view, overwrite=options.overwrite)
        if view.failure is not None:
            typer.echo(f"warning: the view failed: {view.failure}", err=True)
        else:
            wait_for_stop(f"view           {view.url}")
    finally:
        view.close()
    require_good(result.report, options.strict)
