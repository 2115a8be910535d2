# SPDX-License-Identifier: Apache-2.0
"""The velocity of a robot without odometry, from where its scans were matched."""

from __future__ import annotations

import math
from dataclasses import dataclass

from cartoloop.sensor.pose import IDENTITY, Pose

HORIZON_S = 1.0
"""A velocity is held for so long at the most; then the robot is taken to stand."""

TRANSLATION_NOISE = 0.015
"""Standard deviation of a matched step [m]: some tenths of a pixel, whatever the step."""

ROTATION_NOISE = 0.003
"""The same of its angle [rad]."""


@dataclass(slots=True)
class _Rate:
    """One part of the velocity and its variance: a random walk that is measured with noise."""

    variance: float = math.inf

    def gain(self, acceleration: float, noise: float, duration: float) -> float:
        """Return the weight of a new measurement (Kalman), and take in what it tells."""
        drift = (acceleration * duration) ** 2
        measured = 2.0 * (noise / duration) ** 2
        predicted = self.variance + drift
        gain = 1.0 if math.isinf(predicted) else predicted / (predicted + measured)
        self.variance = measured if math.isinf(predicted) else (1.0 - gain) * predicted
        return gain

    def sigma(self, acceleration: float, noise: float, ahead: float) -> float:
        """Return how far off the robot may be after a while."""
        if math.isinf(self.variance):
            return math.inf
        return math.sqrt((self.variance + (acceleration * ahead) ** 2) * ahead**2 + noise**2)


class VelocityFilter:
    """Keeps the velocity in the robot's own frame, and how far it can be trusted.

    Where scans come fast, the noise of two matches makes a poor velocity, and one that the matches
    of a corridor, which tell little of the way along it, would soon pull to nought; where scans
    come slowly, the velocity changes between them. What counts follows from the robot's
    accelerations and the scans' rate.

    Parameters
    ----------
    acceleration : typical change of the velocity [m/s^2].
    angular_acceleration : the same of the angular velocity [rad/s^2].
    """

    def __init__(self, acceleration: float, angular_acceleration: float) -> None:
        self._acceleration = acceleration
        self._angular_acceleration = angular_acceleration
        self._velocity = IDENTITY
        self._linear = _Rate()
        self._angular = _Rate()

    def update(self, step: Pose, duration: float) -> None:
        """Take in a step between two scans, in the frame of the first, and its duration [s]."""
        if duration <= 0.0:
            return
        linear = self._linear.gain(self._acceleration, TRANSLATION_NOISE, duration)
        angular = self._angular.gain(self._angular_acceleration, ROTATION_NOISE, duration)
        x, y, theta = self._velocity
        self._velocity = Pose(
            x + linear * (step.x / duration - x),
            y + linear * (step.y / duration - y),
            theta + angular * (step.theta / duration - theta),
        )

    def step(self, duration: float) -> Pose:
        """Return the step that the robot makes in a time [s] if it goes on as it does."""
        ahead = min(duration, HORIZON_S)
        x, y, theta = self._velocity
        return Pose(ahead * x, ahead * y, ahead * theta)

    def sigmas(self, duration: float) -> tuple[float, float]:
        """Return how far that step may be off: distance [m] and angle [rad]."""
        return (
            self._linear.sigma(self._acceleration, TRANSLATION_NOISE, duration),
            self._angular.sigma(self._angular_acceleration, ROTATION_NOISE, duration),
        )
