# SPDX-License-Identifier: Apache-2.0
"""The rooms of a simulated museum floor.

Four wings and one across lie around two courtyards::

    +---------------------------------------+
    | galleries   | hall of flight| galler. +--+  north
    |=============== corridor ===============|
    |      |        |       |        |       |
    | west |  court | ships |  court |  east |
    |      |        |       |        |       |
    |-----------------------------------------|
    | galleries   | entrance | big galleries  |
    |== corridor =|          |=== corridor ===|  south
    | galleries   |   hall   | cabinets       |
    +-----------------------------------------+
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from cartoloop.simulation.floor_plan import Box, Point

FLOOR_WIDTH = 190.0
FLOOR_DEPTH = 146.0
PASSAGE_LENGTH = 12.0
"""Between one floor and the next one to its east [m]."""


@dataclass(frozen=True, slots=True)
class MuseumRoom:
    """A rectangular room.

    Attributes
    ----------
    bounds : x_min, y_min, x_max, y_max, between the middle lines of walls [m], map frame.
    kind : "gallery", "cabinet" (one of a row of look-alikes), "hall", "entrance", "corridor",
        "stairs" or "passage" (on to the next floor).
    """

    bounds: Box
    kind: str

    @property
    def width(self) -> float:
        """Extent along x [m]."""
        return self.bounds[2] - self.bounds[0]

    @property
    def depth(self) -> float:
        """Extent along y [m]."""
        return self.bounds[3] - self.bounds[1]

    @property
    def area(self) -> float:
        """Floor area between the middle lines of the walls [m^2]."""
        return self.width * self.depth

    @property
    def centre(self) -> Point:
        """The middle of the room [m]."""
        x_min, y_min, x_max, y_max = self.bounds
        return (x_min + x_max) / 2, (y_min + y_max) / 2


def museum_rooms(rng: np.random.Generator, offset: float) -> list[MuseumRoom]:
    """Return the rooms of one floor, which begins at the x of `offset` [m]."""

    def near(value: float, by: float = 1.5) -> float:
        return value + float(rng.uniform(-by, by))

    right, top = FLOOR_WIDTH, FLOOR_DEPTH
    south, north = near(46.0), near(98.0)  # where the courtyards begin and end
    west, ships, ships_end, east = near(30.0), near(80.0), near(109.0), near(160.0)
    hall, hall_end, hall_top = near(75.0), near(114.0), near(31.0)
    aisle_west, aisle_east = near(19.0), near(16.5)
    flight, flight_end, aisle_north = near(70.0), near(119.0), north + near(5.2, 0.5)
    big = near(148.0)
    notch_x, notch_y = near(162.0), near(131.0)

    tiles: list[tuple[str, Box]] = [
        ("galleries", (0.0, 0.0, hall, aisle_west)),
        ("corridor", (0.0, aisle_west, hall, aisle_west + 4.6)),
        ("galleries", (0.0, aisle_west + 4.6, hall, south)),
        ("entrance", (hall, 0.0, hall_end, hall_top)),
        ("galleries", (hall, hall_top, hall_end, south)),
        ("cabinets", (hall_end, 0.0, right, aisle_east)),
        ("corridor", (hall_end, aisle_east, right, aisle_east + 5.2)),
        ("hall", (hall_end, aisle_east + 5.2, big, south)),
        ("galleries", (big, aisle_east + 5.2, right, south)),
        ("galleries", (0.0, south, west - 5.0, north)),
        ("corridor", (west - 5.0, south, west, north)),
        ("hall", (ships, south, ships_end, north)),
        ("cabinets", (right - 11.0, south, right, north)),
        ("galleries", (east, south, right - 11.0, north)),
        ("corridor", (0.0, north, right, aisle_north)),
        ("galleries", (0.0, aisle_north, flight, top)),
        ("hall", (flight, aisle_north, flight_end, top)),
        ("galleries", (flight_end, aisle_north, notch_x, top)),
        ("galleries", (notch_x, aisle_north, right, notch_y)),
    ]
    rooms = [room for kind, bounds in tiles for room in _rooms_of_tile(rng, kind, bounds)]
    rooms = _with_stairs(rng, rooms)
    return [
        MuseumRoom(
            (room.bounds[0] + offset, room.bounds[1], room.bounds[2] + offset, room.bounds[3]),
            room.kind,
        )
        for room in rooms
    ]


def passage(offset: float) -> MuseumRoom:
    """Return the lobby east of the floor at `offset`, from its south corridor to the next one's."""
    west = offset + FLOOR_WIDTH
    return MuseumRoom((west, 14.5, west + PASSAGE_LENGTH, 26.0), "passage")


def _rooms_of_tile(rng: np.random.Generator, kind: str, bounds: Box) -> Iterator[MuseumRoom]:
    """Yield the rooms that a part of the floor is divided into."""
    if kind == "galleries":
        for gallery in _divide(rng, bounds):
            yield MuseumRoom(gallery, "gallery")
    elif kind == "cabinets":
        x_min, y_min, x_max, y_max = bounds
        axis = 0 if x_max - x_min > y_max - y_min else 1
        low, high = bounds[axis], bounds[2 + axis]
        edges = np.linspace(low, high, round((high - low) / 9.4) + 1).tolist()
        for begin, end in pairwise(edges):
            cabinet = (begin, y_min, end, y_max) if axis == 0 else (x_min, begin, x_max, end)
            yield MuseumRoom(cabinet, "cabinet")
    else:
        yield MuseumRoom(bounds, kind)


def _divide(rng: np.random.Generator, bounds: Box) -> list[Box]:
    """Return galleries of different sizes that fill a box: it is cut in two again and again."""
    x_min, y_min, x_max, y_max = bounds
    width, depth = x_max - x_min, y_max - y_min
    largest = float(rng.uniform(11.0, 21.0))
    if max(width, depth) <= largest or max(width, depth) < 14.0:
        return [bounds]
    share = float(rng.uniform(0.38, 0.62))
    if width >= depth:
        at = x_min + share * width
        parts: tuple[Box, Box] = (x_min, y_min, at, y_max), (at, y_min, x_max, y_max)
    else:
        at = y_min + share * depth
        parts = (x_min, y_min, x_max, at), (x_min, at, x_max, y_max)
    return [gallery for part in parts for gallery in _divide(rng, part)]


def _with_stairs(rng: np.random.Generator, rooms: list[MuseumRoom]) -> list[MuseumRoom]:
    """Return the rooms with stairwells cut off the corners of some of the larger galleries."""
    chosen = [i for i, room in enumerate(rooms) if room.kind == "gallery" and room.width > 12.5]
    stairs = set(rng.permutation(chosen)[:5].tolist())
    changed: list[MuseumRoom] = []
    for index, room in enumerate(rooms):
        if index in stairs:
            x_min, y_min, x_max, y_max = room.bounds
            changed.append(MuseumRoom((x_min, y_min, x_min + 4.6, y_max), "stairs"))
            room = MuseumRoom((x_min + 4.6, y_min, x_max, y_max), room.kind)  # noqa: PLW2901
        changed.append(room)
    return changed
