# SPDX-License-Identifier: Apache-2.0
"""``cartoloop quality``: the verdict on a finished map, and the places that may be wrong."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cartoloop.cli.options import StrictOption

if TYPE_CHECKING:
    from cartoloop.quality.verdict import Place, Quality


@dataclass(frozen=True, kw_only=True)
class QualityOptions:
    """Options of ``cartoloop quality``."""

    out: Annotated[Path, typer.Argument(metavar="OUT", help="Folder of a finished map.")]
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False
    strict: StrictOption = False


def quality_command(options: QualityOptions) -> None:
    """Examine a finished map again: whether it is good, and which places may be wrong.

    The files in the folder stay as they are.
    """
    import json
    from dataclasses import asdict

    from cartoloop.cli.mapping import compilation_notice, require_good
    from cartoloop.cli.opened_map import open_map

    result = open_map(options.out)
    with compilation_notice():
        report = result.examined().report
    if options.as_json:
        typer.echo(json.dumps(asdict(report.quality), indent=2))
    else:
        typer.echo(text(report.quality))
    require_good(report, options.strict)


def text(quality: Quality) -> str:
    """Return the verdict, all places and the figures, for the terminal."""
    places = [_lines(number, place) for number, place in enumerate(quality.places, 1)]
    figures = [f"{name:<32}{value:g}" for name, value in quality.figures.items()]
    return "\n".join((f"verdict        {quality.verdict}", *places, "", *figures))


def _lines(number: int, place: Place) -> str:
    return (
        f"{number:>3}  {place.severity} {place.kind} at x {place.x:.1f} m, y {place.y:.1f} m, "
        f"radius {place.radius:.1f} m, stamps {place.from_stamp:.3f} to {place.to_stamp:.3f}\n"
        f"     {place.reason}\n     try: {place.advice}"
    )
