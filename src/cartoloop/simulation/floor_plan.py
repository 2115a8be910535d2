# SPDX-License-Identifier: Apache-2.0
"""Building blocks of simulated worlds: walls with doors, boxes and pillars, and rooms in a row."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np

from cartoloop.arrays import FloatArray
from cartoloop.simulation.lidar import Lidar
from cartoloop.simulation.motion import Pace

Point = tuple[float, float]
Box = tuple[float, float, float, float]

WALL_THICKNESS = 0.12
OUTER_WALL_THICKNESS = 0.3
PANEL_THICKNESS = 0.05


@dataclass(frozen=True, slots=True)
class World:
    """What a simulated robot drives through, and how it might.

    Attributes
    ----------
    name : what the recording is called.
    walls : float64, shape (num_walls, 4), segments x1, y1, x2, y2 [m], map frame.
    route : float64, shape (num_waypoints, 2), the corners of the suggested path [m], map frame.
    pace : speed and accelerations on the route.
    lidar : the scanner that is carried along unless another one is chosen.
    has_odometry : whether recordings have wheel odometry by default.
    tape_lines : float64, shape (num_lines, 4), x1, y1, x2, y2 [m], map frame: where a laser tape
        measures from wall to wall, with nothing in between.
    drive : which drive through the building it is, from 1 on: each is a day after the one before.
    furniture : float64, shape (num_segments, 4), outlines of what may stand elsewhere on another
        drive, map frame; the walls hold as much of them as can be seen.
    """

    name: str
    walls: FloatArray
    route: FloatArray
    pace: Pace = field(default_factory=Pace)
    lidar: Lidar = field(default_factory=Lidar)
    has_odometry: bool = True
    tape_lines: FloatArray = field(default_factory=lambda: np.empty((0, 4)))
    drive: int = 1
    furniture: FloatArray = field(default_factory=lambda: np.empty((0, 4)))


@dataclass(frozen=True, slots=True)
class Opening:
    """A gap in a wall: its middle along the wall from the wall's start [m], and its width [m]."""

    middle: float
    width: float
    closed: bool = False


@dataclass(slots=True)
class FloorPlan:
    """Collects what stands on a floor; all lengths in metres, map frame.

    Attributes
    ----------
    solids : axis-aligned boxes (x_min, y_min, x_max, y_max): wall pieces, furniture.
    lines : anything else, as segments (x1, y1, x2, y2): door leaves, pillars, slanted walls.
    """

    solids: list[Box] = field(default_factory=list)
    lines: list[Box] = field(default_factory=list)

    def wall(
        self,
        start: Point,
        end: Point,
        openings: Iterable[Opening] = (),
        thickness: float = WALL_THICKNESS,
    ) -> None:
        """Add a wall along an axis, its middle line from `start` to `end`, and its doors."""
        length = math.dist(start, end)
        ux, uy = (end[0] - start[0]) / length, (end[1] - start[1]) / length

        def piece(begin: float, stop: float, half: float) -> None:
            if stop > begin:
                self.box(
                    (
                        start[0] + begin * ux - half * abs(uy),
                        start[1] + begin * uy - half * abs(ux),
                    ),
                    (start[0] + stop * ux + half * abs(uy), start[1] + stop * uy + half * abs(ux)),
                )

        at = -thickness / 2  # so that walls that meet make a full corner
        for opening in sorted(openings, key=lambda opening: opening.middle):
            begin, stop = opening.middle - opening.width / 2, opening.middle + opening.width / 2
            piece(at, begin, thickness / 2)
            if opening.closed:
                piece(begin, stop, PANEL_THICKNESS / 2)
            at = stop
        piece(at, length + thickness / 2, thickness / 2)

    def box(self, corner: Point, opposite: Point) -> None:
        """Add a solid box between two opposite corners."""
        (x1, y1), (x2, y2) = corner, opposite
        self.solids.append((min(x1, x2), min(y1, y2), max(x1, x2), max(y1, y2)))

    def polygon(self, corners: Sequence[Point]) -> None:
        """Add a closed outline."""
        for (x1, y1), (x2, y2) in zip(corners, [*corners[1:], corners[0]], strict=True):
            self.lines.append((x1, y1, x2, y2))

    def pillar(self, middle: Point, radius: float, num_sides: int = 8) -> None:
        """Add a round thing (a pillar, a plant, a table) as a regular polygon."""
        turns = math.tau * (np.arange(num_sides) + 0.5) / num_sides
        self.polygon(
            [
                (middle[0] + radius * math.cos(turn), middle[1] + radius * math.sin(turn))
                for turn in turns
            ]
        )

    def segments(self) -> FloatArray:
        """Return all that can be seen of the solids, and the lines, shape (num_segments, 4)."""
        return np.array(outline_of_boxes(self.solids) + self.lines, dtype=np.float64).reshape(-1, 4)


def outline_of_boxes(boxes: Sequence[Box]) -> list[Box]:
    """Return the edges of axis-aligned boxes without the parts that lie inside another box."""
    bounds = np.array(boxes, dtype=np.float64).reshape(-1, 4)
    edges: list[Box] = []
    for axis in (0, 1):  # 0: horizontal edges, which run along x; 1: vertical ones
        along_min, along_max = bounds[:, axis], bounds[:, 2 + axis]
        across_min, across_max = bounds[:, 1 - axis], bounds[:, 3 - axis]
        for box in range(len(bounds)):
            for across in (across_min[box], across_max[box]):
                covers = (across_min < across - 1e-9) & (across < across_max - 1e-9)
                begin = float(along_min[box])
                hidden = sorted(zip(along_min[covers], along_max[covers], strict=True))
                for hidden_begin, hidden_end in [*hidden, (along_max[box], np.inf)]:
                    end = min(float(hidden_begin), float(along_max[box]))
                    if end - begin > 1e-6:
                        edge = (begin, float(across), end, float(across))
                        edges.append(edge if axis == 0 else (edge[1], edge[0], edge[3], edge[2]))
                    begin = max(begin, float(hidden_end))
    return edges


