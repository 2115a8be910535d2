# SPDX-License-Identifier: Apache-2.0
"""Walks through a simulated museum: along the aisles of its rooms, with many loops.

A visit of a room follows its whole aisle, passing through takes the shorter side. The aisles are
free, so any number of walks fits the same museum.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from cartoloop.simulation.floor_plan import Point
from cartoloop.simulation.museum_aisles import (
    aisle,
    length_of,
    nearest_on,
    path_along,
    spur,
)
from cartoloop.simulation.museum_floor import MuseumRoom
from cartoloop.simulation.museum_walls import Door

NARROW_M = 2.1
"""Width of an aisle below which it is crossed anywhere, as corridors are [m]."""

WANDERING_M = 0.18
"""Largest deviation of a walker from an aisle's middle line [m]."""

RETURN_AFTER_M = (120.0, 260.0)
"""Path length until the walker returns to an earlier place [m]."""

SHARE_VISITED = 0.14
"""Share of the rooms that one walk visits, so that a walk has the length of the paper's."""

DETOUR = 1.1
"""Path length along aisles over that from door to door through the middles of rooms."""

LOOP_AFTER_M = 90.0
"""Path length since a place was left, from which on returning there closes a loop [m]."""


class Museum:
    """Rooms, doors and shortest paths between rooms.

    Parameters
    ----------
    rooms, doors : of all floors.
    """

    def __init__(self, rooms: Sequence[MuseumRoom], doors: Sequence[Door]) -> None:
        from scipy.sparse import coo_array  # slow to import, and only museums need it
        from scipy.sparse.csgraph import dijkstra

        self.rooms = rooms
        self.doors = {frozenset(door.rooms): door for door in doors}
        ends = np.array([door.rooms for door in doors])
        lengths = [
            sum(math.dist(door.place, rooms[room].centre) for room in door.rooms) for door in doors
        ]
        graph = coo_array((lengths, (ends[:, 0], ends[:, 1])), shape=(len(rooms), len(rooms)))
        self.distances, self._before = dijkstra(graph, directed=False, return_predecessors=True)

    def path(self, start: int, end: int) -> list[int]:
        """Return the rooms on the shortest path from one room to another, both included."""
        path = [end]
        while path[-1] != start:
            path.append(int(self._before[start, path[-1]]))
        return path[::-1]

    def door(self, room: int, other: int) -> Door:
        """Return the door between two rooms."""
        return self.doors[frozenset((room, other))]


class Walker:
    """A walker from room to room, with the path so far.

    Parameters
    ----------
    museum : where.
    rng : of the deviations from the aisles.
    start : the room to begin in, on its aisle.
    """

    def __init__(self, museum: Museum, rng: np.random.Generator, start: int) -> None:
        self.museum = museum
        self.room = start
        self.travelled = 0.0
        self.left_at: dict[int, float] = {start: 0.0}
        self._rng = rng
        x_min, y_min, *_ = aisle(museum.rooms[start])
        self.points: list[Point] = [(x_min, y_min)]

    def go(self, target: int, visits: bool) -> None:
        """Walk to another room and onto its aisle; if `visits`, walk around it as well."""
        for here, there in pairwise(self.museum.path(self.room, target)):
            door = self.museum.door(here, there)
            out = spur(self.museum.rooms[here], door)
            into = spur(self.museum.rooms[there], door)
            self._follow_aisle(here, out[-1])
            self._append([*out[-2::-1], *into[1:]], 0.1)
            self.left_at[here] = self.travelled
            self.left_at[there] = self.travelled
        self.room = target
        if visits:
            self._round(target)
            self.left_at[target] = self.travelled

    def return_to_corner(self) -> None:
        """Walk to that corner of the room's aisle at which a walker begins."""
        x_min, y_min, *_ = aisle(self.museum.rooms[self.room])
        self._follow_aisle(self.room, (x_min, y_min))

    def lap_length(self, room: int) -> float:
        """Return the length of a lap on the aisle of a room [m]."""
        x_min, y_min, x_max, y_max = aisle(self.museum.rooms[room])
        return float(2.0 * (x_max - x_min + y_max - y_min))

    def _follow_aisle(self, room: int, end: Point) -> None:
        """Walk along the aisle of a room to a place on it, in the shorter direction."""
        box = aisle(self.museum.rooms[room])
        begin = nearest_on(box, self.points[-1])
        if min(box[2] - box[0], box[3] - box[1]) < NARROW_M:
            self._append([end], WANDERING_M)
            return
        paths = [path_along(box, begin, end, turn) for turn in (1, -1)]
        self._append(min(paths, key=lambda path: length_of([begin, *path])), WANDERING_M)

    def _round(self, room: int) -> None:
        """Walk once around the aisle of a room, in either direction."""
        box = aisle(self.museum.rooms[room])
        begin = nearest_on(box, self.points[-1])
        turn = 1 if self._rng.random() < 0.5 else -1
        opposite = ((box[0] + box[2] - begin[0]), (box[1] + box[3] - begin[1]))
        there, back = (
            path_along(box, begin, opposite, turn),
            path_along(box, opposite, begin, turn),
        )
        self._append([*there[:-1], *back[:-1]], WANDERING_M)

    def _append(self, points: list[Point], wandering: float) -> None:
        for x, y in points:
            aside = self._rng.uniform(-wandering, wandering, 2)
            point = (x + float(aside[0]), y + float(aside[1]))
            apart = math.dist(point, self.points[-1])
            if apart > 0.7:  # nearer ones only make the walker turn on the spot
                self.points.append(point)
                self.travelled += apart


