# SPDX-License-Identifier: Apache-2.0
"""A simulated yard of some 100 m: buildings, walls, trees and lamp posts under the open sky.

::

    .   |   .    o  |   .
     ###|  #####    | ###  .
     ###| o#####    | ###
    ----+-----------+------
      o |  ##   .   |  ##
     ## |  ##   o   |####  .
"""

from __future__ import annotations

import math

import numpy as np

from cartoloop.arrays import FloatArray
from cartoloop.simulation.floor_plan import Box, FloorPlan, Point, World
from cartoloop.simulation.furniture import Furniture
from cartoloop.simulation.lidar import Lidar

COLUMNS, ROWS = 3, 3
"""Buildings along x and along y."""

LOT = 34.0
"""From the middle of one building to that of the next [m]."""

SIZES = (10.0, 20.0)
"""Lengths and widths of buildings [m]."""

LARGEST_SLANT = math.radians(12.0)
"""Largest angle between a building and the yard [rad]."""

NUM_TREES = 70
"""Trees and lamp posts, as far as there is room for them."""

NUM_WALLS = 14
"""Garden walls and fences, as far as there is room for them."""

OUTDOOR_LIDAR = Lidar(range_max=50.0, range_noise=0.02, range_quantum=0.01)
"""A SICK-like scanner as it is used outdoors: 361 beams over 180 degrees, 5 Hz, 50 m."""


def yard(seed: int = 0) -> World:
    """Return a yard of nine buildings and a route of some 600 m along the lanes between them.

    Parameters
    ----------
    seed : of the buildings, walls and trees, and of the route.
    """
    rng = np.random.default_rng(seed)
    plan = FloorPlan()
    route = np.array(_route(rng))
    things = Furniture(plan, route)
    for column in range(COLUMNS):
        for row in range(ROWS):
            _building(plan, things, rng, ((column + 0.5) * LOT, (row + 0.5) * LOT))
    bounds = (-8.0, -8.0, COLUMNS * LOT + 8.0, ROWS * LOT + 8.0)
    for _ in range(NUM_WALLS):
        _garden_wall(things, rng, bounds)
    for _ in range(NUM_TREES):
        _tree(plan, things, rng, bounds)
    return World("yard", plan.segments(), route, lidar=OUTDOOR_LIDAR)


def _building(plan: FloorPlan, things: Furniture, rng: np.random.Generator, middle: Point) -> None:
    """Add a building with a porch or a niche, more or less along the lanes."""
    half_x, half_y = (float(size) / 2 for size in rng.uniform(*SIZES, 2))
    slant = float(rng.uniform(-LARGEST_SLANT, LARGEST_SLANT)) if rng.random() < 0.4 else 0.0
    centre = np.array(middle) + rng.uniform(-1.5, 1.5, 2)
    corners = np.array([(-half_x, -half_y), (half_x, -half_y), (half_x, half_y),
                        (-half_x, half_y)])  # fmt: skip
    begin, end = sorted(rng.uniform(0.15, 0.85, 2))
    depth = float(rng.uniform(0.8, 3.0)) * float(rng.choice((-1.0, 0.6)))
    side = int(rng.integers(4))
    start, along = corners[side], corners[(side + 1) % 4] - corners[side]
    outwards = np.array((along[1], -along[0])) / math.hypot(*along)
    porch = [start + share * along + out * depth * outwards
             for share, out in ((begin, 0.0), (begin, 1.0), (end, 1.0), (end, 0.0))]  # fmt: skip
    outline = np.vstack((corners[: side + 1], porch, corners[side + 1 :]))
    cos, sin = math.cos(slant), math.sin(slant)
    turned: FloatArray = outline @ np.array(((cos, sin), (-sin, cos))) + centre
    plan.polygon([(float(x), float(y)) for x, y in turned])
    low, high = turned.min(axis=0), turned.max(axis=0)
    things.reserve((float(low[0]), float(low[1]), float(high[0]), float(high[1])))


def _garden_wall(things: Furniture, rng: np.random.Generator, bounds: Box) -> None:
    """Add a straight wall where there is room."""
    for _ in range(10):
        long, thick = float(rng.uniform(3.0, 9.0)), float(rng.uniform(0.1, 0.3))
        wide, deep = (long, thick) if rng.random() < 0.5 else (thick, long)
        x = float(rng.uniform(bounds[0], bounds[2] - wide))
        y = float(rng.uniform(bounds[1], bounds[3] - deep))
        if things.place((x, y, x + wide, y + deep), clearance=1.5, gap=1.0):
            return


def _tree(plan: FloorPlan, things: Furniture, rng: np.random.Generator, bounds: Box) -> None:
    """Add a trunk or a post where there is room."""
    radius = float(rng.choice((0.06, 0.15, 0.25))) * float(rng.uniform(0.8, 1.2))
    x = float(rng.uniform(bounds[0], bounds[2]))
    y = float(rng.uniform(bounds[1], bounds[3]))
    around = (x - radius, y - radius, x + radius, y + radius)
    if things.place(around, clearance=1.2, gap=1.0, visible=False):
        plan.pillar((x, y), radius, num_sides=8)


def _route(rng: np.random.Generator) -> list[Point]:
    """Return a route along the lanes: round the whole, then through the middle, and round again."""

    def lane(column: int, row: int) -> Point:
        aside = rng.uniform(-1.5, 1.5, 2)
        return (column * LOT + float(aside[0]), row * LOT + float(aside[1]))

    corners = [
        (0, 0), (1, 0), (2, 0), (3, 0), (3, 1), (2, 1), (2, 2), (3, 2), (3, 3), (2, 3), (1, 3),
        (1, 2), (1, 1), (0, 1), (0, 0), (1, 0), (1, 1), (2, 1), (2, 2), (1, 2), (0, 2), (0, 1),
    ]  # fmt: skip
    flip_x, flip_y, swap = (rng.random(3) < 0.5).tolist()
    route = []
    for column, row in corners:
        x, y = (COLUMNS - column if flip_x else column), (ROWS - row if flip_y else row)
        route.append(lane(*((y, x) if swap else (x, y))))
    return route
