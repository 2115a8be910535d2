# SPDX-License-Identifier: Apache-2.0
"""A simulated museum in the class of the paper's section VI-A, and larger and longer ones.

One floor of about 22,000 m^2 with about a hundred rooms, through which a person carries a scanner
for 2,250 m. To see how a mapper grows, either the building grows with the path (`large_museum`) or
the same floor is walked again and again (`museum_again`).
"""

from __future__ import annotations

import numpy as np

from cartoloop.errors import ConfigError
from cartoloop.simulation.floor_plan import FloorPlan, Point, World
from cartoloop.simulation.lidar import LIDARS
from cartoloop.simulation.motion import Pace
from cartoloop.simulation.museum_exhibits import furnish_museum_room
from cartoloop.simulation.museum_floor import (
    FLOOR_WIDTH,
    PASSAGE_LENGTH,
    MuseumRoom,
    museum_rooms,
    passage,
)
from cartoloop.simulation.museum_route import Museum, walk
from cartoloop.simulation.museum_walls import Door, build_walls, museum_doors, passage_doors

WALK_LENGTH = 2330.0
"""A walk through one floor from corner to corner [m]: cut short at these, it is of 2,250 m, as in
the paper's section VI-A."""

WALKING = Pace(speed=1.27, turn_rate=1.3, acceleration=1.0, corner_radius=0.9)

# What is drawn from each stream of random numbers: the building does not depend on the walks.
_BUILDING, _WALKS = 0, 1


def museum(seed: int = 0) -> World:
    """Return a museum floor of about 22,000 m^2 and a walk of 2,250 m with many loops.

    Parameters
    ----------
    seed : another seed gives other rooms, doors, exhibits and another walk.
    """
    return _world("museum", seed, num_floors=1, num_walks=1)


def large_museum(seed: int = 0, wings: int = 10) -> World:
    """Return a museum and a walk that are `wings` times as large and as long.

    Parameters
    ----------
    seed : see :func:`museum`.
    wings : how many floors like the museum's, all different, stand in a row, joined by passages.

    Raises
    ------
    ConfigError
        When there is no wing.
    """
    return _world("large-museum", seed, num_floors=wings, num_walks=1)


def museum_again(seed: int = 0, walks: int = 10) -> World:
    """Return the museum and a walk `walks` times as long: the area stays, the path grows.

    Parameters
    ----------
    seed : see :func:`museum`; building and first walk are the same.
    walks : how many different walks of 2,250 m, one after another.

    Raises
    ------
    ConfigError
        When there is no walk.
    """
    return _world("museum-again", seed, num_floors=1, num_walks=walks)


def _world(name: str, seed: int, num_floors: int, num_walks: int) -> World:
    """Return floors in a row, each with the same number of walks."""
    if min(num_floors, num_walks) < 1:
        raise ConfigError("a simulated museum needs at least one wing and one walk: check both")
    streams = [np.random.default_rng((seed, floor, _BUILDING)) for floor in range(num_floors)]
    rooms: list[MuseumRoom] = []
    doors: list[Door] = []
    floors: list[range] = []
    for floor, rng in enumerate(streams):
        offset = floor * (FLOOR_WIDTH + PASSAGE_LENGTH)
        own = museum_rooms(rng, offset)
        first = len(rooms)
        doors += [
            Door((one + first, other + first), door.place, door.axis, door.width)
            for door in museum_doors(rng, own)
            for one, other in [door.rooms]
        ]
        if floor + 1 < num_floors:
            own.append(passage(offset))
        rooms += own
        floors.append(range(first, len(rooms)))
    doors += passage_doors(rooms)

    pieces = []
    for own_rooms, rng in zip(floors, streams, strict=True):
        plan = FloorPlan()
        build_walls(plan, rooms, doors, own_rooms)
        row_seed = int(rng.integers(2**32))
        for room in own_rooms:
            own_doors = [door for door in doors if room in door.rooms]
            furnish_museum_room(plan, rng, rooms[room], own_doors, row_seed)
        pieces.append(plan.segments())
    return World(
        name=name,
        walls=np.vstack(pieces),
        route=np.array(_route(seed, rooms, doors, floors, num_walks)),
        pace=WALKING,
        lidar=LIDARS["backpack"],
        has_odometry=False,
    )


def _route(
    seed: int, rooms: list[MuseumRoom], doors: list[Door], floors: list[range], num_walks: int
) -> list[Point]:
    """Return the walks through all floors, from the entrance of the first."""
    museum = Museum(rooms, doors)
    route: list[Point] = []
    for floor, own in enumerate(floors):
        entrance = next(room for room in own if rooms[room].kind == "entrance")
        start = own[0] - 1 if floor else entrance  # the passage from the floor before
        end = own[-1] if floor + 1 < len(floors) else entrance
        for number in range(num_walks):
            rng = np.random.default_rng((seed, floor, _WALKS, number))
            steps = walk(museum, rng, own, start, end, WALK_LENGTH)
            route += steps[1:] if route else steps  # each begins where the one before ends
    return route
