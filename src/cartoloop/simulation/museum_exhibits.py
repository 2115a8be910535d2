# SPDX-License-Identifier: Apache-2.0
"""What stands in a simulated museum: show-cases, partitions, pillars, big exhibits, stairs.

Nothing stands in the aisles, so that visitors can walk them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from cartoloop.simulation.floor_plan import FloorPlan, Point
from cartoloop.simulation.furniture import Furniture
from cartoloop.simulation.museum_aisles import aisle, corners_of, spur
from cartoloop.simulation.museum_floor import MuseumRoom
from cartoloop.simulation.museum_walls import INNER_WALL, Door

CLEARANCE = 1.0  # from the middle line of the aisles [m]
WALL_FACE = INNER_WALL / 2


def furnish_museum_room(
    plan: FloorPlan,
    rng: np.random.Generator,
    room: MuseumRoom,
    doors: Sequence[Door],
    row_seed: int,
) -> None:
    """Put exhibits into a room.

    Parameters
    ----------
    plan : gets the exhibits.
    rng : of all that stands in this room alone.
    room : the room.
    doors : of this room, to be kept clear.
    row_seed : of what stands in the same place in each cabinet: it is this that makes them alike.
    """
    ring = corners_of(aisle(room), 1)
    furniture = Furniture(plan, np.array([*ring, ring[0]]))
    for door in doors:
        furniture.keep_clear(np.array(spur(room, door)))
    if room.kind == "stairs":
        _stairs(furniture, room)
    elif room.kind == "corridor":
        _wall_cases(furniture, rng, room, per_metre=0.4, deepest=0.6)
    elif room.kind == "cabinet":
        same = np.random.default_rng(row_seed)
        _show_cases(furniture, same, room, num=6)
        _wall_cases(furniture, same, room, per_metre=0.2, deepest=0.7)
        _wall_cases(furniture, rng, room, per_metre=0.04, deepest=0.5)
    elif room.kind in ("hall", "entrance", "passage"):
        for _ in range(int(room.area / 220.0)):
            _big_exhibit(furniture, rng, room)
        _pillars(furniture, room, spacing=float(rng.uniform(6.5, 8.5)), radius=0.4)
        _show_cases(furniture, rng, room, num=int(room.area / 45.0))
        _wall_cases(furniture, rng, room, per_metre=0.1, deepest=0.9)
    else:
        if room.area > 130.0 and rng.random() < 0.5:
            _pillars(furniture, room, spacing=float(rng.uniform(4.5, 6.0)), radius=0.28)
        for _ in range(int(rng.integers(0, 2 + int(room.area / 70.0)))):
            _partition(furniture, rng, room)
        _show_cases(furniture, rng, room, num=int(room.area / rng.uniform(9.0, 30.0)))
        _wall_cases(furniture, rng, room, per_metre=float(rng.uniform(0.1, 0.3)), deepest=0.8)


def _show_cases(furniture: Furniture, rng: np.random.Generator, room: MuseumRoom, num: int) -> None:
    """Put up to `num` glass cases anywhere in a room, each along or across it."""
    for _ in range(num):
        length, depth = float(rng.uniform(0.7, 2.4)), float(rng.uniform(0.6, 1.3))
        if rng.random() < 0.5:
            length, depth = depth, length
        x, y = _somewhere(rng, room, length, depth)
        furniture.place((x, y, x + length, y + depth), CLEARANCE, gap=0.8)


def _wall_cases(
    furniture: Furniture,
    rng: np.random.Generator,
    room: MuseumRoom,
    per_metre: float,
    deepest: float,
) -> None:
    """Put cases, benches and pilasters along the walls."""
    x_min, y_min, x_max, y_max = room.bounds
    for axis in (0, 1):
        begin, end = room.bounds[axis], room.bounds[2 + axis]
        for wall in (0, 1):
            for _ in range(math.ceil(per_metre * (end - begin))):
                size, depth = float(rng.uniform(0.4, 3.2)), float(rng.uniform(0.15, deepest))
                at = float(rng.uniform(begin + 0.3, max(begin + 0.4, end - 0.3 - size)))
                depth += WALL_FACE
                if axis == 0:
                    low = y_min if wall == 0 else y_max - depth
                    bounds = (at, low, at + size, low + depth)
                else:
                    low = x_min if wall == 0 else x_max - depth
                    bounds = (low, at, low + depth, at + size)
                furniture.place(bounds, clearance=CLEARANCE, gap=0.4)


def _pillars(furniture: Furniture, room: MuseumRoom, spacing: float, radius: float) -> None:
    """Put rows of pillars into a room, as evenly as builders do."""
    x_min, y_min, x_max, y_max = room.bounds
    num_x = max(2, round((x_max - x_min) / spacing))
    num_y = max(2, round((y_max - y_min) / spacing))
    for x in np.linspace(x_min, x_max, num_x + 1)[1:-1].tolist():
        for y in np.linspace(y_min, y_max, num_y + 1)[1:-1].tolist():
            around = (x - radius, y - radius, x + radius, y + radius)
            if furniture.place(around, CLEARANCE - 0.1, visible=False):
                furniture.plan.pillar((x, y), radius)


def _partition(furniture: Furniture, rng: np.random.Generator, room: MuseumRoom) -> None:
    """Put a free-standing wall into a room, some with a bend, some slanted."""
    length = float(rng.uniform(2.0, 5.0))
    turn = float(rng.choice([0.0, 0.25, 0.5, 0.75])) * math.pi
    if rng.random() < 0.3:
        turn += float(rng.uniform(-0.3, 0.3))
    outline = [(-0.5 * length, -0.09), (0.5 * length, -0.09), (0.5 * length, 0.09)]
    if rng.random() < 0.4:
        wing = float(rng.uniform(0.8, 1.8))
        outline += [(-0.5 * length + 0.18, 0.09), (-0.5 * length + 0.18, wing)]
        outline += [(-0.5 * length, wing)]
    else:
        outline += [(-0.5 * length, 0.09)]
    _turned(furniture, rng, room, outline, turn, gap=1.0)


def _big_exhibit(furniture: Furniture, rng: np.random.Generator, room: MuseumRoom) -> None:
    """Put something big into a hall: an aeroplane, a ship's hull or a machine."""
    size = float(rng.uniform(0.7, 1.3))
    kind = rng.choice(["aeroplane", "hull", "machine"])
    if kind == "aeroplane":
        outline = [
            (5.0, 0.0), (4.2, 0.6), (1.5, 0.7), (-0.2, 5.0), (-1.4, 5.0), (-0.8, 0.7), (-4.0, 0.4),
            (-4.6, 1.6), (-5.2, 1.6), (-5.0, 0.0),
        ]  # fmt: skip
        outline += [(x, -y) for x, y in outline[-2:0:-1]]
    elif kind == "hull":
        along = np.linspace(-1.0, 1.0, 9)
        upper = [(6.0 * x, 1.6 * (1.0 - x**4)) for x in along.tolist()]
        outline = upper + [(x, -y) for x, y in upper[-2:0:-1]]
    else:
        outline = [(-2.0, -1.2), (1.0, -1.2), (1.0, -0.6), (2.4, -0.6), (2.4, 0.9), (-2.0, 0.9)]
    scaled = [(size * x, size * y) for x, y in outline]
    _turned(furniture, rng, room, scaled, float(rng.uniform(-math.pi, math.pi)), gap=0.8)


