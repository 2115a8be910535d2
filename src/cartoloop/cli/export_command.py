# SPDX-License-Identifier: Apache-2.0
"""``cartoloop export``: a finished map drawn again, without mapping again."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from cartoloop.cli.completion import complete_formats
from cartoloop.cli.options import PictureLayers

if TYPE_CHECKING:
    from cartoloop.map_output.surveyed_floor import Extent

AUTO = "auto"
"""Value of options that find the best by themselves."""

_FORMATS = "png,pgm,tum,g2o,csv"


@dataclass(frozen=True, kw_only=True)
class ExportOptions(PictureLayers):
    """Options of ``cartoloop export``."""

    source: Annotated[
        Path, typer.Argument(metavar="OUT", help="Folder of a finished map, or its map.cartoloop.")
    ]
    to: Annotated[
        Path,
        typer.Option(
            "-o",
            "--out",
            metavar="TO",
            help="Folder to write, is created; or one file: .png, .pgm (with its .yaml beside), "
            ".tum or .g2o.",
        ),
    ]
    formats: Annotated[
        str,
        typer.Option(
            "--format",
            metavar="FORMATS",
            autocompletion=complete_formats,
            help="Files to write into a folder, with commas: png (picture), pgm (with YAML, for "
            "ROS), tum (trajectories), g2o (pose graph), csv (nodes and closures).",
        ),
    ] = _FORMATS
    resolution: Annotated[
        float | None,
        typer.Option(
            metavar="METRES",
            help="Edge of a cell [m], by default that of the submaps. The map is composed again "
            "of the submaps, not of its pixels.",
        ),
    ] = None
    crop: Annotated[
        str | None,
        typer.Option(
            metavar="L,B,R,T",
            help="Part of the map to draw: left, bottom, right, top [m], after --rotate; auto: "
            "without what only stray rays saw. Trajectories and graph stay whole.",
        ),
    ] = None
    rotate: Annotated[
        str,
        typer.Option(
            metavar="DEG",
            help="Turn the map and all poses counter-clockwise [deg], about the first pose; auto: "
            "so that most walls lie along the axes.",
        ),
    ] = "0"


def export_command(options: ExportOptions) -> None:
    """Draw a finished map again: other cells, a part, turned; without mapping again.

    Without options, the files are those that 'cartoloop map' wrote.
    """
    layers = options.layers
    crop = None if options.crop == AUTO else _crop(options.crop)

    from cartoloop.cli.mapping import compilation_notice
    from cartoloop.cli.opened_map import open_map
    from cartoloop.map_output.export import Drawing, angle_to_axes, export_map, surveyed_part

    degrees = _degrees(options.rotate)
    result = open_map(options.source)
    with compilation_notice():
        turn = angle_to_axes(result) if degrees is None else math.radians(degrees)
        if options.crop == AUTO:
            crop = surveyed_part(result, turn)
        drawing = Drawing(options.resolution, crop, turn, layers)
        formats = [name.strip() for name in options.formats.split(",")]
        written = export_map(result, options.to, drawing, formats)
    if degrees is None:
        typer.echo(f"turned by {math.degrees(turn):.1f} deg", err=True)
    typer.echo("\n".join(map(str, written)))


def _crop(text: str | None) -> Extent | None:
    if text is None:
        return None
    from cartoloop.map_output.surveyed_floor import Extent

    try:
        left, bottom, right, top = map(float, text.split(","))
    except ValueError:
        raise typer.BadParameter(
            f"'{text}' is neither L,B,R,T, like -2,-5,20,8 (m), nor auto", param_hint="--crop"
        ) from None
    return Extent(left, bottom, right, top)


def _degrees(text: str) -> float | None:
    """Return the angle of --rotate, None for auto."""
    if text == AUTO:
        return None
    try:
        return float(text)
    except ValueError:
        raise typer.BadParameter(
            f"'{text}' is neither an angle in degrees nor auto", param_hint="--rotate"
        ) from None
