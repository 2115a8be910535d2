# SPDX-License-Identifier: Apache-2.0
"""How far the robot moved between two scans, by these two scans alone.

A matched pose is a compromise of scan, map and odometry. Along a corridor the odometry decides, and
the map that it made agrees with it: whatever the matched poses say about its scale is what was
assumed of it. So two scans a metre apart are compared with each other, at all distances alike.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from cartoloop.arrays import FloatArray
from cartoloop.kernels.outline_shift import add_shift_costs
from cartoloop.local_slam.outline import Outline, outline_of
from cartoloop.sensor.pose import Pose, compose, inverse, relative
from cartoloop.sensor.range_noise import no_noise

MIN_DISTANCE_M, MAX_DISTANCE_M = 1.0, 2.0
"""Distance between the scans [m]: errors of a comparison are the same at all distances, as long as
both scans see the same walls."""

MAX_TURN_RAD = math.radians(15.0)
"""Largest turn between the scans [rad]: beyond, they see other parts of the walls."""

MIN_RETURNS = 50
"""Scans with fewer returns are not compared."""

STEP_M, REACH = 0.03, 8
"""Shifts that are tried, from the matched distance: their spacing [m], and number to each side. A
scale that is wrong by a fifth is found."""

NEAR = 2
"""Number of shifts to each side of the best one through which a parabola is laid."""

SIGMA_M, NOISE_M, NOISE_FACTOR = 0.03, 0.03, 8.0
"""Standard deviation of the distance of a return from a line [m], with ranges whose noise is up to
the second [m]. It grows by the third times what the noise is above that: returns that noise moves
beyond where they cost as much as any make distances too short."""

NEAR_QUANTILE = 0.25
"""The noise at this quantile of the ranges counts: near walls show most of the distance."""

MAX_SIGMAS, UNSHOWN = 3.0, 0.2
"""Distance from a line from which a return costs as much as any, as a multiple of the standard
deviation; and shares of that cost of returns where the other scan should show a line, and beside
all that it shows: with less, a shift by which scans overlap less is preferred, with more the
opposite. See `best_step`; what the other scan could not show costs nothing."""

MAX_GAP_RAD = math.radians(3.0)
"""Neighbouring returns whose bearings differ by more are not connected [rad]."""

_SHIFTS: FloatArray = STEP_M * np.arange(-REACH, REACH + 1, dtype=np.float64)
_NEAR: FloatArray = np.arange(-NEAR, NEAR + 1, dtype=np.float64)
_SQUARES = _NEAR**2 - (_NEAR**2).mean()


class MeasuredDistance(NamedTuple):
    """A distance between two scans.

    Attributes
    ----------
    begin, end : times of the scans [s].
    distance : along the matched motion [m].
    along : x and y of the unit vector of the matched motion, frame of the robot at the begin.
    information : curvature of the cost, relative to that of other distances.
    """

    begin: float
    end: float
    distance: float
    along: tuple[float, float]
    information: float


class _Seen(NamedTuple):
    time: float
    pose: Pose
    tf_tracking_sensor: Pose
    returns: FloatArray
    outline: Outline


class DistanceMeter:
    """Compares scans of one scanner, about a metre apart along the path."""

    def __init__(self) -> None:
        self._first: _Seen | None = None

    @property
    def begin(self) -> float | None:
        """Time of the scan from which the next distance is measured [s]; None without one."""
        return None if self._first is None else self._first.time

    def forget(self) -> None:
        """Forget all scans: the next one is the first."""
        self._first = None

    def add(
        self,
        time: float,
        pose: Pose,
        tf_tracking_sensor: Pose,
        returns: FloatArray,
        noise: Callable[[], float] = no_noise,
    ) -> MeasuredDistance | None:
        """Add a scan; return a distance to it, if it is far enough from the one before.

        Parameters
        ----------
        time : of the scan [s].
        pose : as matched, local frame.
        tf_tracking_sensor : pose of the scanner on the robot.
        returns : shape (n, 2), tracking frame [m].
        noise : returns the standard deviation of the ranges, if they are noisy [m]: it is seldom
            needed.
        """
        first = self._first
        if first is not None:
            moved = relative(first.pose, pose)
            is_straight = abs(moved.theta) <= MAX_TURN_RAD
            if is_straight and math.hypot(moved.x, moved.y) < MIN_DISTANCE_M:
                return None
        self._first = None
        if len(returns) < MIN_RETURNS:
            return None
        last = _Seen(
            time, pose, tf_tracking_sensor, returns, outline_of(returns, tf_tracking_sensor)
        )
        self._first = last
        if first is None or not is_straight or time <= first.time:
            return None
        return _measured(first, last, SIGMA_M + NOISE_FACTOR * max(noise() - NOISE_M, 0.0))


def _measured(first: _Seen, last: _Seen, sigma: float) -> MeasuredDistance | None:
    """Return the distance at which two scans fit best; None where none fits best clearly."""
    moved = relative(first.pose, last.pose)
    length = math.hypot(moved.x, moved.y)
    if length > MAX_DISTANCE_M:
        return None
    direction = math.atan2(moved.y, moved.x) + first.pose.theta
    costs = np.zeros(len(_SHIFTS))
    # Each scan is compared with the lines of the other: errors of the lines cancel.
    _add_costs(first, last, direction, sigma, costs)
    _add_costs(last, first, direction + math.pi, sigma, costs)
    best = int(np.argmin(costs))
    if not NEAR <= best < len(costs) - NEAR:
        return None
    near = costs[best - NEAR : best + NEAR + 1]
    bend = float(near @ _SQUARES) / float(_SQUARES @ _SQUARES)
    slope = float(near @ _NEAR) / float(_NEAR @ _NEAR)
    if bend <= 0.0:
        return None
    between = min(max(-0.5 * slope / bend, -float(NEAR)), float(NEAR))
    distance = length + float(_SHIFTS[best]) + STEP_M * between
    along = moved.x / length, moved.y / length
    return MeasuredDistance(first.time, last.time, distance, along, bend)


def _add_costs(
    fixed: _Seen, shifted: _Seen, direction: float, sigma: float, costs: FloatArray
) -> None:
    """Add what each shift of one scan along a direction [rad, local frame] costs."""
    tf_sensor_local = inverse(compose(fixed.pose, fixed.tf_tracking_sensor))
    direction += tf_sensor_local.theta
    add_shift_costs(
        *fixed.outline,
        MAX_GAP_RAD,
        shifted.returns,
        compose(tf_sensor_local, shifted.pose)[:],
        (math.cos(direction), math.sin(direction)),
        _SHIFTS,
        (sigma, MAX_SIGMAS * sigma, UNSHOWN, math.nan, UNSHOWN),
        costs,
    )
