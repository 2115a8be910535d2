# SPDX-License-Identifier: Apache-2.0
"""The motion of a robot whose odometry has stopped alone, and whose scans were held meanwhile."""

from __future__ import annotations

import math
from typing import NamedTuple

from cartoloop.sensor.pose import Pose, compose, wrap_angle

HELD_SHARE, MAX_TURN_RAD = 0.5, 0.1
"""Matches that have moved by less than this share of the motion were held, unless the robot has
turned by more than the second [rad]: all that it sees changes then."""


class MissedMotion(NamedTuple):
    """A motion at constant velocity.

    Attributes
    ----------
    begin : its begin [s].
    tf_local_tracking : the pose there.
    velocity : along x and y of the robot [m/s].
    """

    begin: float
    tf_local_tracking: Pose
    velocity: tuple[float, float]

    def is_held(self, time: float, pose: Pose) -> bool:
        """Return whether a later pose has not followed the motion."""
        first = self.tf_local_tracking
        expected = (time - self.begin) * math.hypot(*self.velocity)
        moved = math.hypot(pose.x - first.x, pose.y - first.y)
        turned = abs(wrap_angle(pose.theta - first.theta))
        return moved < HELD_SHARE * expected and turned < MAX_TURN_RAD

    def corrected(self, time: float, pose: Pose) -> Pose:
        """Return a later pose where this motion has led; its heading was determined by the scan."""
        duration = time - self.begin
        if duration <= 0.0:
            return pose
        first = self.tf_local_tracking
        heading = first.theta + 0.5 * wrap_angle(pose.theta - first.theta)
        x, y = self.velocity
        there = compose(Pose(first.x, first.y, heading), Pose(duration * x, duration * y, 0.0))
        return there._replace(theta=pose.theta)
