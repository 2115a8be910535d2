# SPDX-License-Identifier: Apache-2.0
"""A simulated IMU: specific force and angular velocity of the body, with noise and bias."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cartoloop.arrays import FloatArray
from cartoloop.errors import ConfigError
from cartoloop.simulation.gait import Gait, body_poses, turned_back
from cartoloop.simulation.motion import Motion

GRAVITY = 9.81
"""Gravity [m/s^2]."""

SMOOTHING_S = 0.1
"""Standard deviation of the smoothing of velocities [s]: a body's speed does not jump, as that of
motions along a route does."""


@dataclass(frozen=True, slots=True)
class ImuModel:
    """Errors of an IMU; by default those of a cheap one.

    Attributes
    ----------
    rate : readings a second [Hz].
    gyro_noise : standard deviation of an angular velocity [rad/s].
    gyro_bias : x, y, z [rad/s].
    acceleration_noise : standard deviation of an acceleration [m/s^2].
    acceleration_bias : x, y, z [m/s^2].
    time_offset : time from the stamp of a reading to when it was measured [s].
    """

    rate: float = 200.0
    gyro_noise: float = 0.005
    gyro_bias: tuple[float, float, float] = (0.006, -0.004, 0.01)
    acceleration_noise: float = 0.1
    acceleration_bias: tuple[float, float, float] = (0.03, -0.02, 0.05)
    time_offset: float = 0.0

    def __post_init__(self) -> None:
        if self.rate <= 0.0 or min(self.gyro_noise, self.acceleration_noise) < 0.0:
            raise ConfigError("simulated IMU: the rate must be positive, noise not negative")


def imu_readings(
    motion: Motion, gait: Gait, times: FloatArray, model: ImuModel, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray]:
    """Return accelerations [m/s^2] and angular velocities [rad/s] in the body's frame, (n, 3) each.

    Parameters
    ----------
    motion, gait : of the body.
    times : float64, shape (n,), increasing, each whole steps of `1 / model.rate` after the first
        [s], n > 0.
    model : the errors.
    rng : the source of noise.
    """
    step = 1.0 / model.rate
    padding = max(int(np.ceil(4.0 * SMOOTHING_S / step)), 2)
    measured = np.rint((times - times[0]) * model.rate).astype(np.intp) + padding
    around = (np.arange(measured[-1] + 1 + padding) - padding) * step + times[0] + model.time_offset
    poses = body_poses(motion, gait, around)
    roll, pitch = poses[:, 3], poses[:, 4]
    rates = np.gradient(np.unwrap(poses[:, 2])), np.gradient(roll), np.gradient(pitch)
    yaw_rate, roll_rate, pitch_rate = (rate / step for rate in rates)
    angular = np.column_stack(
        (
            roll_rate - yaw_rate * np.sin(pitch),
            pitch_rate * np.cos(roll) + yaw_rate * np.cos(pitch) * np.sin(roll),
            yaw_rate * np.cos(pitch) * np.cos(roll) - pitch_rate * np.sin(roll),
        )
    )
    force = np.column_stack(
        (
            _acceleration(poses[:, 0], step),
            _acceleration(poses[:, 1], step),
            np.gradient(np.gradient(gait.rise_at(around))) / step**2 + GRAVITY,
        )
    )
    linear = turned_back(poses[:, [3, 4, 2]], force)
    linear = linear[measured] + np.array(model.acceleration_bias)
    angular = angular[measured] + np.array(model.gyro_bias)
    linear += model.acceleration_noise * rng.standard_normal(linear.shape)
    angular += model.gyro_noise * rng.standard_normal(angular.shape)
    return linear, angular


def _acceleration(position: FloatArray, step: float) -> FloatArray:
    """Return the second derivative of positions `step` [s] apart, smoothed."""
    half = int(np.ceil(3.0 * SMOOTHING_S / step))
    weights = np.exp(-0.5 * (np.arange(-half, half + 1) * step / SMOOTHING_S) ** 2)
    velocity = np.gradient(position) / step
    padded = np.pad(velocity, half, mode="edge")
    smooth = np.convolve(padded, weights / weights.sum(), mode="valid")
    acceleration: FloatArray = np.gradient(smooth) / step
    return acceleration
