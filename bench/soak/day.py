# SPDX-License-Identifier: Apache-2.0
"""The day of a robot: it drives around a ring of corridors, stands, drives back, and so on."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from cartoloop.sensor.events import LaserScan, Odometry, SensorEvent
from cartoloop.simulation import ring, simulate

STANDS_S = 1800.0
"""Time between two drives [s]."""

DRIVE_S = 60.0
"""Time of a drive as simulated [s]."""

PERIOD_S = 0.2
"""Between two scans [s]."""

_NOISE_M = 0.01


def day(
    end_s: float, numbers: np.random.Generator, *, drives_again: bool = True
) -> Iterator[tuple[float, SensorEvent]]:
    """Yield events with their times [s], up to `end_s`; wheels that stand are reported, too.

    Parameters
    ----------
    numbers : the noise of the scans while the robot stands.
    drives_again : whether it goes on driving after its first stop.
    """
    there = list(simulate(ring(), seed=1, duration=DRIVE_S).events())
    time_s = 0.0
    while time_s < end_s:
        for event in there:
            time_s += PERIOD_S if isinstance(event, LaserScan) else 0.0
            if time_s >= end_s:
                return
            yield time_s, event
        last = next(event for event in reversed(there) if isinstance(event, LaserScan))
        wheels = next(event for event in reversed(there) if isinstance(event, Odometry))
        stands_s = min(STANDS_S if drives_again else end_s, max(end_s - time_s, 0.0))
        for _ in range(round(stands_s / PERIOD_S)):
            time_s += PERIOD_S
            yield time_s, Odometry(time_s, time_s, wheels.tf_odom_tracking)
            ranges = last.ranges + numbers.normal(0.0, _NOISE_M, len(last.ranges))
            yield time_s, LaserScan(time_s, time_s, np.maximum(ranges, 0.05), last.geometry)
        there.reverse()
