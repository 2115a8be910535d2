# SPDX-License-Identifier: Apache-2.0
"""``cartoloop merge``: the sessions of several maps in one."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from cartoloop.cli.options import ConfigOptions, OutputOptions


@dataclass(frozen=True, kw_only=True)
class MergeOptions(ConfigOptions, OutputOptions):
    """Options of ``cartoloop merge``."""

    maps: Annotated[
        list[Path],
        typer.Argument(
            metavar="MAP",
            help="Maps: folders that cartoloop map wrote. The first one's frame is kept.",
        ),
    ]


def merge_command(options: MergeOptions) -> None:
    """Merge maps into one: their relative poses are found, not given.

    A map that cannot be joined stays a part of its own in the file, and the status is 4.
    """
    layers = options.layers
    loaded = options.load()

    from cartoloop.cli.mapping import compilation_notice, require_good, summary
    from cartoloop.cli.session_lines import require_joined, show_sessions
    from cartoloop.cli.stop_signals import stop_signals
    from cartoloop.runs.merge import merge_maps

    def note(step: str) -> None:
        typer.echo(step, err=True)

    with stop_signals() as stop, compilation_notice():
        result, place = merge_maps(
            options.maps,
            loaded if loaded.origins else None,
            options.out,
            layers=layers,
            note=note,
            stop=stop,
            overwrite=options.overwrite,
        )
    typer.echo(summary(result.report, place))
    show_sessions(result)
    require_joined(result)
    require_good(result.report, options.strict)
