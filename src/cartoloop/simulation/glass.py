# SPDX-License-Identifier: Apache-2.0
"""Walls of glass, which a laser scanner sees only when it looks straight at them."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from cartoloop.arrays import BoolArray, FloatArray
from cartoloop.sensor.pose import compose_all
from cartoloop.simulation.lidar import Lidar, true_ranges, walls_within

PANE_LENGTHS = (1.0, 3.0)
"""Lengths of panes [m]; shorter walls are never glass."""

WALL_DEPTH = 0.4
"""Faces of a wall are at most so far apart [m]: where one is glass, the other one is too."""

STRAIGHT_ON = math.radians(12.0)
"""Largest angle between a beam and the normal of a pane that reflects it [rad]."""

SHARE_LOST = 0.2
"""Share of the other beams that do not come back; the rest measures what is behind the pane."""

HITS_AT_A_TIME = 4096
"""Beams whose panes are searched at a time, to bound the memory."""


class GlazedWalls(NamedTuple):
    """Walls of two kinds, each float64, shape (n, 4), segments x1, y1, x2, y2 [m], map frame."""

    solid: FloatArray
    glass: FloatArray


def glazed(walls: FloatArray, share: float, rng: np.random.Generator) -> GlazedWalls:
    """Return walls with a share of glass, in pieces of one to three metres.

    Parameters
    ----------
    walls : float64, shape (n, 4), segments x1, y1, x2, y2 [m].
    share : of their length, as far as they are longer than a pane.
    rng : the source of where.
    """
    panes = _panes(walls, share, rng)
    if len(panes) == 0:
        return GlazedWalls(walls, np.empty((0, 4)))
    solid: list[FloatArray] = []
    glass: list[FloatArray] = []
    for wall in walls:
        cuts, is_glass = _cut(wall, panes)
        ends = wall[:2] + cuts[:, None] * (wall[2:] - wall[:2])
        pieces = np.hstack((ends[:-1], ends[1:]))
        solid.append(pieces[~is_glass])
        glass.append(pieces[is_glass])
    return GlazedWalls(np.vstack(solid), np.vstack(glass))


def _panes(walls: FloatArray, share: float, rng: np.random.Generator) -> FloatArray:
    """Return boxes x_min, y_min, x_max, y_max [m] within which all walls are glass, (n, 4)."""
    decided = np.empty((len(walls) + 1, 4))
    num_decided = 0
    panes: list[FloatArray] = []
    for wall in walls:
        length = math.dist(wall[:2], wall[2:])
        at = 0.0
        while length - at >= PANE_LENGTHS[0]:
            end = min(at + rng.uniform(*PANE_LENGTHS), length)
            wanted = rng.random() < share
            first, last = (wall[:2] + to / length * (wall[2:] - wall[:2]) for to in (at, end))
            x, y = (first + last) / 2
            known = decided[:num_decided]
            inside = (
                (known[:, 0] <= x) & (x <= known[:, 2]) & (known[:, 1] <= y) & (y <= known[:, 3])
            )
            if not inside.any():
                along = np.abs(last - first) / (end - at)
                aside = WALL_DEPTH * np.array((along[1], along[0]))
                low, high = np.minimum(first, last) - aside, np.maximum(first, last) + aside
                box = np.concatenate((low, high))
                if num_decided == len(decided):
                    decided = np.vstack((decided, np.empty_like(decided)))
                decided[num_decided] = box
                num_decided += 1
                if wanted:
                    panes.append(box)
            at = end
    return np.array(panes).reshape(-1, 4)


def _cut(wall: FloatArray, panes: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Return where a wall is cut, as shares of its length, and which of the pieces are glass."""
    start, along = wall[:2], wall[2:] - wall[:2]
    enter, leave = np.zeros(len(panes)), np.ones(len(panes))
    for axis in (0, 1):
        low, high = panes[:, axis] - start[axis], panes[:, axis + 2] - start[axis]
        if abs(along[axis]) < 1e-9:
            leave[(low > 0.0) | (high < 0.0)] = -1.0
            continue
        ends = np.sort(np.column_stack((low, high)) / along[axis], axis=1)
        enter, leave = np.maximum(enter, ends[:, 0]), np.minimum(leave, ends[:, 1])
    inside = leave - enter > 1e-6
    enter, leave = enter[inside], leave[inside]
    cuts = np.unique(np.concatenate(([0.0, 1.0], enter, leave)))
    middles = (cuts[:-1] + cuts[1:]) / 2
    is_glass: BoolArray = ((middles[:, None] > enter) & (middles[:, None] < leave)).any(axis=1)
    return cuts, is_glass


def seen_through(
    ranges: FloatArray,
    glass: FloatArray,
    robot_poses: FloatArray,
    lidar: Lidar,
    rng: np.random.Generator,
) -> FloatArray:
    """Return ranges with panes between the scanner and the solid walls.

    A pane reflects beams that meet it straight on. Of the others, some do not come back, and most
    pass through it.

    Parameters
    ----------
    ranges : float64, shape (n, num_beams) [m], to solid walls, inf where there is none.
    glass : float64, shape (m, 4), segments x1, y1, x2, y2 [m], map frame.
    robot_poses : float64, shape (n, 3), x [m], y [m], theta [rad], map frame.
    lidar : the scanner.
    rng : the source of chance whether a beam comes back; one number for each beam is drawn.
    """
    chances = rng.random(ranges.shape)
    reach = lidar.range_max + math.hypot(*lidar.tf_tracking_sensor[:2])
    near = walls_within(glass, robot_poses, reach)
    if len(near) == 0:
        return ranges
    to_glass = true_ranges(near, robot_poses, lidar)
    scans, beams = np.nonzero(to_glass < ranges)
    sensors = compose_all(robot_poses, np.array(lidar.tf_tracking_sensor))
    angles = sensors[scans, 2] + lidar.geometry.angles[beams]
    directions = np.column_stack((np.cos(angles), np.sin(angles)))
    places = sensors[scans, :2] + to_glass[scans, beams, None] * directions
    incidences = np.concatenate(
        [
            _incidences(near, places[first : first + HITS_AT_A_TIME],
                        directions[first : first + HITS_AT_A_TIME])
            for first in range(0, max(len(places), 1), HITS_AT_A_TIME)
        ]
    )  # fmt: skip
    seen = ranges.copy()
    straight = incidences < STRAIGHT_ON
    seen[scans[straight], beams[straight]] = to_glass[scans[straight], beams[straight]]
    lost = ~straight & (chances[scans, beams] < SHARE_LOST)
    seen[scans[lost], beams[lost]] = np.inf
    return seen


def _incidences(panes: FloatArray, places: FloatArray, directions: FloatArray) -> FloatArray:
    """Return the angle between beams and the normal of the pane they meet, shape (n,) [rad]."""
    along = panes[:, 2:] - panes[:, :2]
    lengths = np.hypot(along[:, 0], along[:, 1])
    unit = along / lengths[:, None]
    offsets = places[:, None] - panes[:, :2]
    beyond = (offsets * unit).sum(axis=2)
    beyond -= np.clip(beyond, 0.0, lengths)
    across = offsets[..., 1] * unit[:, 0] - offsets[..., 0] * unit[:, 1]
    met = np.argmin(beyond**2 + across**2, axis=1)
    normal_part = directions[:, 1] * unit[met, 0] - directions[:, 0] * unit[met, 1]
    found: FloatArray = np.arccos(np.clip(np.abs(normal_part), 0.0, 1.0))
    return found
