# SPDX-License-Identifier: Apache-2.0
"""Changes as files and lines: a picture of the map, a list in JSON, a table for the terminal."""

from __future__ import annotations

import io
import json
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from cartoloop.localisation.changes.areas import MIN_SIZE_M2, ChangedArea, Changes, Kind
from cartoloop.localisation.known_map import KnownMap
from cartoloop.map_output.colours import APPEARED_COLOUR, DISAPPEARED_COLOUR
from cartoloop.map_output.occupancy_map import UNKNOWN, OccupancyMap
from cartoloop.map_output.output_folder import prepare_folder
from cartoloop.map_output.picture import MapPicture
from cartoloop.map_output.save import write_file
from cartoloop.sensor.pose import inverse, transform_points

PICTURE, LIST = "changes.png", "changes.json"
"""Names of the files."""

FILE_TYPE = "cartoloop changes"
"""What a list of changes says that it is."""

MAX_NUMBERED = 99
"""Areas that get a number in the picture."""

MAX_ROWS = 20
"""Areas in the table for the terminal; the list has all."""

_COLOURS = {Kind.APPEARED: APPEARED_COLOUR, Kind.DISAPPEARED: DISAPPEARED_COLOUR}

_HEADER = (
    f"{'':>4}  {'kind':<12}{'x':>8}{'y':>8}{'m2':>7}{'box m':>12}{'scans':>7}"
    f"{'seen for':>11}{'conf.':>7}"
)


def save_changes(changes: Changes, out: str | PathLike[str]) -> None:
    """Write the picture and the list of changes into a folder, which is created if necessary.

    Each file is written completely or not at all. The same changes yield the same bytes.

    Raises
    ------
    OutputError
        They cannot be written.
    """
    folder = prepare_folder(Path(out))
    write_file(folder / PICTURE, picture_bytes(changes))
    write_file(folder / LIST, json.dumps(content(changes), indent=1) + "\n")


def content(changes: Changes) -> dict[str, Any]:
    """Return changes as values of JSON, the largest area first."""
    first, last = changes.stamps
    return {
        "type": FILE_TYPE,
        "map": changes.known.name,
        "compared_scans": changes.num_scans,
        "first_stamp": first if changes.num_scans else None,
        "last_stamp": last if changes.num_scans else None,
        "min_size_m2": MIN_SIZE_M2,
        "areas": [_area_content(number, area) for number, area in enumerate(changes.areas, 1)],
    }


def _area_content(number: int, area: ChangedArea) -> dict[str, Any]:
    return {
        "number": number,
        "kind": area.kind.value,
        "x": round(area.x, 3),
        "y": round(area.y, 3),
        "size_m2": round(area.size, 4),
        "box": [round(value, 3) for value in area.box],
        "scans": area.num_scans,
        "first_stamp": area.first_stamp,
        "last_stamp": area.last_stamp,
        "confidence": round(area.confidence, 3),
    }


def picture_bytes(changes: Changes) -> bytes:
    """Return a picture of the map with the changes, as a PNG file.

    The areas are numbered as in the list. A map that lies turned is drawn as its cells lie.
    """
    known = changes.known
    counts = {kind: len(changes.of(kind)) for kind in Kind}
    picture = MapPicture(
        _occupancy(known), [known.name, f"{changes.num_scans} scans compared with the map"]
    )
    picture.paint(changes.disappeared, DISAPPEARED_COLOUR)
    picture.paint(changes.appeared, APPEARED_COLOUR)
    numbered = changes.areas[:MAX_NUMBERED]
    beside = np.array([(area.box[2], area.box[3]) for area in numbered]).reshape(-1, 2)
    in_grid = transform_points(inverse(known.tf_map_grid), beside)
    picture.draw_numbers(in_grid, [_COLOURS[area.kind] for area in numbered])
    picture.draw_footer([(f"{counts[kind]} {kind}", colour) for kind, colour in _COLOURS.items()])
    buffer = io.BytesIO()
    picture.canvas.save(buffer, format="png")
    return buffer.getvalue()


def _occupancy(known: KnownMap) -> OccupancyMap:
    """Return the map to be drawn, in the frame of its cells."""
    grid = known.cell_grid
    half = 0.5 * grid.resolution
    probability = np.where(grid.cells == 0, UNKNOWN, known.grid.probabilities())
    return OccupancyMap(
        probability.astype(np.float32), grid.origin_x - half, grid.origin_y - half, grid.resolution
    )


def table(changes: Changes) -> str:
    """Return a table of the changes for the terminal, the largest first."""
    areas = changes.areas
    counts = ", ".join(f"{len(changes.of(kind))} {kind}" for kind in Kind)
    title = f"{'changes':<15}{counts}; {changes.num_scans} scans compared with the map"
    if not areas:
        return title
    rows = [_row(number, area) for number, area in enumerate(areas[:MAX_ROWS], 1)]
    if len(areas) > MAX_ROWS:
        rows.append(f"and {len(areas) - MAX_ROWS} smaller ones")
    return "\n".join((title, _HEADER, *rows))


def _row(number: int, area: ChangedArea) -> str:
    x_min, y_min, x_max, y_max = area.box
    box = f"{x_max - x_min:.1f} x {y_max - y_min:.1f}"
    seconds = area.last_stamp - area.first_stamp
    return (
        f"{number:>4}  {area.kind:<12}{area.x:>8.2f}{area.y:>8.2f}{area.size:>7.2f}{box:>12}"
        f"{area.num_scans:>7}{seconds:>9.0f} s{area.confidence:>7.2f}"
    )
