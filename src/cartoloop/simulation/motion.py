# SPDX-License-Identifier: Apache-2.0
"""From the corners of a route to a smooth motion: round bends, turns on the spot, bounded rates."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from cartoloop.arrays import FloatArray
from cartoloop.errors import ConfigError
from cartoloop.sensor.pose import wrap_angle, wrap_angles

SHARPEST_ARC = math.radians(110.0)
"""Turn [rad] from which on a corner is turned on the spot; below, it is driven as an arc."""

SHORTEST_ARC_RADIUS = 0.05
"""Radius below which a corner is turned on the spot [m], as poses are 0.02 m apart."""


@dataclass(frozen=True, slots=True)
class Motion:
    """The pose of the robot over time, linearly interpolated.

    Attributes
    ----------
    times : float64, shape (k,) [s], from 0, increasing.
    poses : float64, shape (k, 3), x [m], y [m], theta [rad], map frame; theta is not wrapped.
    """

    times: FloatArray
    poses: FloatArray

    @property
    def duration(self) -> float:
        """The time until the robot arrives at the end of its route [s]."""
        return float(self.times[-1])

    @property
    def path_length(self) -> float:
        """The path length [m]."""
        return float(np.hypot(*np.diff(self.poses[:, :2], axis=0).T).sum())

    def travelled_at(self, times: FloatArray) -> FloatArray:
        """Return the path lengths since the beginning at `times` [s], shape (n,) [m]."""
        steps = np.hypot(*np.diff(self.poses[:, :2], axis=0).T)
        travelled = np.concatenate(([0.0], np.cumsum(steps)))
        return np.interp(times, self.times, travelled)

    def poses_at(self, times: FloatArray) -> FloatArray:
        """Return the poses at `times` [s], shape (n, 3); outside the motion it stands still."""
        x, y, theta = (np.interp(times, self.times, self.poses[:, axis]) for axis in range(3))
        return np.column_stack((x, y, wrap_angles(theta)))


def delayed(motion: Motion, seconds: float) -> Motion:
    """Return the motion delayed by a time of standing still [s]."""
    if seconds <= 0.0:
        return motion
    return Motion(
        np.append(0.0, motion.times + seconds), np.vstack((motion.poses[:1], motion.poses))
    )


class Pace(NamedTuple):
    """Limits of speed and acceleration, and the radius of corners.

    Attributes
    ----------
    speed : largest speed [m/s].
    turn_rate : largest angular rate [rad/s].
    acceleration : largest acceleration along the path [m/s^2].
    corner_radius : of the arcs that round off corners, where the legs are long enough [m].
    """

    speed: float = 1.0
    turn_rate: float = 0.9
    acceleration: float = 0.6
    corner_radius: float = 0.5


def drive(
    route: FloatArray,
    speed: float = 1.0,
    turn_rate: float = 0.9,
    acceleration: float = 0.6,
    corner_radius: float = 0.5,
) -> Motion:
    """Return the motion of a robot along a route.

    Parameters
    ----------
    route : float64, shape (k, 2), the corners of the path [m]; k = 1 stands still.
    speed : largest speed [m/s].
    turn_rate : largest angular rate [rad/s].
    acceleration : largest acceleration along the path [m/s^2].
    corner_radius : of the arcs that round off corners, where the legs are long enough [m].

    Raises
    ------
    ConfigError
        When a limit is not positive or the route has no points.
    """
    if min(speed, turn_rate, acceleration) <= 0.0 or corner_radius < 0.0:
        raise ConfigError("speed, turn rate and acceleration must be positive: check the motion")
    route = np.asarray(route, dtype=np.float64).reshape(-1, 2)
    if len(route) == 0:
        raise ConfigError("the route has no points: give at least one")
    moved = np.hypot(*np.diff(route, axis=0).T) > 1e-9
    route = route[np.concatenate(([True], moved))]
    if len(route) == 1:
        return Motion(np.zeros(1), np.array([[route[0, 0], route[0, 1], 0.0]]))
    path = _round_corners(route, corner_radius)
    return Motion(_timed(path, speed, turn_rate, acceleration), path)


def _round_corners(route: FloatArray, corner_radius: float) -> FloatArray:
    """Return close poses along the route, its corners as arcs or as turns on the spot, (k, 3)."""
    legs = np.diff(route, axis=0)
    lengths = np.hypot(legs[:, 0], legs[:, 1])
    headings = np.arctan2(legs[:, 1], legs[:, 0])
    pieces: list[FloatArray] = []
    heading = float(headings[0])
    begin = route[0]
    for leg in range(len(legs)):
        last = leg == len(legs) - 1
        turn = 0.0 if last else wrap_angle(float(headings[leg + 1] - headings[leg]))
        along = legs[leg] / lengths[leg]
        radius = 0.0
        if 1e-9 < abs(turn) < SHARPEST_ARC:
            reach = 0.5 * min(lengths[leg], lengths[leg + 1])
            radius = min(corner_radius, float(reach) / math.tan(abs(turn) / 2))
        if radius < SHORTEST_ARC_RADIUS:
            radius = 0.0
        end = route[leg + 1] - along * radius * math.tan(abs(turn) / 2)
        pieces.append(_line(begin, end, heading))
        if radius > 0.0:
            pieces.append(_arc(end, heading, turn, radius))
        elif turn != 0.0:
            pieces.append(_spin(end, heading, turn))
        begin, heading = pieces[-1][-1, :2], heading + turn
    path = np.vstack(pieces)
    fresh = np.abs(np.diff(path, axis=0)).max(axis=1) > 1e-12
    return path[np.concatenate(([True], fresh))]


def _line(begin: FloatArray, end: FloatArray, heading: float) -> FloatArray:
    """Return poses every few centimetres from `begin` to `end`."""
    count = 2 + int(math.dist(begin, end) / 0.02)
    return np.column_stack((np.linspace(begin, end, count), np.full(count, heading)))


def _arc(begin: FloatArray, heading: float, turn: float, radius: float) -> FloatArray:
    """Return poses along an arc that turns the heading by `turn` [rad]."""
    side = math.copysign(1.0, turn)
    centre = begin + side * radius * np.array((-math.sin(heading), math.cos(heading)))
    headings = heading + np.linspace(0.0, turn, 2 + int(abs(turn) * max(radius, 0.5) / 0.01))
    outwards = np.column_stack((np.sin(headings), -np.cos(headings)))
    return np.column_stack((centre + side * radius * outwards, headings))


def _spin(place: FloatArray, heading: float, turn: float) -> FloatArray:
    """Return poses of a turn on the spot."""
    headings = heading + np.linspace(0.0, turn, 2 + int(abs(turn) / 0.02))
    return np.column_stack((np.tile(place, (len(headings), 1)), headings))


def _timed(path: FloatArray, speed: float, turn_rate: float, acceleration: float) -> FloatArray:
    """Return when the robot is at each pose, as fast as the limits allow, shape (k,) [s]."""
    steps = np.hypot(*np.diff(path[:, :2], axis=0).T)
    turns = np.abs(np.diff(path[:, 2]))
    spins = steps < 1e-9
    limits = np.full(len(steps), speed)
    bends = ~spins & (turns > 0.0)
    limits[bends] = np.minimum(speed, turn_rate * steps[bends] / turns[bends])
    limits[spins] = 0.0

    speeds = np.minimum(np.append(limits, 0.0), np.append(0.0, limits))
    for at in range(len(steps)):  # speeding up
        reachable = math.sqrt(speeds[at] ** 2 + 2.0 * acceleration * steps[at])
        speeds[at + 1] = min(speeds[at + 1], reachable)
    for at in range(len(steps) - 1, -1, -1):  # slowing down
        reachable = math.sqrt(speeds[at + 1] ** 2 + 2.0 * acceleration * steps[at])
        speeds[at] = min(speeds[at], reachable)

    mean_speeds = (speeds[:-1] + speeds[1:]) / 2
    seconds = np.where(spins, turns / turn_rate, 0.0)
    # A step between two turns on the spot begins and ends at rest.
    rests = ~spins & (mean_speeds == 0.0)
    seconds[rests] = 2.0 * np.sqrt(steps[rests] / acceleration)
    moves = ~spins & ~rests
    seconds[moves] = steps[moves] / mean_speeds[moves]
    return np.concatenate(([0.0], np.cumsum(seconds)))
