# SPDX-License-Identifier: Apache-2.0
"""``cartoloop explain``: why a pair is a loop closure, or is not."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from cartoloop.errors import ConfigError


@dataclass(frozen=True, kw_only=True)
class ExplainOptions:
    """Options of ``cartoloop explain``."""

    out: Annotated[Path, typer.Argument(metavar="OUT", help="Folder of a finished map.")]
    closure: Annotated[
        int | None, typer.Option(metavar="N", help="Row of closures.csv, counted from 0.")
    ] = None
    pair: Annotated[
        tuple[int, int] | None, typer.Option(metavar="SUBMAP NODE", help="A submap and a node.")
    ] = None
    near: Annotated[
        tuple[float, float] | None,
        typer.Option(metavar="X Y", help="Pairs of the nodes near a position of the map [m]."),
    ] = None
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False


def explain_command(options: ExplainOptions) -> None:
    """Explain a loop closure: when it was requested, what the search found, what became of it.

    For a pair that was never requested: why not.
    """
    closure, pair, near = options.closure, options.pair, options.near
    if sum(given is not None for given in (closure, pair, near)) != 1:
        raise ConfigError("give one of --closure N, --pair SUBMAP NODE and --near X Y")

    import json

    from cartoloop.cli.opened_map import open_map
    from cartoloop.map_output.explanation import Explainer

    explainer = Explainer(open_map(options.out))
    if closure is not None:
        explanations = [explainer.row(closure)]
    elif pair is not None:
        explanations = [explainer.pair(*pair)]
    else:
        explanations = explainer.near(*near) if near is not None else []
    if options.as_json:
        typer.echo(json.dumps([one.to_dict() for one in explanations], indent=2))
    else:
        typer.echo("\n\n".join(one.text for one in explanations))
