# SPDX-License-Identifier: Apache-2.0
"""The doors between the rooms of a simulated museum, and the walls around them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from cartoloop.simulation.floor_plan import FloorPlan, Opening, Point
from cartoloop.simulation.museum_floor import MuseumRoom

INNER_WALL = 0.35
OUTER_WALL = 0.7
DOOR_MARGIN = 0.9  # from a door to the corner of a room [m]
NARROWEST_WALL = 3.3  # that may have a door [m]
SHARE_OF_DOORS = 0.45  # of the neighbours that are not joined otherwise


@dataclass(frozen=True, slots=True)
class Door:
    """An opening between two rooms, in the middle of their wall.

    Attributes
    ----------
    rooms : the rooms it joins, by index.
    place : its middle [m], map frame.
    axis : 0 if one walks through it along x, 1 if along y.
    width : of the opening [m].
    """

    rooms: tuple[int, int]
    place: Point
    axis: int
    width: float


@dataclass(frozen=True, slots=True)
class _Side:
    """A stretch of wall that two rooms share: across `axis`, at `at`, from `begin` to `end` [m]."""

    rooms: tuple[int, int]
    axis: int
    at: float
    begin: float
    end: float


def museum_doors(rng: np.random.Generator, rooms: Sequence[MuseumRoom]) -> list[Door]:
    """Return doors by which every room can be reached, and more, so that there are loops.

    Stairwells and cabinets get one each, from the largest room beside them; corridors and halls
    open to most of what lies along them.
    """
    sides = [side for side in _shared_sides(rooms) if side.end - side.begin > NARROWEST_WALL]
    wanted = np.array([_wish(rng, rooms, side) for side in sides])
    joined = list(range(len(rooms)))  # a room's representative among those it can be reached from

    def representative(room: int) -> int:
        while joined[room] != room:
            room = joined[room]
        return room

    doors: list[Door] = []
    closed = {number: False for number, room in enumerate(rooms) if room.kind == "stairs"}
    for choice in np.argsort(-wanted, kind="stable").tolist():
        side = sides[choice]
        if any(closed.get(room, False) for room in side.rooms):
            continue
        one, other = (representative(room) for room in side.rooms)
        if one == other and wanted[choice] < 1.0 - SHARE_OF_DOORS:
            continue
        joined[one] = other
        closed.update({room: True for room in side.rooms if room in closed})
        doors.append(_door(rng, rooms, side))
    return doors


def passage_doors(rooms: Sequence[MuseumRoom]) -> list[Door]:
    """Return the doors between passages and corridors."""
    return [
        Door(side.rooms, (side.at, (side.begin + side.end) / 2), side.axis, 2.4)
        for side in _shared_sides(rooms)
        if {rooms[room].kind for room in side.rooms} == {"passage", "corridor"}
    ]


def build_walls(
    plan: FloorPlan, rooms: Sequence[MuseumRoom], doors: Sequence[Door], own: range
) -> None:
    """Add the walls around the rooms `own`, with the doors in them.

    A wall that rooms of two floors share belongs to the first of them; walls that nobody shares
    are outer walls.
    """
    sides = _shared_sides(rooms)
    for side in sides:
        if min(side.rooms) in own:
            openings = [
                Opening(door.place[1 - door.axis] - side.begin, door.width)
                for door in doors
                if door.rooms == side.rooms
            ]
            _wall(plan, side.axis, side.at, side.begin, side.end, openings, INNER_WALL)
    for room in own:
        for axis, at, begin, end in _edges(rooms[room]):
            shared = sorted(
                (side.begin, side.end)
                for side in sides
                if room in side.rooms and side.axis == axis and abs(side.at - at) < 1e-6
            )
            done = begin
            for shared_begin, shared_end in [*shared, (end, end)]:
                if shared_begin - done > 1e-6:
                    _wall(plan, axis, at, done, shared_begin, [], OUTER_WALL)
                done = max(done, shared_end)


def _wish(rng: np.random.Generator, rooms: Sequence[MuseumRoom], side: _Side) -> float:
    """Return how much a door is wanted in a wall: above 1 there is one in any case."""
    kinds = {rooms[room].kind for room in side.rooms}
    chance = float(rng.uniform(0.0, 1.0))
    if kinds == {"corridor"}:
        return 2.0
    if kinds & {"corridor", "entrance"} and len(kinds) == 2:
        return 1.0 + chance if "stairs" not in kinds else 0.5 + chance
    if "hall" in kinds:
        return 0.6 + chance / 2
    if kinds == {"cabinet"}:
        return 0.4 * chance
    return chance


def _door(rng: np.random.Generator, rooms: Sequence[MuseumRoom], side: _Side) -> Door:
    """Return a door somewhere in a wall; those of look-alike rooms are alike."""
    kinds = {rooms[room].kind for room in side.rooms}
    widths = (2.2, 3.2) if kinds & {"hall", "entrance"} else (1.5, 2.2)
    width = float(rng.uniform(*widths))
    share = float(rng.uniform(0.0, 1.0))
    if "cabinet" in kinds:
        width, share = 1.8, 0.5
    width = min(width, side.end - side.begin - 2.0 * DOOR_MARGIN)
    margin = DOOR_MARGIN + width / 2
    along = side.begin + margin + share * (side.end - side.begin - 2.0 * margin)
    place = (side.at, along) if side.axis == 0 else (along, side.at)
    return Door(side.rooms, place, side.axis, width)


def _shared_sides(rooms: Sequence[MuseumRoom]) -> list[_Side]:
    """Return all stretches of wall between two rooms."""
    bounds = np.array([room.bounds for room in rooms])
    sides: list[_Side] = []
    for first, room in enumerate(rooms):
        for axis in (0, 1):
            begins = np.maximum(bounds[:, 1 - axis], room.bounds[1 - axis])
            ends = np.minimum(bounds[:, 3 - axis], room.bounds[3 - axis])
            touches = np.abs(bounds[:, axis] - room.bounds[2 + axis]) < 1e-6
            for other in np.flatnonzero(touches & (ends - begins > 1e-6)).tolist():
                pair = (min(first, other), max(first, other))
                at = room.bounds[2 + axis]
                sides.append(_Side(pair, axis, at, float(begins[other]), float(ends[other])))
    return sides


def _edges(room: MuseumRoom) -> Iterator[tuple[int, float, float, float]]:
    """Yield the four edges of a room: axis across, where on it, begin and end along it [m]."""
    for axis in (0, 1):
        for at in (room.bounds[axis], room.bounds[2 + axis]):
            yield axis, at, room.bounds[1 - axis], room.bounds[3 - axis]


def _wall(
    plan: FloorPlan,
    axis: int,
    at: float,
    begin: float,
    end: float,
    openings: list[Opening],
    thickness: float,
) -> None:
    """Add a wall across `axis`."""
    if axis == 0:
        plan.wall((at, begin), (at, end), openings, thickness)
    else:
        plan.wall((begin, at), (end, at), openings, thickness)
