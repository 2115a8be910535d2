# SPDX-License-Identifier: Apache-2.0
"""How often the odometry is read, and whether old readings are sent again in between.

A driver may send more often than the wheels are read, and recorders store with each scan what was
read last. Held like this, the odometry stands still for most scans and leaps at the others.
"""

from __future__ import annotations

import math
from collections import deque
from statistics import median

from cartoloop.sensor.pose import Pose

MAX_REPEAT_S = 3.0
"""Longest time for which odometry repeats a reading and catches up [s]; beyond, it stands."""

NUM_READINGS, FEWEST_READINGS = 32, 8
"""Number of latest new readings that are looked at, and of those that suffice."""

HELD_SHARE = 0.75
"""Least share of new readings that follow one that was sent again, if readings are held. Of wheels
that are read for each message, few do while the robot moves."""

MIN_HELD_S = 0.25
"""Shortest period of readings that are left out if they are sent again [s]: in shorter ones a robot
moves by centimetres."""

MAX_PERIODS = 2.3
"""Longest time between new readings while the robot moves, in usual ones: one may be lost."""


class ReadingPeriod:
    """The time between readings that are new.

    Parameters
    ----------
    held_s : `held_s` of an earlier pass.

    Attributes
    ----------
    usual_s : usual time from one to the next [s]; 0 before it is known.
    longest_s : time after which the next new reading has come if the robot moves [s]; 0 before it
        is known.
    latest_new : time of the latest new reading [s].
    are_held : whether most readings are sent again until the next new one.
    """

    def __init__(self, held_s: float = 0.0) -> None:
        self.usual_s = 0.0
        self.longest_s = held_s
        self.latest_new = math.nan
        self.are_held = held_s > 0.0
        self._last: tuple[float, Pose] | None = None
        self._periods: deque[float] = deque(maxlen=NUM_READINGS)
        self._held: deque[bool] = deque(maxlen=NUM_READINGS)

    @property
    def held_s(self) -> float:
        """`longest_s` of readings that are held; 0 of others."""
        return self.longest_s if self.are_held else 0.0

    def add(self, time: float, pose: Pose) -> None:
        """Add a reading, new or not; one that is not later than the last is ignored."""
        last = self._last
        if last is not None and time <= last[0]:
            return
        self._last = time, pose
        if last is None or pose == last[1]:
            return
        period = time - self.latest_new
        if period <= MAX_REPEAT_S:
            self._periods.append(period)
            self._held.append(self.latest_new < last[0])
            if len(self._periods) >= FEWEST_READINGS:
                self._estimate()
        self.latest_new = time

    def _estimate(self) -> None:
        self.usual_s = median(self._periods)
        self.longest_s = min(MAX_PERIODS * self.usual_s, MAX_REPEAT_S)
        are_most = sum(self._held) >= HELD_SHARE * len(self._held)
        self.are_held = are_most and self.usual_s >= MIN_HELD_S
