# SPDX-License-Identifier: Apache-2.0
"""Straight lines measured wall to wall in a map image, against the tape: table I of the paper."""

from __future__ import annotations

import math
from dataclasses import dataclass
from os import PathLike
from typing import Any

import numpy as np

from cartoloop.arrays import FloatArray
from cartoloop.errors import ConfigError, InputError
from cartoloop.evaluation.map_image import MapImage
from cartoloop.evaluation.text_table import read_table
from cartoloop.evaluation.wall_search import wall_distance

Point = tuple[float, float]

DEFAULT_SEARCH_M = 0.5
"""How far a wall may be from where the line was said to end: what a long map may have drifted."""

LAYOUT = "x1 y1 x2 y2 [length]"

MAX_SEARCH_M = 10.0

_ROUNDING_M = 1e-4
"""Lengths in maps come in whole and half pixels, so that errors do lie on the limit: what the
rounding of the ends in a file does to a length must not decide there."""


@dataclass(frozen=True)
class Lines:
    """Straight lines that were measured with the tape.

    Attributes
    ----------
    ends : float64 (n, 4), x1, y1, x2, y2 [m, map frame], each end near a wall.
    lengths : float64 (n,), what the tape said [m], nan where that is not known.
    places : where each line is written, ``file:line``.
    """

    ends: FloatArray
    lengths: FloatArray
    places: tuple[str, ...]


@dataclass(frozen=True)
class MeasuredLine:
    """One line of table I.

    Attributes
    ----------
    place : where the line is written.
    given : x1, y1, x2, y2 as given [m, map frame].
    tape : what the tape said [m], None where that is not known.
    walls : where the wall was found at each end [m, map frame], None where there is none.
    """

    place: str
    given: tuple[float, float, float, float]
    tape: float | None
    walls: tuple[Point | None, Point | None]

    @property
    def length(self) -> float | None:
        """The distance between the two walls [m], None unless both were found."""
        start, end = self.walls
        return None if start is None or end is None else math.dist(start, end)

    @property
    def error(self) -> float | None:
        """How much longer the line is in the map than by the tape [m], None if unknown."""
        length = self.length
        return None if length is None or self.tape is None else length - self.tape

    @property
    def relative_error(self) -> float | None:
        """The error as a part of the tape's length."""
        error = self.error
        return None if error is None or self.tape is None else error / self.tape

    def error_pixels_per_end(self, resolution: float) -> float | None:
        """Return the error in pixels of this edge [m], half of it at each end."""
        error = self.error
        return None if error is None else error / (2.0 * resolution)


@dataclass(frozen=True)
class LinesError:
    """Table I of the paper for one map.

    Attributes
    ----------
    lines : one for each line given, in their order.
    resolution : pixel edge of the map [m].
    search : how far from the given ends walls were looked for [m].
    """

    lines: tuple[MeasuredLine, ...]
    resolution: float
    search: float

    @property
    def errors(self) -> FloatArray:
        """The errors of the lines that count [m]: both walls found, and the tape's length known."""
        errors = [line.error for line in self.lines]
        return np.array([error for error in errors if error is not None], dtype=np.float64)

    @property
    def mean_absolute_error(self) -> float | None:
        """The mean of the errors without their signs [m], None if no line counts."""
        errors = self.errors
        return float(np.mean(np.abs(errors))) if len(errors) else None

    @property
    def num_within_a_pixel(self) -> int:
        """How many lines are wrong by at most a pixel at each end."""
        limit = 2.0 * self.resolution + _ROUNDING_M
        return int(np.count_nonzero(np.abs(self.errors) <= limit))

    def to_dict(self) -> dict[str, Any]:
        """Return plain dictionaries and numbers, as for JSON."""
        return {
            "mean_absolute_error": self.mean_absolute_error,
            "num_lines": len(self.lines),
            "num_compared": len(self.errors),
            "num_within_a_pixel_at_each_end": self.num_within_a_pixel,
            "resolution": self.resolution,
            "search": self.search,
            "lines": [
                {
                    "place": line.place,
                    "given": list(line.given),
                    "walls": [None if wall is None else list(wall) for wall in line.walls],
                    "tape": line.tape,
                    "map": line.length,
                    "error": line.error,
                    "relative_error": line.relative_error,
                    "error_pixels_per_end": line.error_pixels_per_end(self.resolution),
                }
                for line in self.lines
            ],
        }


