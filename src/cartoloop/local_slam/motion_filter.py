# SPDX-License-Identifier: Apache-2.0
"""Which scans are inserted: those that show something new (section IV)."""

from __future__ import annotations

import math

from cartoloop.config import MotionFilterConfig
from cartoloop.sensor.pose import Pose, wrap_angle


class MotionFilter:
    """Lets a scan pass if time, distance or rotation since the last one passed is large enough."""

    def __init__(self, config: MotionFilterConfig) -> None:
        self._config = config
        self._last_time = -math.inf
        self._last_pose = Pose(math.inf, math.inf, 0.0)

    def forget(self) -> None:
        """Let the next scan pass: where it is does not follow from the last one."""
        self._last_time = -math.inf

    def is_new(self, time: float, pose: Pose) -> bool:
        """Return whether the scan is to be inserted; if so, compare the next ones with it."""
        config = self._config
        if (
            time - self._last_time <= config.max_time_seconds
            and math.hypot(pose.x - self._last_pose.x, pose.y - self._last_pose.y)
            <= config.max_distance_meters
            and abs(wrap_angle(pose.theta - self._last_pose.theta))
            <= math.radians(config.max_angle_degrees)
        ):
            return False
        self._last_time, self._last_pose = time, pose
        return True
