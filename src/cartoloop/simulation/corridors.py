# SPDX-License-Identifier: Apache-2.0
"""Simulated corridors: a long one, one with bare walls, a ring of four, and their walls."""

from __future__ import annotations

import numpy as np

from cartoloop.simulation.floor_plan import FloorPlan, Opening, Point, World

BARE_STRETCH = 12.0
"""Length of bare walls where the robot sets off, and once more on its way [m]."""


def corridor(seed: int = 0, length: float = 80.0, width: float = 2.4) -> World:
    """Return a long corridor with few features, and a route from end to end and back.

    Parameters
    ----------
    seed : of the doors, alcoves and boxes.
    length, width : of the corridor [m].
    """
    rng = np.random.default_rng(seed)
    plan = FloorPlan()
    plan.wall((0.0, 0.0), (0.0, width))
    plan.wall((length, 0.0), (length, width))
    featured_wall(plan, rng, (0.0, 0.0), (length, 0.0), outwards=(0.0, -1.0))
    featured_wall(plan, rng, (0.0, width), (length, width), outwards=(0.0, 1.0))
    there, back = 0.45 * width, 0.55 * width
    route = [(1.5, there), (length - 1.5, there), (length - 1.5, back), (1.5, back)]
    return World("corridor", plan.segments(), np.array(route))


def bare(seed: int = 0, length: float = 90.0, width: float = 2.2) -> World:
    """Return a corridor whose walls are bare where the robot sets off, and a route to and fro.

    At first the robot sees nothing that would show its motion but, far ahead, where the bare
    walls end; on its way there is another such stretch.

    Parameters
    ----------
    seed : of the doors, alcoves and boxes, and of where the second stretch is.
    length, width : of the corridor [m].
    """
    rng = np.random.default_rng(seed)
    plan = FloorPlan()
    plan.wall((0.0, 0.0), (0.0, width))
    plan.wall((length, 0.0), (length, width))
    second = float(rng.uniform(45.0, length - BARE_STRETCH - 12.0))
    pieces = [(BARE_STRETCH, second), (second + BARE_STRETCH, length)]
    for y, outwards in ((0.0, (0.0, -1.0)), (width, (0.0, 1.0))):
        plan.wall((0.0, y), (BARE_STRETCH, y))
        plan.wall((second, y), (second + BARE_STRETCH, y))
        for begin, end in pieces:
            featured_wall(plan, rng, (begin, y), (end, y), outwards)
    there, back = 0.45 * width, 0.55 * width
    route = [(1.5, there), (length - 1.5, there), (length - 1.5, back), (1.5, back)]
    return World("bare", plan.segments(), np.array(route))


def ring(seed: int = 0, side: float = 24.0, width: float = 2.2) -> World:
    """Return four corridors in a square, and a route of two laps.

    Parameters
    ----------
    seed : of the doors, alcoves and boxes.
    side : outer length of the square [m].
    width : of the corridors [m].
    """
    rng = np.random.default_rng(seed)
    plan = FloorPlan()
    for inset, outwards in ((0.0, 1.0), (width, -1.0)):
        low, high = inset, side - inset
        featured_wall(plan, rng, (low, low), (high, low), (0.0, -outwards))
        featured_wall(plan, rng, (low, high), (high, high), (0.0, outwards))
        featured_wall(plan, rng, (low, low), (low, high), (-outwards, 0.0))
        featured_wall(plan, rng, (high, low), (high, high), (outwards, 0.0))
    near, far = width / 2, side - width / 2
    lap = [(near, near), (far, near), (far, far), (near, far)]
    route = [(side / 2, near), *lap[1:], *lap, lap[0], (side / 2, near)]
    return World("ring", plan.segments(), np.array(route))


def featured_wall(
    plan: FloorPlan, rng: np.random.Generator, start: Point, end: Point, outwards: Point
) -> None:
    """Add a corridor's wall with closed doors, alcoves and shallow cupboards every few metres."""
    length = abs(end[0] - start[0]) + abs(end[1] - start[1])
    ux, uy = (end[0] - start[0]) / length, (end[1] - start[1]) / length

    def place(along: float, out: float) -> Point:
        return (
            start[0] + along * ux + out * outwards[0],
            start[1] + along * uy + out * outwards[1],
        )

    openings: list[Opening] = []
    at = float(rng.uniform(1.5, 5.0))
    while at < length - 4.0:
        kind = rng.choice(["door", "door", "alcove", "cupboard"])
        if kind == "door":
            openings.append(Opening(at + 0.5, float(rng.uniform(0.9, 1.0)), closed=True))
        elif kind == "alcove":
            wide, deep = float(rng.uniform(1.2, 2.4)), float(rng.uniform(0.5, 1.2))
            openings.append(Opening(at + wide / 2, wide))
            plan.wall(place(at, 0.0), place(at, deep))
            plan.wall(place(at, deep), place(at + wide, deep))
            plan.wall(place(at + wide, 0.0), place(at + wide, deep))
        else:
            wide, deep = float(rng.uniform(0.5, 1.4)), float(rng.uniform(0.15, 0.3))
            plan.box(place(at, 0.0), place(at + wide, -deep))
        at += float(rng.uniform(4.0, 11.0))
    plan.wall(start, end, openings)
