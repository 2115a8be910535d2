# SPDX-License-Identifier: Apache-2.0
"""A simulated campus: long corridors that cross each other, driven along for two kilometres.

::

    +----------+------------------+-------+
    |          |                  |       |
    +----------+------------------+-------+
    |          |                  |       |
    |          |                  |       |
    +----------+------------------+-------+
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from cartoloop.simulation.corridors import featured_wall
from cartoloop.simulation.floor_plan import FloorPlan, Point, World

ROUTE_LENGTH = 2000.0
"""Path length after which the robot drives back to where it set off [m]."""

BLOCK_LENGTHS, BLOCK_WIDTHS = (45.0, 95.0), (30.0, 60.0)
"""Distances between corridors, along x and along y [m]."""

CORRIDOR_WIDTH = 2.6
"""Width of all corridors [m]."""

WANDERING_M = 0.3
"""Largest deviation from the middle of a crossing [m]."""

Crossing = tuple[int, int]


def campus(seed: int = 0) -> World:
    """Return 4 corridors that cross 3 others, and a route of somewhat more than two kilometres.

    Parameters
    ----------
    seed : of where the corridors are, of the doors, alcoves and boxes in them, and of the route.
    """
    rng = np.random.default_rng(seed)
    columns = np.concatenate(([0.0], np.cumsum(rng.uniform(*BLOCK_LENGTHS, 3)))).tolist()
    rows = np.concatenate(([0.0], np.cumsum(rng.uniform(*BLOCK_WIDTHS, 2)))).tolist()
    plan = FloorPlan()
    half = CORRIDOR_WIDTH / 2
    _walls_around(plan, rng, (-half, -half, columns[-1] + half, rows[-1] + half), 1.0)
    for west, east in pairwise(columns):
        for south, north in pairwise(rows):
            block = (west + half, south + half, east - half, north - half)
            _walls_around(plan, rng, block, -1.0)
    return World("campus", plan.segments(), np.array(_route(rng, columns, rows)))


def _walls_around(
    plan: FloorPlan,
    rng: np.random.Generator,
    bounds: tuple[float, float, float, float],
    outwards: float,
) -> None:
    """Add four walls; alcoves lie outside of them, or inside where `outwards` is -1."""
    west, south, east, north = bounds
    featured_wall(plan, rng, (west, south), (east, south), (0.0, -outwards))
    featured_wall(plan, rng, (west, north), (east, north), (0.0, outwards))
    featured_wall(plan, rng, (west, south), (west, north), (-outwards, 0.0))
    featured_wall(plan, rng, (east, south), (east, north), (outwards, 0.0))


def _route(
    rng: np.random.Generator, columns: Sequence[float], rows: Sequence[float]
) -> list[Point]:
    """Return a route from crossing to crossing, mostly where the robot has been least often."""
    visits: dict[frozenset[Crossing], int] = {}
    at: Crossing = (0, 0)
    before: Crossing | None = None
    crossings = [at]
    driven = 0.0
    while driven < ROUTE_LENGTH or at != crossings[0]:
        ahead = [place for place in _neighbours(at, columns, rows) if place != before]
        if driven < ROUTE_LENGTH:
            worth = [visits.get(frozenset((at, place)), 0) + 0.9 * rng.random() for place in ahead]
        else:
            worth = [float(sum(place)) for place in ahead]  # home: the crossing (0, 0)
        goal = ahead[int(np.argmin(worth))]
        corridor = frozenset((at, goal))
        visits[corridor] = visits.get(corridor, 0) + 1
        driven += math.dist((columns[at[0]], rows[at[1]]), (columns[goal[0]], rows[goal[1]]))
        before, at = at, goal
        crossings.append(at)
    asides = rng.uniform(-WANDERING_M, WANDERING_M, (len(crossings), 2))
    places = np.array([(columns[column], rows[row]) for column, row in crossings]) + asides
    return [(float(x), float(y)) for x, y in places]


def _neighbours(
    crossing: Crossing, columns: Sequence[float], rows: Sequence[float]
) -> list[Crossing]:
    """Return the crossings at the other ends of the corridors from one."""
    column, row = crossing
    around = ((column + 1, row), (column - 1, row), (column, row + 1), (column, row - 1))
    return [(x, y) for x, y in around if 0 <= x < len(columns) and 0 <= y < len(rows)]
