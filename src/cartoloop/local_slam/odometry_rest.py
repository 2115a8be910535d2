# SPDX-License-Identifier: Apache-2.0
"""A time in which the odometry does not change, and what came before it."""

from __future__ import annotations

import math
from collections import deque

from cartoloop.sensor.pose import Pose

REST_M, REST_RAD = 1e-6, 0.005
"""Odometry that reports less from scan to scan has not changed [m], [rad]: its heading may have
noise."""

BEFORE_S = 1.0
"""Time before a rest over which the speed is measured [s]."""

NUM_GAINS = 15
"""Number of latest scans over which the gain is averaged."""


class OdometryRest:
    """A time in which the odometry does not change.

    Attributes
    ----------
    since : its begin [s]; infinite while the odometry changes.
    velocity_before : over the last second before, along x and y of the robot [m/s].
    """

    def __init__(self) -> None:
        self.since = math.inf
        self.velocity_before = (0.0, 0.0)
        self._gains: deque[float] = deque(maxlen=NUM_GAINS)
        self._steps: deque[tuple[float, float, Pose]] = deque()  # begin, end, motion

    def move(self, begin: float, end: float, step: Pose) -> None:
        """Note a step between two times [s], which ends the rest."""
        self.since = math.inf
        self._gains.clear()
        self._steps.append((begin, end, step))
        while end - self._steps[0][1] > BEFORE_S:
            self._steps.popleft()

    def begin(self, time: float) -> None:
        """Begin to rest at a time, if it does not already."""
        if self.since < math.inf:
            return
        self.since = time
        seconds = math.fsum(end - begin for begin, end, _ in self._steps)
        if seconds > 0.0:
            x = math.fsum(step.x for _, _, step in self._steps)
            y = math.fsum(step.y for _, _, step in self._steps)
            self.velocity_before = (x / seconds, y / seconds)
        else:
            self.velocity_before = (0.0, 0.0)
        self._steps.clear()

    def mean_gain(self, gain: float) -> float:
        """Add what motion explains more of a scan than rest; return the mean of the latest."""
        self._gains.append(gain)
        return math.fsum(self._gains) / len(self._gains)


def is_at_rest(step: Pose) -> bool:
    """Return whether odometry reports no distance and hardly any turn."""
    return math.hypot(step.x, step.y) < REST_M and abs(step.theta) < REST_RAD
