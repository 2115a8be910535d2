# SPDX-License-Identifier: Apache-2.0
"""Measured lines drawn over the map, numbered, as figure 5 of the paper shows a floor plan."""

from __future__ import annotations

import io
import math
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from cartoloop.arrays import FloatArray
from cartoloop.evaluation.lines import LinesError, MeasuredLine
from cartoloop.evaluation.map_image import MapImage
from cartoloop.evaluation.plot_style import format_by_suffix
from cartoloop.map_output.colours import (
    CLOSURE_COLOUR,
    LIGHT,
    TRAJECTORY_COLOUR,
    Colour,
    text_colour,
)
from cartoloop.map_output.save import write_apart

PICTURE_FORMATS = {".png": "png", ".jpg": "jpeg", ".jpeg": "jpeg", ".webp": "webp"}
"""Of pictures of lines, by the suffix of their names."""

_SMALLEST_EDGE, _LARGEST_EDGE = 1600, 4000
_FONT_SIZE = 22
_TICK = 9.0  # half of the bar across a line's end [px]


def draw_lines(map_image: MapImage, error: LinesError) -> Image.Image:
    """Return a picture, in RGB, of the map and of each line from wall to wall.

    A line with a missing wall is drawn as it was given, in another colour, and crossed out
    at the end that has none.
    """
    picture, zoom = _enlarged(_shaded(map_image))
    draw = ImageDraw.Draw(picture)
    font = ImageFont.load_default(_FONT_SIZE)
    for number, line in enumerate(error.lines, start=1):
        ends = _drawn_ends(line)
        pixels = map_image.to_pixels(ends)
        # in the picture the first row is the top
        pixels[:, 1] = len(map_image.occupancy) - pixels[:, 1]
        _draw_line(draw, pixels * zoom, line)
        x, y = pixels.mean(axis=0) * zoom
        colour = _colour(line)
        box = draw.textbbox((x, y), str(number), font=font, anchor="mm")
        draw.rectangle((box[0] - 4, box[1] - 3, box[2] + 4, box[3] + 3), fill=colour)
        draw.text((x, y), str(number), fill=text_colour(colour), font=font, anchor="mm")
    return picture


def write_picture(picture: Image.Image, path: Path) -> None:
    """Write a picture atomically, in the format of the name's suffix.

    Raises
    ------
    ConfigError
        The name ends with no known format.
    OutputError
        The file cannot be written.
    """
    picture_format = format_by_suffix(path, PICTURE_FORMATS)
    buffer = io.BytesIO()
    picture.save(buffer, format=picture_format)
    write_apart(path, buffer.getvalue())


def _shaded(map_image: MapImage) -> Image.Image:
    """Return the map with free cells bright and occupied cells dark."""
    occupancy = map_image.occupancy
    colours = np.full((*occupancy.shape, 3), LIGHT.ground, dtype=np.uint8)
    colours[(occupancy >= 0.0) & (occupancy < map_image.free_thresh)] = LIGHT.floor
    colours[occupancy > map_image.occupied_thresh] = LIGHT.wall
    return Image.fromarray(colours[::-1])


def _enlarged(picture: Image.Image) -> tuple[Image.Image, float]:
    """Return the picture in a size to look at, and by what factor; enlarged pixels stay squares."""
    longest = max(picture.size)
    if longest <= _LARGEST_EDGE:
        factor = min(8, math.ceil(_SMALLEST_EDGE / longest))
        size = (picture.width * factor, picture.height * factor)
        return picture.resize(size, Image.Resampling.NEAREST), float(factor)
    divisor = math.ceil(longest / _LARGEST_EDGE)
    return picture.reduce(divisor), 1.0 / divisor


def _colour(line: MeasuredLine) -> Colour:
    return TRAJECTORY_COLOUR if None not in line.walls else CLOSURE_COLOUR


def _drawn_ends(line: MeasuredLine) -> FloatArray:
    """Return where a line is drawn from and to, shape (2, 2) [m]: the walls, else as given."""
    given = (line.given[:2], line.given[2:])
    return np.array([wall or end for wall, end in zip(line.walls, given, strict=True)])


def _draw_line(draw: ImageDraw.ImageDraw, ends: FloatArray, line: MeasuredLine) -> None:
    """Draw a line between its ends, shape (2, 2) [px]: a bar at each wall, a cross for none."""
    (x1, y1), (x2, y2) = ends.tolist()
    colour = _colour(line)
    draw.line([(x1, y1), (x2, y2)], fill=colour, width=2)
    length = math.hypot(x2 - x1, y2 - y1)
    # A wall may be missing so near the other that there is no direction left.
    ux, uy = ((x2 - x1) / length, (y2 - y1) / length) if length else (1.0, 0.0)
    bar = ((-uy, ux),)
    cross = ((ux + uy, uy - ux), (ux - uy, uy + ux))
    for (x, y), wall in zip(((x1, y1), (x2, y2)), line.walls, strict=True):
        for dx, dy in bar if wall is not None else cross:
            start = (x - dx * _TICK, y - dy * _TICK)
            draw.line([start, (x + dx * _TICK, y + dy * _TICK)], fill=colour, width=3)
