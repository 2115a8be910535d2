# SPDX-License-Identifier: Apache-2.0
"""The velocity of a robot without odometry, estimated from its matched poses."""

from __future__ import annotations

import math
from dataclasses import dataclass

from cartoloop.config import PredictionConfig
from cartoloop.sensor.pose import IDENTITY, Pose

_SHORTEST_STEP_S = 1e-12
"""A step in a shorter time shows nothing of the velocity, and has no finite variance [s]."""


@dataclass(slots=True)
class _Rate:
    """The variance of one component of the velocity: a random walk measured with noise."""

    acceleration: float
    noise: float
    variance: float = math.inf

    def gain(self, duration: float) -> float:
        """Return the Kalman gain of a new measurement, and update the variance."""
        drift = (self.acceleration * duration) ** 2
        measured = 2.0 * (self.noise / duration) ** 2
        predicted = self.variance + drift
        gain = 1.0 if math.isinf(predicted) else predicted / (predicted + measured)
        self.variance = measured if math.isinf(predicted) else (1.0 - gain) * predicted
        return gain

    def sigma(self, ahead: float) -> float:
        """Return the standard deviation of the position after a time `ahead` [s]."""
        if math.isinf(self.variance):
            return math.inf
        variance = self.variance + (self.acceleration * ahead) ** 2
        return math.sqrt(variance * ahead**2 + self.noise**2)


class VelocityFilter:
    """A Kalman filter of the velocity in the robot's own frame.

    Where scans come fast, the difference of two matches is noisy, and matches in a corridor, which
    hardly determine the position along it, would soon reduce the velocity to zero. Where scans
    come slowly, the velocity changes between them. The gain follows from the robot's accelerations
    and the rate of the scans.
    """

    def __init__(self, config: PredictionConfig) -> None:
        self._horizon = config.velocity_horizon
        self._velocity = IDENTITY
        self._linear = _Rate(config.acceleration, config.matched_translation_sigma)
        self._angular = _Rate(config.angular_acceleration, config.matched_rotation_sigma)

    def update(self, step: Pose, duration: float) -> None:
        """Add a step between two scans, in the frame of the first, and its duration [s]."""
        if duration < _SHORTEST_STEP_S:
            return
        linear, angular = self._linear.gain(duration), self._angular.gain(duration)
        x, y, theta = self._velocity
        moved_x, moved_y, turned = step
        self._velocity = Pose(
            x + linear * (moved_x / duration - x),
            y + linear * (moved_y / duration - y),
            theta + angular * (turned / duration - theta),
        )

    def resume(self, x: float, y: float) -> None:
        """Take another linear velocity [m/s], which the latest steps have not shown."""
        self._velocity = Pose(x, y, self._velocity.theta)

    def step(self, duration: float) -> Pose:
        """Return the step in a time [s] at constant velocity, then at rest."""
        ahead = min(duration, self._horizon)
        x, y, theta = self._velocity
        return Pose(ahead * x, ahead * y, ahead * theta)

    def sigmas(self, duration: float) -> tuple[float, float]:
        """Return the standard deviations of that step [m], [rad]; inf before two scans."""
        return self._linear.sigma(duration), self._angular.sigma(duration)
