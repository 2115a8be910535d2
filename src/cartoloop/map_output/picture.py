# SPDX-License-Identifier: Apache-2.0
"""The map as a picture for people: walls on white floors, paths over it, name and scale bar."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Sequence
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from cartoloop.arguments import shown
from cartoloop.arrays import BoolArray, ByteArray, FloatArray
from cartoloop.errors import UsageError
from cartoloop.map_output.colours import (
    CLOSURE_COLOUR,
    INK,
    LIGHT,
    PLACE_COLOURS,
    TRAJECTORY_COLOUR,
    Colour,
    text_colour,
)
from cartoloop.map_output.occupancy_map import OccupancyMap
from cartoloop.quality.verdict import Place

Layer = Literal["trajectory", "closures", "quality"]
Box = tuple[int, int, int, int]

LAYERS: tuple[Layer, ...] = ("closures", "trajectory", "quality")
"""What can be drawn over the map, the lowest first."""

DEFAULT_LAYERS: tuple[Layer, ...] = ("trajectory", "quality")

_MARGIN = 40
"""Margin around the map [px]."""

_FOOTER = 64
"""Height of the footer with scale bar and legend [px]."""

_FONT_SIZE = 20
"""Size of all text [px]."""

_LINE_PX, _GAP_PX = 28, 28
"""Height of a line of the caption, and between two parts of it [px]."""

_MIN_WIDTH = 480
"""Even a small map leaves this width for its caption and legend [px]."""

_SMALLEST_EDGE = 1600
"""Smaller maps are enlarged until their longer edge is about this long [px]: fills a screen."""

_LARGEST_EDGE = 4000
"""Larger maps are reduced until their longer edge is no longer than this [px]."""

_STRIP_ROWS = 64
"""Rows of pixels that are shaded at a time: bounds the memory."""

NEUTRAL = 127
"""Probability, times 255, that is shown in the colour of unknown cells."""

_SMOOTHING = 2
"""Lines are drawn this much larger and reduced, against stairs."""


def known_layers(layers: Collection[str]) -> tuple[Layer, ...]:
    """Return layers in the order to draw them.

    Raises
    ------
    UsageError
        One of them is unknown, or they are no list.
    """
    if isinstance(layers, str) or not isinstance(layers, Collection):
        raise UsageError(f"layers is {shown(layers)}: give a list, like ['trajectory']")
    if unknown := [layer for layer in layers if layer not in LAYERS]:
        raise UsageError(f"no layer {shown(unknown[0])}: choose from {', '.join(LAYERS)}")
    return tuple(layer for layer in LAYERS if layer in layers)


def draw_map(
    occupancy_map: OccupancyMap,
    *,
    trajectory: FloatArray | None = None,
    closures: FloatArray | None = None,
    caption: Sequence[str] = (),
) -> Image.Image:
    """Return a picture of the map, in RGB.

    Parameters
    ----------
    occupancy_map : what to show.
    trajectory : float64 (n, >= 2), positions along the path [m, map frame], to draw it; a line ends
        where a position is NaN.
    closures : float64 (m, 4), x, y of both ends of each loop closure [m, map frame], to draw them.
    caption : what stands above the map, in parts that are not broken: its name, its facts.

    Notes
    -----
    Small maps are enlarged and large ones reduced, both smoothly, so that walls are not stairs.
    """
    picture = MapPicture(occupancy_map, caption)
    picture.draw(trajectory=trajectory, closures=closures)
    return picture.canvas


class MapPicture:
    """A picture that does not keep the map it was made of, which is as large.

    Parameters
    ----------
    occupancy_map : what to show.
    caption : what stands above it, see `draw_map`.
    is_part : whether it is a part of a map: nothing is then drawn beyond it.

    Attributes
    ----------
    canvas : the picture, in RGB.
    """

    def __init__(
        self,
        occupancy_map: OccupancyMap,
        caption: Sequence[str] = (),
        *,
        is_part: bool = False,
    ) -> None:
        rows, cols = occupancy_map.probability.shape
        self._frame = occupancy_map.frame
        self._zoom = zoom = _zoom(max(rows, cols))
        shrink, enlarge = max(1, round(1.0 / zoom)), max(1, round(zoom))
        size = (-(-cols // shrink) * enlarge, -(-rows // shrink) * enlarge)
        width = max(size[0], _MIN_WIDTH)
        lines = _broken(caption, width)
        top = _MARGIN + (len(lines) * _LINE_PX + _MARGIN // 2 if lines else 0)
        self.canvas = Image.new("RGB", (width + 2 * _MARGIN, top + size[1] + _FOOTER), LIGHT.ground)
        left = (self.canvas.width - size[0]) // 2
        self._offset = np.array((left, top), dtype=np.float64)
        self._box = (left, top, left + size[0], top + size[1]) if is_part else None
        if enlarge == 1:
            _shade(occupancy_map.probability, shrink, self.canvas, (left, top))
        else:
            shaded = Image.new("RGB", (cols, rows))
            _shade(occupancy_map.probability, 1, shaded, (0, 0))
            self.canvas.paste(shaded.resize(size, Image.Resampling.BICUBIC), (left, top))
        _draw_caption(self.canvas, lines)

    def draw(
        self,
        *,
        trajectory: FloatArray | None,
        closures: FloatArray | None,
        places: Sequence[Place] = (),
    ) -> None:
        """Draw the given layers, see `draw_map`, with a legend and a scale bar.

        Places are circles, numbered as in the report from 1 on.
        """
        legend: list[tuple[str, Colour]] = []
        if closures is not None:
            ends = np.hstack((self._to_canvas(closures[:, :2]), self._to_canvas(closures[:, 2:])))
            lines = ends.reshape(-1, 2, 2)
            lines = lines[self._is_shown(lines).any(axis=1)]
            self._draw_lines(lines, CLOSURE_COLOUR, width=1, opacity=0.35)
            legend.append((f"{len(lines)} loop closures", CLOSURE_COLOUR))
        if trajectory is not None:
            paths = _stretches(self._to_canvas(trajectory[:, :2]))
            self._draw_lines(paths, TRAJECTORY_COLOUR, width=2, opacity=0.75)
            legend.append(("trajectory", TRAJECTORY_COLOUR))
        shown = [place for place in places if self._shows(place.x, place.y)]
        for severity, colour in PLACE_COLOURS.items():
            count = sum(place.severity == severity for place in shown)
            if count:
                legend.append((f"{count} {severity} place{'s' if count > 1 else ''}", colour))
        self._draw_places(places)
        self.draw_footer(legend)

    def paint(self, cells: BoolArray, colour: Colour) -> None:
        """Give cells of the map a colour; bool, of its shape."""
        shrink, enlarge = max(1, round(1.0 / self._zoom)), max(1, round(self._zoom))
        rows, cols = cells.shape
        padded = np.pad(cells, ((-rows % shrink, 0), (0, -cols % shrink)))[::-1]
        mask = Image.fromarray(_any_of_blocks(padded, shrink))
        large = mask.resize((mask.width * enlarge, mask.height * enlarge))
        left, top = self._offset.astype(np.int64).tolist()
        self.canvas.paste(colour, (left, top), large)

    def draw_numbers(self, points_map: FloatArray, colours: Sequence[Colour]) -> None:
        """Draw numbers from 1 on, on discs of a colour each, to the upper right of positions.

        Parameters
        ----------
        points_map : float64, shape (n, 2) [m, map frame].
        """
        beside = self._to_canvas(points_map) + np.array((_FONT_SIZE, -_FONT_SIZE))
        for number, ((x, y), colour) in enumerate(zip(beside.tolist(), colours, strict=True), 1):
            self._draw_number(number, x, y, colour)

    def draw_footer(self, legend: Sequence[tuple[str, Colour]]) -> None:
        """Draw the scale bar, and a legend of texts and colours."""
        _draw_footer(self.canvas, self._zoom / self._frame.resolution, legend)

    def _draw_number(self, number: int, x: float, y: float, colour: Colour) -> None:
        """Draw a number on a disc of its colour at a pixel: a bare number is not read on white."""
        font = ImageFont.load_default(_FONT_SIZE)
        draw = ImageDraw.Draw(self.canvas)
        draw.circle((x, y), 0.8 * _FONT_SIZE, fill=colour)
        draw.text((x, y), str(number), fill=text_colour(colour), font=font, anchor="mm")

    def _draw_places(self, places: Sequence[Place]) -> None:
        for number, place in enumerate(places, 1):
            colour = PLACE_COLOURS.get(place.severity)
            if colour is None:
                continue
            angles = np.linspace(0.0, math.tau, 73)
            ring = np.column_stack((np.cos(angles), np.sin(angles))) * place.radius
            ring_px = self._to_canvas(ring + np.array((place.x, place.y)))
            self._draw_lines(ring_px[np.newaxis], colour, width=4, opacity=0.9)
            if self._is_shown(ring_px[9]):  # at the upper right
                x, y = ring_px[9].tolist()
                self._draw_number(number, x, y, colour)

    def _shows(self, x: float, y: float) -> bool:
        """Return whether a position of the map [m] is in the picture."""
        return bool(self._is_shown(self._to_canvas(np.array([(x, y)]))[0]))

    def _is_shown(self, points_px: FloatArray) -> BoolArray:
        """Return which points, shape (..., 2), lie in the part of the map; all if it is whole."""
        if self._box is None:
            return np.ones(points_px.shape[:-1], dtype=np.bool_)
        left, top, right, bottom = self._box
        x, y = points_px[..., 0], points_px[..., 1]
        inside: BoolArray = (x >= left) & (x <= right) & (y >= top) & (y <= bottom)
        return inside

    def _draw_lines(
        self, lines: Iterable[FloatArray], colour: Colour, *, width: int, opacity: float
    ) -> None:
        _draw_lines(self.canvas, lines, colour, width=width, opacity=opacity, box=self._box)

    def _to_canvas(self, points_map: FloatArray) -> FloatArray:
        return self._frame.to_pixels(points_map) * self._zoom + self._offset


def _shade(
    probability: NDArray[np.float32], shrink: int, out_image: Image.Image, left_top: tuple[int, int]
) -> None:
    """Draw the cells alone into a part of an image, `shrink` by `shrink` of them a pixel."""
    # A table of colours, and never all pixels at once: a map may have tens of millions of cells.
    table = palette()[:-1].tobytes()
    left, top = left_top
    from_top = probability[::-1]
    for first in range(0, len(from_top), _STRIP_ROWS * shrink):
        part = from_top[first : first + _STRIP_ROWS * shrink]
        level = np.where(part < 0.0, np.float32(NEUTRAL), part * np.float32(255.0))
        strip = Image.fromarray(np.rint(level).astype(np.uint8))
        strip.putpalette(table)
        out_image.paste(strip.convert("RGB").reduce(shrink), (left, top + first // shrink))


def _any_of_blocks(cells: BoolArray, factor: int) -> BoolArray:
    """Return whether any cell of each block of `factor` by `factor` is true."""
    rows, cols = cells.shape
    blocks = cells.reshape(rows // factor, factor, cols // factor, factor)
    return np.asarray(blocks.any(axis=(1, 3)))


def palette() -> ByteArray:
    """Return the colours of cells by 255 times their probability, uint8 (257, 3), unknown last.

    Floors are bright, walls dark and the rest as the background, the more certain the clearer.
    """
    floor, wall = floor_and_wall(np.linspace(0.0, 1.0, 256)[:, np.newaxis])
    ground, *ends = (np.array(colour, dtype=np.float64) for colour in LIGHT)
    table = ground + floor * (ends[0] - ground) + wall * (ends[1] - ground)
    return np.concatenate((np.rint(table), ground[np.newaxis])).astype(np.uint8)


def floor_and_wall(probability: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return how much floor and how much wall cells are shown as, in [0, 1]; the rest is ground."""
    floor = np.clip((0.5 - probability) / 0.3, 0.0, 1.0)
    wall = np.clip((probability - 0.5) / 0.25, 0.0, 1.0)
    return floor, wall


