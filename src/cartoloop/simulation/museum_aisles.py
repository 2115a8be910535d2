# SPDX-License-Identifier: Apache-2.0
"""Paths in the rooms of a simulated museum, which are kept free of exhibits.

Each room has an aisle, a rectangle at some distance from the walls, and from each of its doors a
spur leads there.
"""

from __future__ import annotations

import math
from itertools import pairwise

from cartoloop.simulation.floor_plan import Box, Point
from cartoloop.simulation.museum_floor import MuseumRoom
from cartoloop.simulation.museum_walls import Door

THRESHOLD = 0.9  # a door is passed straight from so far before it to so far behind it [m]


def aisle(room: MuseumRoom) -> Box:
    """Return the aisle of a room, a rectangle x_min, y_min, x_max, y_max [m], map frame."""
    narrow = min(room.width, room.depth)
    inset = min(max(0.22 * narrow, 1.9), 6.0, 0.5 * narrow - 0.3)
    x_min, y_min, x_max, y_max = room.bounds
    return (x_min + inset, y_min + inset, x_max - inset, y_max - inset)


def spur(room: MuseumRoom, door: Door) -> list[Point]:
    """Return the path from the middle of a door to the aisle of a room, ends included."""
    x_min, y_min, x_max, y_max = aisle(room)
    inwards = math.copysign(THRESHOLD, room.centre[door.axis] - door.place[door.axis])
    threshold = list(door.place)
    threshold[door.axis] += inwards
    x, y = threshold
    return [door.place, (x, y), (min(max(x, x_min), x_max), min(max(y, y_min), y_max))]


def corners_of(box: Box, turn: int) -> list[Point]:
    """Return the corners of a box, counter-clockwise for a `turn` of 1, clockwise for -1."""
    x_min, y_min, x_max, y_max = box
    corners = [(x_min, y_min), (x_max, y_min), (x_max, y_max), (x_min, y_max)]
    return corners[::turn]


def nearest_on(box: Box, point: Point) -> Point:
    """Return the place on the outline of a box that is nearest to a point."""
    corners = corners_of(box, 1)
    places = [
        _nearest_between(begin, end, point)
        for begin, end in zip(corners, [*corners[1:], corners[0]], strict=True)
    ]
    return min(places, key=lambda place: math.dist(place, point))


def _nearest_between(begin: Point, end: Point, point: Point) -> Point:
    along = (end[0] - begin[0], end[1] - begin[1])
    length_squared = along[0] ** 2 + along[1] ** 2
    if length_squared == 0.0:
        return begin
    share = ((point[0] - begin[0]) * along[0] + (point[1] - begin[1]) * along[1]) / length_squared
    share = min(max(share, 0.0), 1.0)
    return begin[0] + share * along[0], begin[1] + share * along[1]


def _leg(corners: list[Point], point: Point) -> int:
    """Return the corner from which the edge begins that a point on the outline lies on."""
    return min(
        range(4),
        key=lambda leg: math.dist(
            point, _nearest_between(corners[leg], corners[(leg + 1) % 4], point)
        ),
    )


def path_along(box: Box, begin: Point, end: Point, turn: int) -> list[Point]:
    """Return the path on the outline of a box from one place on it to another, without `begin`."""
    corners = corners_of(box, turn)
    first, last = _leg(corners, begin), _leg(corners, end)
    num_legs = (last - first) % 4
    if num_legs == 0:
        start = corners[first]
        if math.dist(start, end) < math.dist(start, begin):
            num_legs = 4
    passed = [corners[(first + leg) % 4] for leg in range(1, num_legs + 1)]
    return [*passed, end]


def length_of(path: list[Point]) -> float:
    """Return the length of a path through some points [m]."""
    return sum(math.dist(*leg) for leg in pairwise(path))