def _turned(
    furniture: Furniture,
    rng: np.random.Generator,
    room: MuseumRoom,
    outline: Sequence[Point],
    turn: float,
    gap: float,
    num_tries: int = 12,
) -> None:
    """Put an outline into a room, turned by `turn` [rad], where there is space for it."""
    cos, sin = math.cos(turn), math.sin(turn)
    corners = [(cos * x - sin * y, sin * x + cos * y) for x, y in outline]
    x_low, y_low = (min(corner[axis] for corner in corners) for axis in (0, 1))
    x_high, y_high = (max(corner[axis] for corner in corners) for axis in (0, 1))
    width, depth = x_high - x_low, y_high - y_low
    if width > room.width - 1.5 or depth > room.depth - 1.5:
        return
    for _ in range(num_tries):
        x, y = _somewhere(rng, room, width, depth)
        if furniture.place((x, y, x + width, y + depth), CLEARANCE, gap, visible=False):
            furniture.plan.polygon([(x + dx - x_low, y + dy - y_low) for dx, dy in corners])
            return


def _stairs(furniture: Furniture, room: MuseumRoom) -> None:
    """Fill the far end of a stairwell with two flights and the wall between them."""
    x_min, y_min, x_max, y_max = room.bounds
    begin, end = y_min + 0.35 * room.depth, y_max - 1.6
    middle = (x_min + x_max) / 2
    furniture.place((middle - 0.12, begin, middle + 0.12, end), clearance=0.0)
    furniture.place((x_min, begin + 1.0, middle - 0.12, begin + 1.3), clearance=0.0)


def _somewhere(rng: np.random.Generator, room: MuseumRoom, width: float, depth: float) -> Point:
    """Return the lower corner of a box in a room, at least half a metre from the walls."""
    x_min, y_min, x_max, y_max = room.bounds
    x_high, y_high = max(x_min + 0.8, x_max - 0.7 - width), max(y_min + 0.8, y_max - 0.7 - depth)
    return float(rng.uniform(x_min + 0.7, x_high)), float(rng.uniform(y_min + 0.7, y_high))