def _zoom(longest_edge: int) -> float:
    """Return pixels a cell: whole numbers, or whole fractions of one, keep the grid even."""
    if longest_edge > _LARGEST_EDGE:
        return 1.0 / math.ceil(longest_edge / _LARGEST_EDGE)
    return float(min(8, math.ceil(_SMALLEST_EDGE / longest_edge)))


def _draw_lines(
    canvas: Image.Image,
    lines: Iterable[FloatArray],
    colour: Colour,
    *,
    width: int,
    opacity: float,
    box: Box | None = None,
) -> None:
    """Draw polylines, shape (num_points, 2) [px] each, smoothly over the canvas or a box."""
    mask = Image.new("L", (canvas.width * _SMOOTHING, canvas.height * _SMOOTHING))
    draw = ImageDraw.Draw(mask)
    for line in lines:
        points = [(x, y) for x, y in np.round(line * _SMOOTHING, 2).tolist()]
        draw.line(points, fill=round(255 * opacity), width=width * _SMOOTHING, joint="curve")
    mask = mask.reduce(_SMOOTHING)
    if box is not None:
        inside = Image.new("L", mask.size)
        inside.paste(mask.crop(box), box)
        mask = inside
    canvas.paste(colour, mask=mask)


def _stretches(path: FloatArray) -> list[FloatArray]:
    """Return the parts of a path between places that are not finite, shape (k, 2) each."""
    breaks = np.flatnonzero(~np.isfinite(path[:, 0]))
    return [part[np.isfinite(part[:, 0])] for part in np.split(path, breaks)]


