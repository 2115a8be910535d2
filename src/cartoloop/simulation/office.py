# SPDX-License-Identifier: Apache-2.0
"""A simulated office floor of 50 m x 30 m: looping corridors, a hall, a lobby, some 25 rooms."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cartoloop.arrays import FloatArray
from cartoloop.simulation.floor_plan import (
    OUTER_WALL_THICKNESS,
    FloorPlan,
    Opening,
    Point,
    Room,
    World,
    row_of_rooms,
    uneven_split,
)
from cartoloop.simulation.furniture import Furniture, furnish_corridor, furnish_room, inside
from cartoloop.simulation.later_drive import Stop, close_doors, rearrange, vary_route

# The middle lines of the walls along the corridors [m]: S, N run along x; W, M, E along y.
SOUTH = (6.5, 8.5)
NORTH = (21.2, 23.2)
WEST = (7.0, 9.0)
MIDDLE = (27.0, 29.2)
EAST = (43.0, 45.0)
CORRIDOR_WALLS: tuple[tuple[Point, Point], ...] = (
    ((9.0, SOUTH[0]), (35.0, SOUTH[0])),
    ((9.0, SOUTH[1]), (27.0, SOUTH[1])),
    ((29.2, SOUTH[1]), (43.0, SOUTH[1])),
    ((9.0, NORTH[0]), (27.0, NORTH[0])),
    ((29.2, NORTH[0]), (43.0, NORTH[0])),
    ((7.0, NORTH[1]), (45.0, NORTH[1])),
    ((WEST[0], 8.0), (WEST[0], 21.0)),
    ((WEST[1], 9.0), (WEST[1], 21.0)),
    ((MIDDLE[0], 9.0), (MIDDLE[0], 21.0)),
    ((MIDDLE[1], 9.0), (MIDDLE[1], 21.0)),
    ((EAST[0], 9.0), (EAST[0], 21.0)),
    ((EAST[1], 8.0), (EAST[1], 22.0)),
)
LOBBY_X = 35.0
OUTLINE: tuple[Point, ...] = (
    (0.0, 0.0), (42.0, 0.0), (50.0, 6.5), (50.0, 30.0), (12.0, 30.0), (12.0, 27.5), (0.0, 27.5),
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class _Rooms:
    """The rooms of the floor by where they are."""

    south: list[Room]
    north_west: list[Room]
    north: list[Room]
    west: list[Room]
    east: list[Room]
    core_south: list[Room]
    core_north: list[Room]
    passage: Point  # the door between core_south[0] and core_north[0]
    hall: Room
    hall_exit: Point

    def all(self) -> list[Room]:
        """Return every room but the hall."""
        outer = [*self.south, *self.north_west, *self.north, *self.west, *self.east]
        return [*outer, *self.core_south, *self.core_north]

    def not_visited(self) -> list[Room]:
        """Return every other room of each row: no route leads there, and some are closed."""
        rows = (self.south, self.north, self.west, self.east, self.core_south, self.core_north)
        return [room for row in rows for room in row[1::2]]


def office(seed: int = 0, drive: int = 1) -> World:
    """Return an office floor and a route of some 320 m that closes several loops.

    Parameters
    ----------
    seed : another seed gives other rooms, doors and furniture between the same corridors.
    drive : 1 or more: from drive to drive a part of the furniture is moved, removed or brought
        back; doors of rooms that are not visited are open or closed, and the route begins
        elsewhere, may run in the other direction, and leaves out some rooms.
    """
    rng = np.random.default_rng(seed)
    plan = FloorPlan()
    _outer_walls(plan)
    rooms = _rooms(plan, rng)
    stops = _stops(rng, rooms)
    route = _joined(stops)
    furniture = Furniture(plan, route)
    for room in rooms.all():
        furniture.keep_door_clear(room)
    for begin, end in CORRIDOR_WALLS:
        furnish_corridor(furniture, rng, begin, end)
    _lobby(plan, furniture)
    _hall(plan, rng, furniture, rooms.hall)
    for room in rooms.all():
        furnish_room(furniture, rng, room)
    if drive > 1:
        route = _joined(vary_route(stops, seed, drive))
        furniture.keep_clear(route)
        close_doors(plan, rooms.not_visited(), seed, drive)
        rearrange(furniture, seed, drive)
    return World(
        name="office",
        walls=plan.segments(),
        route=route,
        drive=drive,
        furniture=furniture.segments(),
    )


def _outer_walls(plan: FloorPlan) -> None:
    """Add the walls around the building; the one at the lobby is slanted."""
    for start, end in zip(OUTLINE, [*OUTLINE[1:], OUTLINE[0]], strict=True):
        if start[0] == end[0] or start[1] == end[1]:
            plan.wall(start, end, thickness=OUTER_WALL_THICKNESS)
        else:
            along = np.subtract(end, start) / np.hypot(*np.subtract(end, start))
            aside = np.array((-along[1], along[0])) * OUTER_WALL_THICKNESS / 2
            for side in (aside, -aside):
                x1, y1 = np.add(start, side)
                x2, y2 = np.add(end, side)
                plan.lines.append((float(x1), float(y1), float(x2), float(y2)))


def _rooms(plan: FloorPlan, rng: np.random.Generator) -> _Rooms:
    """Add all inner walls with their doors."""
    right, up, left, down = (1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0)
    south = row_of_rooms(
        plan, rng, (0.0, SOUTH[0]), right, down,
        [9.6, *uneven_split(rng, LOBBY_X - 9.6, 3.4, 7.0)], SOUTH[0], (7.6, 34.0),
    )  # fmt: skip
    plan.wall((LOBBY_X, 0.0), (LOBBY_X, SOUTH[0]))
    north_west = row_of_rooms(
        plan, rng, (0.0, NORTH[1]), right, up, [12.0], 27.5 - NORTH[1], (8.0, 11.0)
    )  # fmt: skip
    plan.wall((12.0, NORTH[1]), (12.0, 27.5))
    north = row_of_rooms(
        plan, rng, (12.0, NORTH[1]), right, up,
        [*uneven_split(rng, 30.2, 3.4, 8.0), 7.8], 30.0 - NORTH[1], (0.0, 32.3),
    )  # fmt: skip
    height = NORTH[1] - SOUTH[0]
    west = row_of_rooms(
        plan, rng, (WEST[0], SOUTH[0]), up, left, uneven_split(rng, height, 3.5, 6.5), 7.0,
        (0.5, height - 0.5),
    )  # fmt: skip
    plan.wall((0.0, SOUTH[0]), (1.0, SOUTH[0]))
    east = row_of_rooms(
        plan, rng, (EAST[1], SOUTH[0]), up, right, uneven_split(rng, height, 3.2, 6.0), 5.0,
        (0.5, height - 0.5),
    )  # fmt: skip
    plan.wall((EAST[1], SOUTH[0]), (50.0, SOUTH[0]))

    divide = float(rng.uniform(14.2, 15.4))
    width = MIDDLE[0] - WEST[1]
    core_south = row_of_rooms(
        plan, rng, (WEST[1], SOUTH[1]), right, up, uneven_split(rng, width, 4.0, 7.5),
        divide - SOUTH[1], (0.0, width),
    )  # fmt: skip
    core_north = row_of_rooms(
        plan, rng, (WEST[1], NORTH[0]), right, down, uneven_split(rng, width, 3.6, 6.4),
        NORTH[0] - divide, (0.0, width),
    )  # fmt: skip
    passage = min(core_south[0].width, core_north[0].width) * float(rng.uniform(0.4, 0.6))
    plan.wall((WEST[1], divide), (MIDDLE[0], divide), [Opening(passage, 0.96)])
    plan.wall((WEST[1], SOUTH[1]), (WEST[1], NORTH[0]))
    plan.wall((MIDDLE[0], SOUTH[1]), (MIDDLE[0], NORTH[0]))

    entrance, exit_at = float(rng.uniform(3.0, 6.0)), float(rng.uniform(3.5, 6.0))
    plan.wall((MIDDLE[1], SOUTH[1]), (EAST[0], SOUTH[1]))
    plan.wall((MIDDLE[1], NORTH[0]), (EAST[0], NORTH[0]), [Opening(3.4, 0.95)])
    plan.wall((MIDDLE[1], SOUTH[1]), (MIDDLE[1], NORTH[0]), [Opening(entrance, 1.8)])
    plan.wall((EAST[0], SOUTH[1]), (EAST[0], NORTH[0]), [Opening(exit_at, 1.8)])
    hall = Room(
        (MIDDLE[1], SOUTH[1]), up, right, NORTH[0] - SOUTH[1], EAST[0] - MIDDLE[1],
        Opening(entrance, 1.8),
    )  # fmt: skip
    return _Rooms(
        south, north_west, north, west, east, core_south, core_north,
        passage=(WEST[1] + passage, divide), hall=hall, hall_exit=(EAST[0], SOUTH[1] + exit_at),
    )  # fmt: skip


def _lobby(plan: FloorPlan, furniture: Furniture) -> None:
    """Add the entrance at the south-east: pillars, a reception desk, seats at the slanted wall."""
    for x in (38.2, 41.6):
        plan.pillar((x, SOUTH[0] - 0.3), 0.28, num_sides=12)
    plan.polygon([(36.0, 1.6), (37.0, 0.8), (38.6, 0.8), (38.6, 1.4), (37.3, 1.4), (36.4, 2.1)])
    for x, y in ((43.6, 2.2), (45.0, 3.4), (46.4, 4.5)):
        plan.pillar((x, y), 0.35, num_sides=6)
    furniture.place((35.1, 4.2, 35.5, 5.8))


def _hall(plan: FloorPlan, rng: np.random.Generator, furniture: Furniture, hall: Room) -> None:
    """Add the open-plan hall's pillars, islands of desks, a slanted booth and a corner room."""
    plan.wall((38.4, 17.4), (38.4, NORTH[0]), [Opening(2.2, 0.95)])
    plan.wall((38.4, 17.4), (EAST[0], 17.4))
    plan.box((40.0, 18.6), (40.7, 20.6))
    plan.box((41.6, 18.6), (42.3, 20.6))
    furniture.reserve((37.4, 16.8, EAST[0], NORTH[0]))
    for u in (4.1, 8.4):
        for v in (3.6, 7.2, 10.8):
            if v < 9.0 or u < 8.0:  # not in the corner room
                x, y = hall.point(u, v)
                furniture.place((x - 0.2, y - 0.2, x + 0.2, y + 0.2), clearance=0.4)
    booth = np.array([(-1.2, -0.9), (1.2, -0.9), (1.2, 0.9), (-1.2, 0.9)])
    turn = float(rng.uniform(0.3, 0.5))
    cos, sin = np.cos(turn), np.sin(turn)
    x, y = hall.point(10.6, 5.2)
    if furniture.place((x - 1.5, y - 1.3, x + 1.5, y + 1.3), clearance=0.3, visible=False):
        plan.polygon(
            [(x + cos * bx - sin * by, y + sin * bx + cos * by) for bx, by in booth.tolist()]
        )
    for _ in range(200):
        length, depth = rng.uniform(1.4, 3.0), rng.uniform(0.7, 1.5)
        if rng.random() < 0.5:
            length, depth = depth, length
        u = rng.uniform(0.7, hall.width - 0.7 - length)
        v = rng.uniform(0.7, hall.depth - 0.7 - depth)
        island = hall.bounds(u, v, u + length, v + depth)
        furniture.place(island, clearance=0.55, gap=0.6, area=inside(hall))