def walk(
    museum: Museum,
    rng: np.random.Generator,
    rooms: Sequence[int],
    start: int,
    end: int,
    length: float,
) -> list[Point]:
    """Return a walk of about `length` [m] through some rooms that comes back to earlier places.

    Parameters
    ----------
    museum : where.
    rng : of the choice of rooms, and of the deviations from the aisles.
    rooms : those that may be visited, by index.
    start, end : the first and the last room; the walk begins and ends at a corner of their aisles,
        so that another one can follow.
    """
    walker = Walker(museum, rng, start)
    open_rooms = [room for room in rooms if museum.rooms[room].kind not in ("stairs", "passage")]
    chosen = _round_trip(museum, rng, open_rooms, start)
    return_at = float(rng.uniform(*RETURN_AFTER_M))
    while True:
        distances = museum.distances[walker.room]
        left = length - walker.travelled - DETOUR * (distances + museum.distances[end])
        affordable = [room for room in open_rooms if left[room] > 0.0 and room != walker.room]
        if not affordable:
            break
        affordable.sort(key=lambda room: float(distances[room]))
        unseen = [
            room
            for room in chosen
            if room in affordable
            and room not in walker.left_at
            and left[room] > walker.lap_length(room)
        ]
        earlier = [
            room
            for room in affordable
            if walker.travelled - walker.left_at.get(room, math.inf) > LOOP_AFTER_M
        ]
        if unseen and (walker.travelled < return_at or not earlier):
            walker.go(unseen[0], visits=museum.rooms[unseen[0]].kind != "corridor")
        elif earlier:
            walker.go(earlier[int(rng.integers(min(4, len(earlier))))], visits=False)
            return_at = walker.travelled + float(rng.uniform(*RETURN_AFTER_M))
        else:
            walker.go(affordable[0], visits=False)
    walker.go(end, visits=False)
    walker.return_to_corner()
    return walker.points


def _round_trip(
    museum: Museum, rng: np.random.Generator, rooms: Sequence[int], start: int
) -> list[int]:
    """Return some of the rooms in the order of a round trip about their common centre."""
    chosen = rng.choice(rooms, round(SHARE_VISITED * len(rooms)), replace=False).tolist()
    x, y = np.mean([museum.rooms[room].centre for room in rooms], axis=0).tolist()
    turn = 1.0 if rng.random() < 0.5 else -1.0

    def bearing(room: int) -> float:
        centre = museum.rooms[room].centre
        return turn * math.atan2(centre[1] - y, centre[0] - x)

    first = bearing(start)
    return sorted(chosen, key=lambda room: (bearing(room) - first) % math.tau)
