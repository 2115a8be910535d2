# SPDX-License-Identifier: Apache-2.0
"""How a robot may have moved while its scans show nothing, and when that is too much.

A scanner that is covered, or has nothing near enough in front of it, measures no motion, and
neither does one that is silent. What odometry measures is wrong by a share of it; without odometry,
the robot may drive anywhere. These errors add up: they are not random from scan to scan.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from cartoloop.sensor.pose import Pose

ALONG_SHARE, BLIND_SPEED = 0.05, 1.0
"""The motion is wrong by this share of its length where it rests on odometry, and by this speed
where there is none [m/s]."""

TURN_SHARE, VEER_RAD, BLIND_TURN_RATE = 0.02, math.radians(0.25), 0.5
"""The heading is wrong by this share of the turns and by this angle after a metre where it rests on
odometry [rad], and by this rate where there is none [rad/s]."""

MAX_UNSEEN_M, MAX_UNSEEN_RAD = 2.0, math.radians(60.0)
"""Standard deviations of the motion without anything seen from which the place is not known any
longer [m], [rad]: two seconds without odometry, or about thirty metres with it."""


class MotionError(NamedTuple):
    """Standard deviations of a motion [m], [rad]."""

    position: float
    heading: float


NO_ERROR = MotionError(0.0, 0.0)


def unseen_error(step: Pose, duration: float, *, has_odometry: bool) -> MotionError:
    """Return by how much a motion may be wrong that no scan has measured.

    Parameters
    ----------
    step : the motion by local SLAM.
    duration : of it [s].
    """
    if not has_odometry:
        return MotionError(BLIND_SPEED * duration, BLIND_TURN_RATE * duration)
    length = math.hypot(step.x, step.y)
    return MotionError(ALONG_SHARE * length, TURN_SHARE * abs(step.theta) + VEER_RAD * length)


class UnseenMotion:
    """The motion since scans have last shown anything."""

    def __init__(self) -> None:
        self._error = NO_ERROR

    @property
    def is_too_long(self) -> bool:
        """Whether a place that was known before is not known any longer."""
        return self._error.position > MAX_UNSEEN_M or self._error.heading > MAX_UNSEEN_RAD

    def add(self, step: Pose, error: MotionError | None) -> None:
        """Add the motion to a scan, and by how much it may be wrong; None if scans measured it."""
        if error is None:
            self._error = NO_ERROR
            return
        heading = self._error.heading + error.heading
        aside = heading * math.hypot(step.x, step.y)
        self._error = MotionError(self._error.position + error.position + aside, heading)
