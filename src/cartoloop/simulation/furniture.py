# SPDX-License-Identifier: Apache-2.0
"""Furniture for simulated floors: placed at random, never on the route or in front of a door."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from cartoloop.arrays import FloatArray
from cartoloop.simulation.floor_plan import WALL_THICKNESS, Box, FloorPlan, Point, Room

WALL_FACE = WALL_THICKNESS / 2


@dataclass(frozen=True, slots=True)
class Item:
    """A piece of furniture that may be moved; all lengths in metres, map frame.

    Attributes
    ----------
    bounds : the space that it takes (x_min, y_min, x_max, y_max).
    area : where it may be moved to.
    solids, lines : as it stands on the floor plan.
    """

    bounds: Box
    area: Box
    solids: tuple[Box, ...]
    lines: tuple[Box, ...]

    def moved(self, x: float, y: float) -> Item:
        """Return the item moved by x, y [m]."""

        def shifted(boxes: tuple[Box, ...]) -> tuple[Box, ...]:
            return tuple((x1 + x, y1 + y, x2 + x, y2 + y) for x1, y1, x2, y2 in boxes)

        return Item(
            shifted((self.bounds,))[0], self.area, shifted(self.solids), shifted(self.lines)
        )


class Furniture:
    """Puts boxes onto a floor plan where they hinder nobody.

    Parameters
    ----------
    plan : gets the furniture.
    route : float64, shape (k, 2), corners of a path that stays clear [m].

    Attributes
    ----------
    items : what may be moved.
    """

    def __init__(self, plan: FloorPlan, route: FloatArray) -> None:
        self.plan = plan
        self.items: list[Item] = []
        self._path = _dense(route, spacing=0.1)
        self._taken: list[Box] = []

    def keep_clear(self, path: FloatArray) -> None:
        """Keep furniture as far from another path as from the route, shape (k, 2) [m]."""
        self._path = np.vstack((self._path, _dense(path, spacing=0.1)))

    def keep_door_clear(self, room: Room) -> None:
        """Reserve the space that a room's door needs on both sides."""
        middle, half = room.door.middle, room.door.width / 2 + 0.4
        self.reserve(room.bounds(middle - half, -1.0, middle + half, 1.1))

    def reserve(self, bounds: Box) -> None:
        """Keep furniture out of a box (x_min, y_min, x_max, y_max) [m]."""
        self._taken.append(bounds)

    def place(
        self,
        bounds: Box,
        clearance: float = 0.6,
        gap: float = 0.0,
        visible: bool = True,
        area: Box | None = None,
    ) -> bool:
        """Add a box unless it blocks a path; return whether it was added.

        Parameters
        ----------
        bounds : x_min, y_min, x_max, y_max [m].
        clearance : distance to keep from the route [m].
        gap : distance to keep from other furniture [m].
        visible : False only reserves the space.
        area : where it may be moved to; None: it stays where it is.
        """
        if not self.is_free(bounds, clearance, gap):
            return False
        self._taken.append(bounds)
        if visible:
            num_solids = len(self.plan.solids)
            self.plan.box(bounds[:2], bounds[2:])
            if area is not None:
                self.items.append(Item(bounds, area, tuple(self.plan.solids[num_solids:]), ()))
        return True

    def place_chair(self, middle: Point, half: float, radius: float, area: Box) -> None:
        """Add a chair unless it blocks a path.

        Parameters
        ----------
        middle : of the chair [m].
        half : half the edge of the square that it takes [m].
        radius : of its corners [m].
        area : where it may be moved to.
        """
        x, y = middle
        bounds = (x - half, y - half, x + half, y + half)
        if self.place(bounds, visible=False):
            num_lines = len(self.plan.lines)
            self.plan.pillar(middle, radius, num_sides=5)
            self.items.append(Item(bounds, area, (), tuple(self.plan.lines[num_lines:])))

    def take_away(self, item: Item) -> None:
        """Remove an item from the floor."""
        self.items.remove(item)
        self._taken.remove(item.bounds)
        for solid in item.solids:
            self.plan.solids.remove(solid)
        for line in item.lines:
            self.plan.lines.remove(line)

    def put(self, item: Item) -> None:
        """Put an item where it says, whatever is there."""
        self._taken.append(item.bounds)
        self.items.append(item)
        self.plan.solids.extend(item.solids)
        self.plan.lines.extend(item.lines)

    def segments(self) -> FloatArray:
        """Return the outlines of the items, shape (num_segments, 4) [m]."""
        solids = [solid for item in self.items for solid in item.solids]
        lines = [line for item in self.items for line in item.lines]
        return FloorPlan(solids, lines).segments()

    def is_free(self, bounds: Box, clearance: float, gap: float) -> bool:
        """Return whether a box keeps these distances to the paths and other furniture [m]."""
        x_min, y_min, x_max, y_max = bounds
        away_x = np.maximum(np.maximum(x_min - self._path[:, 0], self._path[:, 0] - x_max), 0.0)
        away_y = np.maximum(np.maximum(y_min - self._path[:, 1], self._path[:, 1] - y_max), 0.0)
        if float(np.hypot(away_x, away_y).min()) < clearance:
            return False
        for x1, y1, x2, y2 in self._taken:
            if x_min < x2 + gap and x1 < x_max + gap and y_min < y2 + gap and y1 < y_max + gap:
                return False
        return True


