# SPDX-License-Identifier: Apache-2.0
"""What the odometry reports across times in which nothing was recorded.

If the robot hardly moved by it though it was driving, the clock has jumped.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from cartoloop.local_slam.odometry_track import OdometryTrack
from cartoloop.sensor.pose import relative

MIN_PAUSE_S, PAUSE_PERIODS = 1.5, 6.0
"""Scans and odometry pause if neither is read for longer than this [s], and than this many usual
periods of the odometry."""


@dataclass(frozen=True, slots=True)
class OdometryPause:
    """The motion by uncalibrated odometry across a time without scans and readings.

    Attributes
    ----------
    begin, end : the scans before and after it [s].
    odometry_m, odometry_rad : [m], [rad].
    """

    begin: float
    end: float
    odometry_m: float
    odometry_rad: float


class OdometryPauses:
    """Collects the pauses.

    Attributes
    ----------
    found : in order.
    """

    def __init__(self) -> None:
        self.found: list[OdometryPause] = []
        self._last = math.inf
        self._open: tuple[float, float] | None = None

    def add(self, time: float, track: OdometryTrack) -> None:
        """Add the time of a scan [s]; readings after it may still be missing."""
        if time - self._last > MIN_PAUSE_S:
            self._open = (self._last, time)
        self._last = time
        if self._open is not None and track.latest >= self._open[1]:
            pause = _pause(*self._open, track)
            self._open = None
            if pause is not None:
                self.found.append(pause)


def _pause(begin: float, end: float, track: OdometryTrack) -> OdometryPause | None:
    """Return the pause between two scans; None if the odometry was read, or jumps."""
    if track.longest_pause(begin, end) <= max(MIN_PAUSE_S, PAUSE_PERIODS * track.period.usual_s):
        return None
    before, after = track.at(begin), track.at(end)
    if before is None or after is None or track.jumps_between(begin, end):
        return None
    step = relative(before, after)
    return OdometryPause(begin, end, math.hypot(step.x, step.y), step.theta)
