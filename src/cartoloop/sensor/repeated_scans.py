# SPDX-License-Identifier: Apache-2.0
"""Scans that a scanner sends again while the robot moves.

A driver that hangs, or that publishes faster than its scanner turns, repeats the last scan with a
new stamp: matched, it would hold the robot where it was.
"""

from __future__ import annotations

import math
from collections import Counter

import numpy as np

from cartoloop.sensor.events import LaserScan
from cartoloop.sensor.pose import Pose, relative, wrap_angle

SENT_AGAIN = "the scanner repeats its scan while the robot moves"
"""Reason for skipping a scan that a scanner has sent before."""

STALE_M, STALE_RAD = 0.02, 0.01
"""A scanner whose scan equals the one before to the last digit, while the odometry has moved by
more than either of these [m], [rad], has sent the old scan again."""

MIN_CHANGES = 5
"""Number of times that the scans of a scanner have changed before one counts as sent again: scans
that are made up may be equal for ever."""

MIN_STALE_RANGES = 20
"""Number of different ranges that such a scan has at least: where nothing is seen, scans are equal
as well."""


class RepeatedScans:
    """Compares each scan with those before it.

    Attributes
    ----------
    odom : tf_odom_tracking as last reported, None if it never was.
    """

    def __init__(self) -> None:
        self.odom: Pose | None = None
        self._first_equal: dict[str, tuple[bytes, Pose | None]] = {}
        self._num_changes: Counter[str] = Counter()

    def is_sent_again(self, scan: LaserScan) -> bool:
        """Return whether a scan is that before, and the robot has moved since the first of them."""
        sensor, ranges = scan.geometry.sensor, scan.ranges.tobytes()
        first, odom = self._first_equal.get(sensor, (b"", None))
        if ranges != first:
            self._first_equal[sensor] = ranges, self.odom
            self._num_changes[sensor] += 1
            return False
        if odom is None or self.odom is None or self._num_changes[sensor] < MIN_CHANGES:
            return False
        moved = relative(odom, self.odom)
        distance, angle = math.hypot(moved.x, moved.y), abs(wrap_angle(moved.theta))
        has_moved = distance > STALE_M or angle > STALE_RAD
        return has_moved and len(np.unique(scan.ranges)) >= MIN_STALE_RANGES
