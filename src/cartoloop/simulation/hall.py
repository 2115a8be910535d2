# SPDX-License-Identifier: Apache-2.0
"""A simulated hall that is larger than the scanner reaches: in its middle nothing is seen.

::

    +----[]---------==-------+
    |  o   o   o   o   o   o |
    []          |            |
    |  o  ------+---------o  []
    |           |            |
    |  o   o   o   o   o   o |
    +------==-----------[]---+

The robot drives round it along the walls and a row of columns, crosses it twice, and drives along
two of the walls again.
"""

from __future__ import annotations

import numpy as np

from cartoloop.simulation.corridors import featured_wall
from cartoloop.simulation.floor_plan import FloorPlan, Point, World

LENGTHS, WIDTHS = (92.0, 100.0), (78.0, 84.0)
"""Sizes of the hall [m]: more than twice the 30 m that the scanner reaches."""

LANE = 6.0
"""Distance from the walls at which the robot drives round the hall [m]."""

COLUMN_ROW = 3.0
"""Distance of the row of columns from the walls [m]."""

COLUMN_SPACING = (6.0, 10.0)
"""From one column to the next [m]."""


def hall(seed: int = 0) -> World:
    """Return a hall and a route of some 600 m; on a sixth of it nothing is seen.

    Parameters
    ----------
    seed : of the size, of the doors, alcoves and boxes at the walls, of the columns and the route.
    """
    rng = np.random.default_rng(seed)
    plan = FloorPlan()
    length, width = float(rng.uniform(*LENGTHS)), float(rng.uniform(*WIDTHS))
    for start, end, outwards in (
        ((0.0, 0.0), (length, 0.0), (0.0, -1.0)),
        ((0.0, width), (length, width), (0.0, 1.0)),
        ((0.0, 0.0), (0.0, width), (-1.0, 0.0)),
        ((length, 0.0), (length, width), (1.0, 0.0)),
    ):
        featured_wall(plan, rng, start, end, outwards)
    _columns(plan, rng, length, width)
    return World("hall", plan.segments(), np.array(_route(rng, length, width)))


def _columns(plan: FloorPlan, rng: np.random.Generator, length: float, width: float) -> None:
    """Add a row of columns, round or square, along each wall."""
    for axis, extent, sides in (
        (0, length, (COLUMN_ROW, width - COLUMN_ROW)),
        (1, width, (COLUMN_ROW, length - COLUMN_ROW)),
    ):
        for side in sides:
            at = float(rng.uniform(*COLUMN_SPACING))
            while at < extent - COLUMN_SPACING[0]:
                x, y = (at, side) if axis == 0 else (side, at)
                size = float(rng.uniform(0.2, 0.4))
                if rng.random() < 0.5:
                    plan.pillar((x, y), size, num_sides=10)
                else:
                    plan.box((x - size, y - size), (x + size, y + size))
                at += float(rng.uniform(*COLUMN_SPACING))


def _route(rng: np.random.Generator, length: float, width: float) -> list[Point]:
    """Return a lap, a crossing from west to east, half a lap, one from north to south, a lap."""

    def near(x: float, y: float) -> Point:
        aside = rng.uniform(-0.5, 0.5, 2)
        return (x + float(aside[0]), y + float(aside[1]))

    west, east, south, north = LANE, length - LANE, LANE, width - LANE
    middle_x = length / 2 + float(rng.uniform(-4.0, 4.0))
    middle_y = width / 2 + float(rng.uniform(-3.0, 3.0))
    return [
        near(west, middle_y - 8.0),
        near(west, south),
        near(east, south),
        near(east, north),
        near(west, north),
        near(west, middle_y),
        near(east, middle_y),
        near(east, north),
        near(middle_x, north),
        near(middle_x, south),
        near(west, south),
        near(west, middle_y - 4.0),
    ]
