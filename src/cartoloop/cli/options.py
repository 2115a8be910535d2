# SPDX-License-Identifier: Apache-2.0
"""Options that several commands share."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from cartoloop.map_output.picture import Layer

SetOption = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="KEY=VALUE", help="Set a parameter; see 'config show'."),
]
ConfigOption = Annotated[
    Path | None, typer.Option("--config", metavar="FILE", help="Take parameters from a TOML file.")
]
ThreadsOption = Annotated[
    int | None,
    typer.Option(min=1, help="Background threads; the result does not depend on them."),
]
DrawOption = Annotated[
    str, typer.Option(help="What to draw over map.png: trajectory, closures, or none.")
]


def settings_with_threads(settings: list[str] | None, threads: int | None) -> list[str]:
    """Return the settings, that of the threads among them."""
    given = [] if threads is None else [f"global_slam.num_threads={threads}"]
    return [*(settings or []), *given]


def parse_layers(text: str) -> tuple[Layer, ...]:
    """Return the layers named in a list with commas, the lowest first.

    Raises
    ------
    typer.BadParameter
        There is no layer of such a name.
    """
    from cartoloop.map_output.picture import LAYERS

    names = {name.strip() for name in text.split(",")} - {"none", ""}
    if unknown := sorted(names.difference(LAYERS)):
        raise typer.BadParameter(
            f"cannot draw '{unknown[0]}'; choose from {', '.join(LAYERS)}, none",
            param_hint="--draw",
        )
    return tuple(layer for layer in LAYERS if layer in names)
