# SPDX-License-Identifier: Apache-2.0
"""``cartoloop evaluate lines``: distances between walls in a map against tape measurements."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from cartoloop.evaluation.lines import LinesError, MeasuredLine


def lines_command(
    map_path: Annotated[
        Path, typer.Argument(metavar="MAP", help="map.yaml, or the folder that holds it.")
    ],
    lines: Annotated[
        Path,
        typer.Argument(
            metavar="LINES", help="Lines 'x1 y1 x2 y2 [length]' in metres, each end near a wall."
        ),
    ],
    search: Annotated[
        float,
        typer.Option(metavar="METRES", help="Largest distance of a wall from a given end [m]."),
    ] = 0.5,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
    plot: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Draw the lines over the map: .png, .jpg or .webp."),
    ] = None,
) -> None:
    """Measure distances between walls in a map, against tape measurements (paper, table I).

    Lines are given in the frame of the map.
    """
    import json

    from cartoloop.evaluation.lines import measure_lines, read_lines
    from cartoloop.evaluation.lines_picture import PICTURE_FORMATS, draw_lines, write_picture
    from cartoloop.evaluation.map_image import read_map
    from cartoloop.evaluation.plot_style import format_by_suffix

    if plot is not None:
        format_by_suffix(plot, PICTURE_FORMATS)  # refused before any work
    map_image = read_map(map_path)
    error = measure_lines(map_image, read_lines(lines), search)
    if plot is not None:
        write_picture(draw_lines(map_image, error), plot)
    typer.echo(json.dumps(error.to_dict(), indent=2) if as_json else _table(error))
    for number, line in enumerate(error.lines, start=1):
        for end, wall in enumerate(line.walls):
            if wall is None:
                x, y = line.given[2 * end : 2 * end + 2]
                typer.echo(
                    f"cartoloop: {line.place}: line {number} does not count: no wall with free "
                    f"floor before it within {search:g} m of its end {end + 1}, ({x:g}, {y:g})",
                    err=True,
                )


def _table(error: LinesError) -> str:
    """Return the lines as the paper lists them, and the summary."""
    head = ("Line", "Laser tape", "Cartoloop", "Error (absolute)", "Error (relative)", "Pixels/end")
    rows = [head]
    rows += [_row(number, line, error) for number, line in enumerate(error.lines, start=1)]
    table = [
        "  ".join(f"{cell:>{len(title)}}" for cell, title in zip(row, head, strict=True))
        for row in rows
    ]
    mean, num_compared = error.mean_absolute_error, len(error.errors)
    if mean is None:
        summary = ["No line was measured both in the map and with the tape."]
    else:
        summary = [
            f"{'Mean absolute error':<31}{mean:.3f} m",
            f"{'Within a pixel at each end':<31}{error.num_within_a_pixel} of {num_compared} "
            f"(a pixel is {error.resolution:g} m)",
        ]
    return "\n".join((*table, "", *summary))


def _row(number: int, line: MeasuredLine, error: LinesError) -> tuple[str, str, str, str, str, str]:
    relative = line.relative_error
    return (
        str(number),
        _text(line.tape, ".2f"),
        _text(line.length, ".2f"),
        _text(line.error, "+.2f"),
        "-" if relative is None else f"{100.0 * relative:+.1f}%",
        _text(line.error_pixels_per_end(error.resolution), "+.1f"),
    )


def _text(value: float | None, form: str) -> str:
    return "-" if value is None else format(value, form)
