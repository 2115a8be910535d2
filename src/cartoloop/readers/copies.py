# SPDX-License-Identifier: Apache-2.0
"""What a recording holds twice, as of a recorder that ran twice or of parts that overlap."""

from __future__ import annotations

from collections import deque

from cartoloop.sensor.pose import Pose

COPIED_SCAN = "exact copy of a scan before"
"""Reason for skipping a scan that is held twice."""

NUM_RECENT = 8
"""Lines, or messages of a topic, among which a copy is looked for."""


class CopyFinder:
    """Finds the copies among lines, or among the messages of a topic.

    Only of contents with a stamp: a robot that stands may send equal ones without.
    """

    def __init__(self) -> None:
        self._recent: deque[bytes] = deque(maxlen=NUM_RECENT)

    def is_copy(self, content: bytes) -> bool:
        """Return whether a content equals a recent one."""
        if content in self._recent:
            return True
        self._recent.append(content)
        return False


class LastOdometry:
    """Knows whether a line of odometry repeats the one before: a pose with its stamp."""

    def __init__(self) -> None:
        self._last: tuple[Pose, float] | None = None

    def is_repeated(self, tf_odom_tracking: Pose | None, stamp: float) -> bool:
        """Return whether a reading is that before it, and note it; None is no reading."""
        if tf_odom_tracking is None:
            return False
        reading = tf_odom_tracking, stamp
        is_same, self._last = reading == self._last, reading
        return is_same
