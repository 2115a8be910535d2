# SPDX-License-Identifier: Apache-2.0
"""A simulated building of two wings that look alike, joined by a corridor that does not.

::

    +---------+                    +---------+
    | +-----+ |                    | +-----+ |
    | |     | |                    | |     | |
    | +-----+ |                    | +-----+ |
    +---+ +---+                    +---+ +---+
        | |                            | |
    +---+ +----------------------------+ +---+
    |                                        |
    +----------------------------------------+

The wings are the same to the last millimetre. They are two places: a map that joins them is wrong.
"""

from __future__ import annotations

import numpy as np

from cartoloop.simulation.corridors import featured_wall
from cartoloop.simulation.floor_plan import FloorPlan, Opening, Point, World

CORRIDOR_WIDTH = 2.2
"""Width of all corridors [m]."""

WING_LENGTHS, WING_WIDTHS = (16.0, 24.0), (12.0, 18.0)
"""Outer sizes of the ring of corridors in a wing, along x and y [m]."""

ENTRANCE_LENGTHS = (4.0, 8.0)
"""From the joining corridor to a wing [m]."""

DISTANCES = (30.0, 55.0)
"""From one wing to the other, along the joining corridor [m]."""

END = 5.0
"""How far the joining corridor goes on beyond the entrances [m]."""

WANDERING_M = 0.15
"""Largest deviation of the robot from the middle line of a corridor [m]."""


def wings(seed: int = 0) -> World:
    """Return two wings that look alike, and a route of some 300 m through both.

    The robot goes round in the first wing, goes to the second and round in it, and, for every
    second seed, back into the first.

    Parameters
    ----------
    seed : of the sizes, of the doors, alcoves and boxes, and of the route.
    """
    rng = np.random.default_rng(seed)
    length, width = float(rng.uniform(*WING_LENGTHS)), float(rng.uniform(*WING_WIDTHS))
    entrance = float(rng.uniform(*ENTRANCE_LENGTHS))
    shift = length + float(rng.uniform(*DISTANCES))
    door = float(rng.uniform(0.35, 0.65)) * length  # along the wing's south wall

    wing = _wing(rng, length, width, entrance, door).segments()
    joining = _joining_corridor(rng, door, shift).segments()
    walls = np.vstack((wing, wing + np.array((shift, 0.0, shift, 0.0)), joining))

    rounds = [_round(rng, length, width, entrance, door) for _ in range(3)]
    route = [*rounds[0], *((x + shift, y) for x, y in rounds[1])]
    if rng.random() < 0.5:
        route += rounds[2]
    # It sets off inside the wing or in the joining corridor, from where its back is turned to it.
    route = route[2:] if rng.random() < 0.5 else route
    return World("wings", walls, np.array(route))


def _wing(
    rng: np.random.Generator, length: float, width: float, entrance: float, door: float
) -> FloorPlan:
    """Return the walls of the western wing: a ring of corridors, and the way in from the south."""
    plan = FloorPlan()
    south, north = entrance, entrance + width
    west, east = 0.0, length
    half = CORRIDOR_WIDTH / 2
    featured_wall(plan, rng, (west, south), (door - half, south), (0.0, -1.0))
    featured_wall(plan, rng, (door + half, south), (east, south), (0.0, -1.0))
    featured_wall(plan, rng, (west, north), (east, north), (0.0, 1.0))
    featured_wall(plan, rng, (west, south), (west, north), (-1.0, 0.0))
    featured_wall(plan, rng, (east, south), (east, north), (1.0, 0.0))
    low_x, high_x = west + CORRIDOR_WIDTH, east - CORRIDOR_WIDTH
    low_y, high_y = south + CORRIDOR_WIDTH, north - CORRIDOR_WIDTH
    featured_wall(plan, rng, (low_x, low_y), (high_x, low_y), (0.0, 1.0))
    featured_wall(plan, rng, (low_x, high_y), (high_x, high_y), (0.0, -1.0))
    featured_wall(plan, rng, (low_x, low_y), (low_x, high_y), (1.0, 0.0))
    featured_wall(plan, rng, (high_x, low_y), (high_x, high_y), (-1.0, 0.0))
    for x in (door - half, door + half):
        plan.wall((x, 0.0), (x, south))
    return plan


def _joining_corridor(rng: np.random.Generator, door: float, shift: float) -> FloorPlan:
    """Return the walls of the corridor along x that both wings open to, just south of y = 0."""
    plan = FloorPlan()
    begin, end = door - END, door + shift + END
    openings = [Opening(at - begin, CORRIDOR_WIDTH) for at in (door, door + shift)]
    between = (door + CORRIDOR_WIDTH / 2, door + shift - CORRIDOR_WIDTH / 2)
    plan.wall((begin, 0.0), (between[0], 0.0), [openings[0]])
    featured_wall(plan, rng, (between[0], 0.0), (between[1], 0.0), (0.0, 1.0))
    plan.wall((between[1], 0.0), (end, 0.0), [Opening(CORRIDOR_WIDTH / 2, CORRIDOR_WIDTH)])
    featured_wall(plan, rng, (begin, -CORRIDOR_WIDTH), (end, -CORRIDOR_WIDTH), (0.0, -1.0))
    for x in (begin, end):
        plan.wall((x, -CORRIDOR_WIDTH), (x, 0.0))
    return plan


def _round(
    rng: np.random.Generator, length: float, width: float, entrance: float, door: float
) -> list[Point]:
    """Return the way from the joining corridor through the western wing and back."""

    def near(x: float, y: float) -> Point:
        aside = rng.uniform(-WANDERING_M, WANDERING_M, 2)
        return (x + float(aside[0]), y + float(aside[1]))

    half = CORRIDOR_WIDTH / 2
    west, east = half, length - half
    south, north = entrance + half, entrance + width - half
    corners = [(west, south), (west, north), (east, north), (east, south)]
    if rng.random() < 0.5:
        corners.reverse()
    laps = corners * (2 if rng.random() < 0.3 else 1)
    way_in = [(door, -half), (door, south)]
    return [near(*place) for place in (*way_in, *laps, *way_in[::-1])]