@dataclass(frozen=True, slots=True)
class Room:
    """A rectangular room in its own axes: u along its front wall, v from there into the room.

    Attributes
    ----------
    origin : where u = v = 0 is, on the middle line of the front wall [m].
    along, inward : unit vectors of u and v, each along an axis of the map.
    width, depth : extent in u and v, between the middle lines of walls [m].
    door : the opening in the front wall.
    """

    origin: Point
    along: Point
    inward: Point
    width: float
    depth: float
    door: Opening

    def point(self, u: float, v: float) -> Point:
        """Return the place (u, v) [m] in the map frame."""
        return (
            self.origin[0] + u * self.along[0] + v * self.inward[0],
            self.origin[1] + u * self.along[1] + v * self.inward[1],
        )

    def bounds(self, u_min: float, v_min: float, u_max: float, v_max: float) -> Box:
        """Return the axis-aligned box in the map frame of a box in the room's axes."""
        (x1, y1), (x2, y2) = self.point(u_min, v_min), self.point(u_max, v_max)
        return (min(x1, x2), min(y1, y2), max(x1, x2), max(y1, y2))

    def visit(self, *spots: Point) -> list[Point]:
        """Return the path from the corridor through `spots` (u, v) [m] in the room and back out."""
        threshold = [self.point(self.door.middle, v) for v in (-1.0, 0.0, 1.4)]
        return [*threshold, *(self.point(u, v) for u, v in spots), *threshold[::-1]]


def uneven_split(
    rng: np.random.Generator, length: float, smallest: float, largest: float
) -> list[float]:
    """Return random lengths, most of them in [smallest, largest], that add up to `length` [m]."""
    num_parts = max(1, round(length / ((smallest + largest) / 2)))
    parts = rng.uniform(smallest, largest, num_parts)
    return [float(part) for part in parts * (length / parts.sum())]


def row_of_rooms(
    plan: FloorPlan,
    rng: np.random.Generator,
    origin: Point,
    along: Point,
    inward: Point,
    widths: Sequence[float],
    depth: float,
    door_limits: Point,
    share_closed: float = 0.5,
) -> list[Room]:
    """Add rooms side by side behind one front wall, each with a door, and return them.

    Parameters
    ----------
    origin : the start of the front wall [m].
    along, inward : unit vectors along the front wall and into the rooms.
    widths : of the rooms [m].
    depth : of all rooms [m]; their back wall, and the row's two ends, are left to the caller.
    door_limits : doors lie between these places along the front wall [m], where the corridor is.
    share_closed : how many of every other door are shut; those of rooms 0, 2, 4... stay open.
    """
    rooms: list[Room] = []
    doors: list[Opening] = []
    begin = 0.0
    for room_idx, width in enumerate(widths):
        end = begin + width
        low, high = max(begin + 0.9, door_limits[0]), min(end - 0.9, door_limits[1])
        door = Opening(
            middle=float(rng.uniform(low, high)),
            width=float(rng.uniform(0.92, 1.0)),
            closed=bool(rng.random() < share_closed) and room_idx % 2 == 1,
        )
        doors.append(door)
        corner = (origin[0] + begin * along[0], origin[1] + begin * along[1])
        own_door = Opening(door.middle - begin, door.width, door.closed)
        rooms.append(Room(corner, along, inward, width, depth, own_door))
        begin = end
    plan.wall(origin, rooms[-1].point(rooms[-1].width, 0.0), doors)
    for room in rooms[1:]:
        plan.wall(room.point(0.0, 0.0), room.point(0.0, depth))
    for room in rooms:
        if not room.door.closed:
            _open_leaf(plan, rng, room)
    return rooms


def shut_door(plan: FloorPlan, room: Room) -> None:
    """Close the open door of a room of :func:`row_of_rooms`."""
    _, hinge_u = _hinge(room)
    hinge = room.point(hinge_u, WALL_THICKNESS / 2)
    plan.lines[:] = [line for line in plan.lines if line[:2] != hinge]
    begin, half = room.door.middle - room.door.width / 2, PANEL_THICKNESS / 2
    plan.solids.append(room.bounds(begin, -half, begin + room.door.width, half))


def _hinge(room: Room) -> tuple[float, float]:
    """Return the side (1 or -1) of the door with more room, and u of the hinge there [m]."""
    side = 1.0 if room.width - room.door.middle > room.door.middle else -1.0
    return side, room.door.middle + side * room.door.width / 2


def _open_leaf(plan: FloorPlan, rng: np.random.Generator, room: Room) -> None:
    """Add the leaf of an open door, hinged on the side where it has more room."""
    side, hinge_u = _hinge(room)
    swing = math.radians(rng.uniform(85.0, 112.0))
    tip = room.point(
        hinge_u - side * room.door.width * math.cos(swing),
        WALL_THICKNESS / 2 + room.door.width * math.sin(swing),
    )
    plan.lines.append((*room.point(hinge_u, WALL_THICKNESS / 2), *tip))