def furnish_room(furniture: Furniture, rng: np.random.Generator, room: Room) -> None:
    """Make a room an office, a meeting room or a store, as its size allows."""
    kind = rng.choice(["office", "office", "meeting", "store"])
    if kind == "meeting" and room.width > 3.6:
        _meeting_table(furniture, rng, room)
    elif kind == "store" and room.width < 6.0:
        _shelf_rows(furniture, rng, room)
    else:
        _desks(furniture, rng, room)
    for _ in range(int(room.width * room.depth / 7.0)):
        _cabinet(furniture, rng, room)


def furnish_corridor(
    furniture: Furniture, rng: np.random.Generator, begin: Point, end: Point
) -> None:
    """Put a few things along the middle line of a corridor's wall, on both of its sides."""
    length = math.dist(begin, end)
    ux, uy = (end[0] - begin[0]) / length, (end[1] - begin[1]) / length
    for _ in range(round(length / 4.0)):
        at, size = rng.uniform(0.3, length - 1.9), rng.uniform(0.25, 1.5)
        depth = WALL_FACE + rng.uniform(0.1, 0.32)
        x, y = begin[0] + at * ux, begin[1] + at * uy
        across_x, across_y = depth * abs(uy), depth * abs(ux)
        furniture.place(
            (x - across_x, y - across_y, x + size * ux + across_x, y + size * uy + across_y),
            clearance=0.45,
            gap=0.8,
            area=(
                begin[0] - across_x,
                begin[1] - across_y,
                end[0] + across_x,
                end[1] + across_y,
            ),
        )


def inside(room: Room) -> Box:
    """Return the floor of a room between its walls (x_min, y_min, x_max, y_max) [m]."""
    return room.bounds(WALL_FACE, WALL_FACE, room.width - WALL_FACE, room.depth - WALL_FACE)


def _desks(furniture: Furniture, rng: np.random.Generator, room: Room) -> None:
    """Put desks at the back wall, each with a chair before it."""
    back = room.depth - WALL_FACE
    for _ in range(round(room.width / 1.6)):
        width, depth = rng.uniform(1.2, 1.8), rng.uniform(0.65, 0.85)
        u = rng.uniform(WALL_FACE, max(room.width - width - WALL_FACE, 0.1))
        desk = room.bounds(u, back - depth, u + width, back)
        if furniture.place(desk, gap=0.15, area=inside(room)):
            chair_u, chair_v = u + width * rng.uniform(0.3, 0.7), back - depth - 0.35
            furniture.place_chair(room.point(chair_u, chair_v), 0.25, 0.24, inside(room))


def _meeting_table(furniture: Furniture, rng: np.random.Generator, room: Room) -> None:
    """Put a table with chairs into the middle of the room."""
    half_u = min(2.0, room.width / 2 - 1.3)
    half_v = min(0.8, room.depth / 2 - 1.5)
    u, v = room.width / 2, room.depth / 2 + rng.uniform(0.0, 0.6)
    table = room.bounds(u - half_u, v - half_v, u + half_u, v + half_v)
    if not furniture.place(table, area=inside(room)):
        _desks(furniture, rng, room)
        return
    for side in (-1.0, 1.0):
        for chair_u in np.arange(u - half_u + 0.4, u + half_u - 0.2, 0.9):
            chair_v = v + side * (half_v + rng.uniform(0.3, 0.5))
            furniture.place_chair(room.point(chair_u, chair_v), 0.24, 0.23, inside(room))


def _shelf_rows(furniture: Furniture, rng: np.random.Generator, room: Room) -> None:
    """Put rows of shelves upright to the back wall."""
    back = room.depth - WALL_FACE
    length = room.depth * rng.uniform(0.4, 0.6)
    for u in np.arange(WALL_FACE, room.width - 0.5, rng.uniform(1.3, 1.6)):
        shelf = room.bounds(u, back - length, u + 0.45, back)
        furniture.place(shelf, gap=0.3, area=inside(room))


def _cabinet(furniture: Furniture, rng: np.random.Generator, room: Room) -> None:
    """Put a cabinet at a side wall or at the front wall."""
    length, depth = rng.uniform(0.6, 2.0), rng.uniform(0.35, 0.6)
    if rng.random() < 0.3:
        u = rng.uniform(WALL_FACE, max(room.width - length - WALL_FACE, 0.1))
        bounds = room.bounds(u, WALL_FACE, u + length, WALL_FACE + depth)
    else:
        u = WALL_FACE if rng.random() < 0.5 else room.width - WALL_FACE - depth
        v = rng.uniform(WALL_FACE, room.depth - WALL_FACE - length)
        bounds = room.bounds(u, v, u + depth, v + length)
    furniture.place(bounds, gap=0.1, area=inside(room))


def _dense(route: FloatArray, spacing: float) -> FloatArray:
    """Return points along a polyline, at most `spacing` [m] apart."""
    legs = [
        np.linspace(start, end, max(2, int(np.ceil(np.hypot(*(end - start)) / spacing)) + 1))
        for start, end in pairwise(route)
    ]
    return np.vstack(legs)
