# SPDX-License-Identifier: Apache-2.0
"""People who walk around the robot for the whole recording."""

from __future__ import annotations

import numpy as np

from bench.robustness.carmen_text import CarmenText
from bench.robustness.log_changes import Apply

BODY_M, CLOTHES_M = 0.4, 0.05
"""Width of a person, and standard deviation of the ranges to one [m]."""

NEAREST_M, FARTHEST_M, SWAY_M = 1.0, 3.0, 0.5
"""Mean distance of a person from the robot, and how far each comes nearer and goes away [m]."""

WIDEST_RAD, SLOWEST, FASTEST, SWAY_RATE = 1.5, 0.1, 0.5, 0.3
"""Bearing to both sides up to which people walk [rad], and how fast they turn back [rad/s]."""


def people(count: int) -> Apply:
    """Return the change that puts people between the robot and some of the walls.

    Parameters
    ----------
    count : of people; each hides some beams, one after the other.
    """

    def apply(log: CarmenText, rng: np.random.Generator) -> None:
        seconds = log.times - log.times[0]
        phases, rates = rng.uniform(0.0, 2.0 * np.pi, count), rng.uniform(SLOWEST, FASTEST, count)
        distances = rng.uniform(NEAREST_M, FARTHEST_M, count)
        first, step = log.angles or (-np.pi / 2.0, np.pi / log.num_beams)
        bearings = first + step * np.arange(log.num_beams)
        for row, ranges in enumerate(log.ranges):
            if ranges is None or len(ranges) != len(bearings):
                continue
            towards = WIDEST_RAD * np.sin(rates * seconds[row] + phases)
            away = distances + SWAY_M * np.sin(SWAY_RATE * seconds[row] + np.arange(count))
            for bearing, distance in zip(towards.tolist(), away.tolist(), strict=True):
                hidden = np.abs(bearings - bearing) < 0.5 * BODY_M / distance
                seen = distance + rng.normal(0.0, CLOTHES_M, np.count_nonzero(hidden))
                ranges[hidden] = np.minimum(ranges[hidden], seen)

    return apply