def _broken(caption: Sequence[str], width: int) -> list[list[str]]:
    """Return the parts of a caption in lines of at most this width [px]."""
    font = ImageFont.load_default(_FONT_SIZE)
    lines: list[list[str]] = []
    end = math.inf
    for part in caption:
        length = font.getlength(part) + _GAP_PX
        if end + length > width + _GAP_PX:
            lines.append([])
            end = 0.0
        lines[-1].append(part)
        end += length
    return lines


def _draw_caption(canvas: Image.Image, lines: Sequence[Sequence[str]]) -> None:
    draw = ImageDraw.Draw(canvas)
    font = ImageFont.load_default(_FONT_SIZE)
    for number, parts in enumerate(lines):
        x, y = float(_MARGIN), _MARGIN + (number + 0.5) * _LINE_PX
        for part in parts:
            draw.text((x, y), part, fill=INK, font=font, anchor="lm")
            x += font.getlength(part) + _GAP_PX


def _draw_footer(
    canvas: Image.Image, pixels_per_metre: float, legend: Sequence[tuple[str, Colour]]
) -> None:
    """Draw the scale bar and the legend of the layers."""
    draw = ImageDraw.Draw(canvas)
    font = ImageFont.load_default(_FONT_SIZE)
    metres = nice_length(0.2 * (canvas.width - 2 * _MARGIN) / pixels_per_metre)
    x, y = float(_MARGIN), canvas.height - _FOOTER / 2.0
    end = x + metres * pixels_per_metre
    draw.line([(x, y - 6), (x, y), (end, y), (end, y - 6)], fill=INK, width=2)
    x = end + 12
    for text, colour in ((f"{metres:g} m", None), *legend):
        if colour is not None:
            draw.line([(x, y), (x + 28, y)], fill=colour, width=4)
            x += 36
        draw.text((x, y), text, fill=INK, font=font, anchor="lm")
        x += font.getlength(text) + 28


def nice_length(limit: float) -> float:
    """Return the greatest of ..., 0.1, 0.2, 0.5, 1, 2, 5, 10, ... that is within the limit."""
    power = 10.0 ** math.floor(math.log10(limit))
    return next(factor * power for factor in (5, 2, 1) if factor * power <= limit * (1 + 1e-9))