def _joined(stops: list[Stop]) -> FloatArray:
    """Return the corners of a route, shape (k, 2) [m]."""
    return np.array([place for stop in stops for place in stop.path])


def _stops(rng: np.random.Generator, rooms: _Rooms) -> list[Stop]:
    """Return the route of the robot: lobby, west loop, east loop, hall, through the core, lobby."""

    def crossing(along_y: Point, along_x: Point) -> Stop:
        """Return a place near the middle of where two corridors cross: nobody drives on rails."""
        aside = rng.uniform(-0.15, 0.15, 2)
        return Stop.at(sum(along_y) / 2 + float(aside[0]), sum(along_x) / 2 + float(aside[1]))

    def into(room: Room, *spots: Point) -> Stop:
        """Return a visit to spots given as shares of the room's width and depth."""
        path = room.visit(*((u * room.width, v * room.depth) for u, v in spots))
        return Stop(tuple(path), may_be_skipped=True)

    core_south, core_north = rooms.core_south[0], rooms.core_north[0]
    (passage_x, passage_y), (_, exit_y) = rooms.passage, rooms.hall_exit
    return [
        Stop.at(39.6, 2.6),
        Stop.at(40.0, 7.4),
        into(rooms.south[4], (0.5, 0.6)),
        into(rooms.south[2], (0.35, 0.6), (0.65, 0.55)),
        crossing(WEST, SOUTH),
        into(rooms.west[2], (0.5, 0.5)),
        crossing(WEST, NORTH),
        into(rooms.north_west[0], (0.7, 0.5), (0.35, 0.5)),
        crossing(MIDDLE, NORTH),
        crossing(MIDDLE, SOUTH),
        crossing(EAST, SOUTH),
        into(rooms.east[0], (0.5, 0.55)),
        crossing(EAST, NORTH),
        into(rooms.north[4], (0.4, 0.45), (0.6, 0.65)),
        crossing(MIDDLE, NORTH),
        Stop(
            (
                *(rooms.hall.point(rooms.hall.door.middle, v) for v in (-1.1, 0.0, 1.0)),
                rooms.hall.point(6.3, 3.0),
                rooms.hall.point(6.3, 9.0),
                *((x, exit_y) for x in (EAST[0] - 1.2, EAST[0], EAST[0] + 1.0)),
            )
        ),
        crossing(EAST, SOUTH),
        Stop(
            (
                *(core_south.point(core_south.door.middle, v) for v in (-1.0, 0.0, 1.4)),
                *((passage_x, passage_y + aside) for aside in (-1.0, 0.0, 1.0)),
                *(core_north.point(core_north.door.middle, v) for v in (1.4, 0.0, -1.0)),
            )
        ),
        crossing(MIDDLE, NORTH),
        crossing(MIDDLE, SOUTH),
        Stop.at(39.8, 7.6),
        Stop.at(39.4, 3.0),
    ]
