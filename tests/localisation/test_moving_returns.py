# SPDX-License-Identifier: Apache-2.0
"""Returns of what moves are those where scans just before saw through."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from cartoloop.localisation.moving_returns import MovingReturns
from cartoloop.sensor.pose import IDENTITY, Pose, transform_points

ANGLES = np.radians(np.arange(-180.0, 180.0))
WALL_M = 5.0


class Scan(NamedTuple):
    time: float
    pose: Pose
    points: np.ndarray


def moving(returns, scan):
    points = transform_points(scan.pose, scan.points)
    return returns.add(scan.time, scan.pose, points, points)


def scan(time, *people, pose=IDENTITY, wall=WALL_M):
    """A scan in a round room of people, each from one angle to another at a distance."""
    ranges = np.full(len(ANGLES), wall)
    if pose != IDENTITY:
        # From a place beside the middle, the wall is where it was.
        along = pose.x * np.cos(ANGLES + pose.theta) + pose.y * np.sin(ANGLES + pose.theta)
        ranges = -along + np.sqrt(wall**2 - pose.x**2 - pose.y**2 + along**2)
    for first_deg, last_deg, distance in people:
        inside = (
            np.abs(np.degrees(ANGLES) - 0.5 * (first_deg + last_deg))
            < 0.5 * (last_deg - first_deg) + 0.1
        )
        ranges[inside] = distance
    points = ranges[:, None] * np.column_stack((np.cos(ANGLES), np.sin(ANGLES)))
    return Scan(time, pose, points)


def directions(found):
    return np.degrees(ANGLES[found]).round().tolist()


def test_who_comes_in_between_moves():
    returns = MovingReturns()
    assert not moving(returns, scan(0.0)).any()

    assert directions(moving(returns, scan(0.5, (10, 14, 2.0)))) == [10, 11, 12, 13, 14]


def test_what_has_stood_there_does_not_move():
    returns = MovingReturns()
    moving(returns, scan(0.0, (10, 14, 2.0)))

    assert not moving(returns, scan(0.5, (10, 14, 2.0))).any()


def test_what_was_hidden_before_does_not_move():
    returns = MovingReturns()
    moving(returns, scan(0.0, (-10, 40, 1.0)))

    assert not moving(returns, scan(0.5, (10, 14, 2.0))).any()


def test_who_walks_on_still_moves():
    returns = MovingReturns()
    moving(returns, scan(0.0, (10, 14, 2.0)))

    assert directions(moving(returns, scan(0.5, (30, 34, 2.0)))) == [30, 31, 32, 33, 34]


def test_walls_do_not_move_where_the_robot_does():
    returns = MovingReturns()
    moving(returns, scan(0.0))

    found = moving(returns, scan(0.5, (80, 84, 1.5), pose=Pose(0.6, -0.3, 0.4)))

    assert directions(found) == [80, 81, 82, 83, 84]


def test_scans_that_are_too_near_in_time_are_not_compared():
    returns = MovingReturns()
    moving(returns, scan(0.0))

    assert not moving(returns, scan(0.1, (10, 14, 2.0))).any()


def test_where_no_beam_came_back_nothing_is_known():
    returns = MovingReturns()
    first = scan(0.0)
    far = np.abs(ANGLES - math.radians(12.0)) > math.radians(6.0)
    moving(returns, first._replace(points=first.points[far]))

    assert not moving(returns, scan(0.5, (10, 14, 2.0))).any()


def test_if_most_seems_to_move_the_robot_did():
    returns = MovingReturns()
    moving(returns, scan(0.0))

    assert not moving(returns, scan(0.5, (-90, 90, 2.0))).any()
