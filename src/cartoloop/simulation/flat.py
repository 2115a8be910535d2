# SPDX-License-Identifier: Apache-2.0
"""A simulated flat for a cheap scanner on a trolley, measured with a laser tape.

In the class of the paper's section VI-B, figure 5 and table I::

    +-----------+-----+----------------+-------+
    | bedroom   |bath | second bedroom | study |
    |           |     |                |       |
    +---   -----+-----+------   -------+-- ----+
    | corridor                                 | front door
    +---   ---------------+---------   --------+
    | living room                | kitchen     |
    |                                          |
    |                            |             |
    +----------------------------+-------------+
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cartoloop.arrays import FloatArray
from cartoloop.simulation.floor_plan import (
    OUTER_WALL_THICKNESS,
    WALL_THICKNESS,
    Box,
    FloorPlan,
    Opening,
    Point,
    World,
)
from cartoloop.simulation.furniture import Furniture
from cartoloop.simulation.lidar import LIDARS
from cartoloop.simulation.motion import Pace

# A trolley that is pushed gently: its scanner turns only twice a second.
PUSHED = Pace(speed=0.3, turn_rate=0.25, acceleration=0.3, corner_radius=0.5)

# Faces of the walls, inside the flat [m].
WIDTH, DEPTH = 15.12, 9.9
SOUTH_ROOMS = 4.09  # depth of living room and kitchen
CORRIDOR = (SOUTH_ROOMS + WALL_THICKNESS, 5.71)
NORTH_ROOMS = CORRIDOR[1] + WALL_THICKNESS  # where they begin
FRONT_DOOR = 15.09  # closed, and a little before the wall

LANE = 4.95  # middle of the corridor
WEST_DOORS, KITCHEN_DOOR, BEDROOM_DOOR, STUDY_DOOR = 3.0, 11.5, 9.0, 13.4
ARCH = Opening(middle=2.05, width=2.1)  # between living room and kitchen
DOOR_WIDTH = 0.95
# What stands in the corridor, a shoe cupboard and the like: begin along x, width, depth [m].
HALLWAY_NORTH = ((0.6, 0.8, 0.3), (6.7, 1.1, 0.28), (10.6, 0.5, 0.25))
HALLWAY_SOUTH = ((4.4, 0.6, 0.25), (8.3, 0.9, 0.3), (14.1, 0.7, 0.22))


@dataclass(frozen=True, slots=True)
class _Layout:
    """Faces of the walls that stand elsewhere in another flat [m].

    Attributes
    ----------
    living_end : length of the living room.
    bedroom_end, second_begin, second_end : of the bedrooms, along x.
    """

    living_end: float
    bedroom_end: float
    second_begin: float
    second_end: float

    @property
    def study_begin(self) -> float:
        """Behind the wall of the second bedroom."""
        return self.second_end + WALL_THICKNESS


def flat(seed: int = 0) -> World:
    """Return a flat of 15 m x 10 m, a trolley's route of about 105 m through it, and tape lines.

    Parameters
    ----------
    seed : of where some of the walls stand, and of the furniture.
    """
    rng = np.random.default_rng(seed)
    shifts = rng.uniform(-0.2, 0.2, 3).tolist()
    second_begin = 6.72 + shifts[2]
    layout = _Layout(8.67 + shifts[0], 4.3 + shifts[1], second_begin, second_begin + 5.4)
    plan = FloorPlan()
    _walls(plan, layout)
    route = np.array(_route())
    lines = _tape_lines(layout)
    furniture = Furniture(plan, route)
    for line in lines:
        furniture.keep_clear(line.reshape(2, 2))
    _furnish(furniture, rng, layout)
    return World(
        name="flat",
        walls=plan.segments(),
        route=route,
        pace=PUSHED,
        lidar=LIDARS["lds"],
        has_odometry=False,
        tape_lines=lines,
    )


def _walls(plan: FloorPlan, layout: _Layout) -> None:
    """Add all walls, and the front door."""
    half = WALL_THICKNESS / 2
    outside = OUTER_WALL_THICKNESS / 2
    low: Point = (-outside, -outside)
    high: Point = (WIDTH + outside, DEPTH + outside)
    for start, end in (
        (low, (high[0], low[1])),
        (low, (low[0], high[1])),
        ((low[0], high[1]), high),
        ((high[0], low[1]), high),
    ):
        plan.wall(start, end, thickness=OUTER_WALL_THICKNESS)
    plan.box((FRONT_DOOR, CORRIDOR[0] + 0.25), (WIDTH + 0.05, CORRIDOR[1] - 0.25))

    for x, width, depth in HALLWAY_NORTH:
        plan.box((x, CORRIDOR[1] - depth), (x + width, CORRIDOR[1]))
    for x, width, depth in HALLWAY_SOUTH:
        plan.box((x, CORRIDOR[0]), (x + width, CORRIDOR[0] + depth))

    doors_south = [Opening(WEST_DOORS, DOOR_WIDTH), Opening(KITCHEN_DOOR, DOOR_WIDTH)]
    plan.wall((0.0, SOUTH_ROOMS + half), (WIDTH, SOUTH_ROOMS + half), doors_south)
    doors_north = [
        Opening(WEST_DOORS, DOOR_WIDTH),
        Opening((layout.bedroom_end + layout.second_begin) / 2, 0.8, closed=True),
        Opening(BEDROOM_DOOR, DOOR_WIDTH),
        Opening(STUDY_DOOR, DOOR_WIDTH),
    ]
    plan.wall((0.0, CORRIDOR[1] + half), (WIDTH, CORRIDOR[1] + half), doors_north)

    plan.wall((layout.living_end + half, 0.0), (layout.living_end + half, SOUTH_ROOMS), [ARCH])
    for x in (layout.bedroom_end + half, layout.second_begin - half, layout.second_end + half):
        plan.wall((x, NORTH_ROOMS), (x, DEPTH))


def _tape_lines(layout: _Layout) -> FloatArray:
    """Return where the laser tape measures from face to face, shape (num_lines, 4) [m]."""
    return np.array(
        [
            (5.2, 0.0, 5.2, SOUTH_ROOMS),
            (layout.second_begin, 7.7, layout.second_end, 7.7),
            (0.0, 3.55, layout.living_end, 3.55),
            (WEST_DOORS, 0.0, WEST_DOORS, DEPTH),  # through two doors that face each other
            (0.0, LANE, FRONT_DOOR, LANE),
            (0.0, 1.9, WIDTH, 1.9),  # through the arch
            (STUDY_DOOR + 0.2, CORRIDOR[0], STUDY_DOOR + 0.2, DEPTH),
        ]
    )


def _route() -> list[Point]:
    """Return the route: around by living room and kitchen, into three rooms, and around again."""
    return [
        (13.8, LANE - 0.1),
        (WEST_DOORS, LANE),
        (WEST_DOORS, 2.1),
        (KITCHEN_DOOR, 2.0),
        (KITCHEN_DOOR, LANE),
        (STUDY_DOOR, LANE + 0.1),
        (STUDY_DOOR, 7.0),
        (14.2, 7.0),
        (14.2, 8.6),
        (13.0, 8.6),
        (13.0, 7.0),
        (STUDY_DOOR, 6.5),
        (STUDY_DOOR, LANE),
        (BEDROOM_DOOR, LANE),
        (BEDROOM_DOOR, 7.0),
        (10.8, 7.2),
        (10.8, 8.7),
        (7.9, 8.7),
        (7.9, 7.2),
        (BEDROOM_DOOR, 6.6),
        (BEDROOM_DOOR, LANE - 0.1),
        (WEST_DOORS, LANE + 0.1),
        (WEST_DOORS, 8.7),
        (1.2, 8.7),
        (1.2, 7.2),
        (WEST_DOORS, 6.9),
        (WEST_DOORS, LANE),
        (KITCHEN_DOOR, LANE),
        (KITCHEN_DOOR, 2.9),
        (13.7, 2.8),
        (13.7, 1.3),
        (KITCHEN_DOOR, 1.5),
        (1.3, 1.4),
        (1.3, 2.9),
        (WEST_DOORS, 2.9),
        (WEST_DOORS, LANE),
        (12.6, LANE),
    ]


def _furnish(furniture: Furniture, rng: np.random.Generator, layout: _Layout) -> None:
    """Put beds, cupboards and shelves along the walls, tables and chairs about the rooms."""
    rooms: list[Box] = [
        (0.0, 0.0, layout.living_end, SOUTH_ROOMS),
        (layout.living_end + WALL_THICKNESS, 0.0, WIDTH, SOUTH_ROOMS),
        (0.0, NORTH_ROOMS, layout.bedroom_end, DEPTH),
        (layout.second_begin, NORTH_ROOMS, layout.second_end, DEPTH),
        (layout.study_begin, NORTH_ROOMS, WIDTH, DEPTH),
    ]
    for x_min, y_min, x_max, y_max in rooms:
        for _ in range(round(6.0 * (x_max - x_min))):
            length, depth = float(rng.uniform(0.5, 2.0)), float(rng.uniform(0.35, 0.6))
            sizes = (length, depth) if rng.random() < 0.5 else (depth, length)
            x = float(rng.uniform(x_min, x_max - sizes[0]))
            y = float(rng.uniform(y_min, y_max - sizes[1]))
            if sizes[0] > sizes[1]:
                y = y_min if rng.random() < 0.5 else y_max - sizes[1]
            else:
                x = x_min if rng.random() < 0.5 else x_max - sizes[0]
            furniture.place((x, y, x + sizes[0], y + sizes[1]), clearance=0.35, gap=0.3)
        for _ in range(6):
            radius = float(rng.uniform(0.12, 0.3))
            x = float(rng.uniform(x_min + 0.4, x_max - 0.4))
            y = float(rng.uniform(y_min + 0.4, y_max - 0.4))
            around = (x - radius, y - radius, x + radius, y + radius)
            if furniture.place(around, clearance=0.45, gap=0.3, visible=False):
                furniture.plan.pillar((x, y), radius, num_sides=6)