def read_lines(path: str | PathLike[str]) -> Lines:
    """Return the lines in a file: ``x1 y1 x2 y2 [length]`` each [m, map frame], ``#`` comments.

    Raises
    ------
    InputError
        The file cannot be read or holds no line, or one is not four or five finite numbers, or no
        line between two places, or its length not above zero.
    """
    table, places = read_table(path, LAYOUT, num_optional=1)
    for place, (x1, y1, x2, y2, length) in zip(places, table.tolist(), strict=True):
        if (x1, y1) == (x2, y2):
            raise InputError(f"{place}: both ends of the line are the same, ({x1:g}, {y1:g})")
        if length <= 0.0:
            raise InputError(f"{place}: the length is {length:g}; expected metres above 0")
    return Lines(ends=table[:, :4], lengths=table[:, 4], places=places)


def measure_lines(
    map_image: MapImage, lines: Lines, search: float = DEFAULT_SEARCH_M
) -> LinesError:
    """Return how long the lines are in a map, wall to wall.

    Parameters
    ----------
    map_image : the map.
    lines : what was measured with the tape, in the map's frame.
    search : how far before and behind each given end the wall may be [m], above 0, at most 10.

    Raises
    ------
    ConfigError
        `search` is out of its limits.
    InputError
        A line does not lie within the map.

    Notes
    -----
    The line is followed from its middle to both sides, until it meets a wall near the given end:
    see :func:`cartoloop.evaluation.wall_search.wall_distance`.
    """
    if not 0.0 < search <= MAX_SEARCH_M:
        raise ConfigError(
            f"search = {search:g} m around the ends of lines; expected more than 0, at most "
            f"{MAX_SEARCH_M:g}"
        )
    inside = map_image.holds(lines.ends.reshape(-1, 2)).reshape(-1, 2)
    for place, ends, within in zip(lines.places, lines.ends.tolist(), inside, strict=True):
        if not np.all(within):
            end = int(np.argmin(within)) + 1
            x, y = ends[2 * end - 2 : 2 * end]
            raise InputError(
                f"{place}: end {end} of the line, ({x:g}, {y:g}), is off the map, "
                f"{_extent(map_image)}; lines are given in the frame of the map"
            )
    measured = tuple(
        _measure_line(map_image, place, ends, length, search)
        for place, ends, length in zip(
            lines.places, lines.ends, lines.lengths.tolist(), strict=True
        )
    )
    return LinesError(measured, map_image.resolution, search)


def _extent(map_image: MapImage) -> str:
    rows, cols = map_image.occupancy.shape
    origin, r = map_image.origin, map_image.resolution
    turned = f", turned by {math.degrees(origin.theta):.1f} deg" if origin.theta else ""
    return f"{cols * r:g} m by {rows * r:g} m from ({origin.x:g}, {origin.y:g}){turned}"


def _measure_line(
    map_image: MapImage, place: str, ends: FloatArray, tape: float, search: float
) -> MeasuredLine:
    middle = (ends[:2] + ends[2:]) / 2.0
    half = float(np.hypot(*(ends[2:] - ends[:2]))) / 2.0
    walls: list[Point | None] = []
    for end in (ends[:2], ends[2:]):
        along = (end - middle) / half
        distance = wall_distance(map_image, middle, along, max(0.0, half - search), half + search)
        wall = None if distance is None else (middle + distance * along).tolist()
        walls.append(None if wall is None else (wall[0], wall[1]))
    x1, y1, x2, y2 = ends.tolist()
    return MeasuredLine(
        place=place,
        given=(x1, y1, x2, y2),
        tape=None if math.isnan(tape) else tape,
        walls=(walls[0], walls[1]),
    )
