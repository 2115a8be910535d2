# SPDX-License-Identifier: Apache-2.0
"""The latest steps of one scanner, by scans and by odometry, as far as the scans determine them."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from typing import NamedTuple

from cartoloop.local_slam.moving_gain import ALL_BY_REST, Explained
from cartoloop.sensor.pose import IDENTITY, Pose, quick_pose

WINDOW_S, MIN_STEPS = 1.0, 5
"""Least time [s] and number of steps that are compared together: errors of single matches and of
the clock average out."""

SLOW_WINDOW_S, WINDOW_M = 4.0, 0.6
"""Window of a slow robot: as long as scans and odometry have moved by less than the second [m], up
to the first [s]. In a second, it moves by less than errors that are no fault."""


class Evidence(NamedTuple):
    """What a match says about the motion.

    Attributes
    ----------
    is_determined : whether it determines the position in both directions.
    direction : otherwise, the direction that it does not determine [rad], local frame.
    change_since : returns by how much the ranges have changed since a time, in the median [m]; inf
        if that is not known.
    wall_ratio : returns which way walls face, see :func:`normal_ratio`.
    changed_share : returns the share of the ranges that have changed since a time; 0 if that is not
        known.
    explained : returns how much of the scan rest and motion since a time, at a velocity, explain;
        all if that is not known.
    """

    is_determined: bool
    direction: float
    change_since: Callable[[float], float]
    wall_ratio: Callable[[], float]
    changed_share: Callable[[float], float] = lambda _: 0.0
    explained: Callable[[float, tuple[float, float]], Explained] = lambda *_: ALL_BY_REST


class Step(NamedTuple):
    """A step between two scans, in the local frame [m], [rad], as far as the scans determine it."""

    begin: float
    end: float
    matched: Pose
    reported: Pose


class StepWindow:
    """The latest steps of one scanner, and the sums of their motions.

    Attributes
    ----------
    steps : the latest.
    matched, reported : sums of the motions of scans and odometry.
    """

    def __init__(self) -> None:
        self.steps: deque[Step] = deque()
        self.matched = self.reported = IDENTITY

    def add(self, step: Step) -> None:
        """Add a step, and drop those that are not needed for a window."""
        steps = self.steps
        steps.append(step)
        self.matched = _sum(self.matched, step.matched)
        self.reported = _sum(self.reported, step.reported)
        while len(steps) > MIN_STEPS and step.end - steps[1].begin >= WINDOW_S:
            first = steps[0]
            matched = _difference(self.matched, first.matched)
            reported = _difference(self.reported, first.reported)
            if (
                step.end - steps[1].begin < SLOW_WINDOW_S
                and max(size_of(matched), size_of(reported)) < WINDOW_M
            ):
                break
            steps.popleft()
            self.matched, self.reported = matched, reported

    def clear(self) -> None:
        """Drop all steps."""
        self.steps.clear()
        self.matched = self.reported = IDENTITY


def _sum(one: Pose, other: Pose) -> Pose:
    """Return the sum of two motions, number by number."""
    x, y, theta = one
    more_x, more_y, more_theta = other
    return quick_pose((x + more_x, y + more_y, theta + more_theta))


def _difference(one: Pose, other: Pose) -> Pose:
    """Return the difference of two motions, number by number."""
    x, y, theta = one
    less_x, less_y, less_theta = other
    return quick_pose((x - less_x, y - less_y, theta - less_theta))


def step_between(
    last: tuple[float, Pose],
    end: float,
    matched: Pose,
    reported: Pose,
    evidence: Evidence | None,
) -> Step:
    """Return a step of scans and odometry, rotated into the local frame, as far as it counts."""
    begin, before = last
    if evidence is None:
        return Step(begin, end, IDENTITY, IDENTITY)
    # Along the mean heading of the scans, so that a wrong turn is no wrong distance.
    heading = before.theta + 0.5 * (matched.theta - reported.theta)
    return Step(
        begin,
        end,
        _counted(matched, before.theta, evidence),
        _counted(reported, heading, evidence),
    )


def _counted(motion: Pose, heading: float, evidence: Evidence) -> Pose:
    """Return a motion in the local frame, as far as scans determine it."""
    motion_x, motion_y, theta = motion
    cos, sin = math.cos(heading), math.sin(heading)
    x, y = cos * motion_x - sin * motion_y, sin * motion_x + cos * motion_y
    if not evidence.is_determined:
        across_x, across_y = -math.sin(evidence.direction), math.cos(evidence.direction)
        length = across_x * x + across_y * y
        x, y = length * across_x, length * across_y
    return quick_pose((x, y, theta))


def size_of(motion: Pose) -> float:
    """Return the size of a step: distance, and the way of a point a metre away."""
    x, y, theta = motion
    return math.hypot(x, y) + abs(theta)
