# SPDX-License-Identifier: Apache-2.0
"""Wheel odometry as a continuous motion: poses between and shortly beyond the readings."""

from __future__ import annotations

from bisect import bisect_right

import numpy as np

from cartoloop.sensor.pose import FloatArray, Pose, interpolate

MAX_EXTRAPOLATION_S = 0.5
"""Beyond the last reading the motion is continued for so long, then held."""


class OdometryTrack:
    """The odometry readings so far, by their time."""

    def __init__(self) -> None:
        self._times: list[float] = []
        self._poses: list[Pose] = []

    def __len__(self) -> int:
        return len(self._times)

    def add(self, time: float, tf_odom_tracking: Pose) -> None:
        """Add a reading; of several at one time the last holds, older ones are ignored."""
        if self._times and time <= self._times[-1]:
            if time == self._times[-1]:
                self._poses[-1] = tf_odom_tracking
            return
        self._times.append(time)
        self._poses.append(tf_odom_tracking)

    def at(self, time: float) -> Pose | None:
        """Return tf_odom_tracking at a time, or None where the readings do not reach."""
        times, poses = self._times, self._poses
        if not times or time < times[0]:
            return None
        after = bisect_right(times, time)
        if after < len(times):
            fraction = (time - times[after - 1]) / (times[after] - times[after - 1])
            return interpolate(poses[after - 1], poses[after], fraction)
        if len(times) < 2 or time == times[-1]:
            return poses[-1]
        span = times[-1] - times[-2]
        beyond = min(time - times[-1], MAX_EXTRAPOLATION_S)
        return interpolate(poses[-2], poses[-1], 1.0 + beyond / span) if span < 1.0 else poses[-1]

    def arrays(self) -> tuple[FloatArray, FloatArray]:
        """Return times, shape (n,), and poses, shape (n, 3)."""
        return np.array(self._times), np.array(self._poses).reshape(-1, 3)
