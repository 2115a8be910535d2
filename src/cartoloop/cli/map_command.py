# SPDX-License-Identifier: Apache-2.0
"""``cartoloop map``: a recording to a floor plan."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from cartoloop.cli.options import (
    ConfigOption,
    DrawOption,
    SetOption,
    ThreadsOption,
    parse_layers,
    settings_with_threads,
)


def map_command(
    logs: Annotated[
        list[Path],
        typer.Argument(metavar="LOG", help="Recording; several are parts of one, in order."),
    ],
    out: Annotated[Path, typer.Option("-o", "--out", metavar="OUT", help="Folder for the map.")],
    settings: SetOption = None,
    config: ConfigOption = None,
    threads: ThreadsOption = None,
    draw: DrawOption = "trajectory",
) -> None:
    """Map a recording: CARMEN logs, plain or gzip."""
    layers = parse_layers(draw)

    from cartoloop.config_file import load_config

    loaded = load_config(config, settings_with_threads(settings, threads))

    from cartoloop.cli.mapping import map_recording
    from cartoloop.readers import open_logs

    log = open_logs(logs)
    typer.echo(log.profile.describe())
    map_recording(log, loaded, out, layers)
