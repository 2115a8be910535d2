# SPDX-License-Identifier: Apache-2.0
"""Simulated wheel odometry: wrong in scale, drifting with the motion, slipping now and then."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cartoloop.arrays import FloatArray
from cartoloop.errors import ConfigError
from cartoloop.sensor.pose import compose_all, relative_all, wrap_angles
from cartoloop.simulation.motion import Motion


@dataclass(frozen=True, slots=True)
class OdometryModel:
    """Errors of wheel odometry. Noise is a random walk: its variance grows with the motion.

    Attributes
    ----------
    translation_scale, rotation_scale : measured over true motion; 1.05 measures 5% too much.
    translation_noise : of the distance, for each square root of a metre driven [m / sqrt(m)].
    rotation_noise : of the heading, for each square root of a radian turned [rad / sqrt(rad)].
    drift_noise : of the heading, for each square root of a metre driven [rad / sqrt(m)].
    slips_per_metre : how often a wheel slips [1/m].
    slip_angle : standard deviation of the heading's jump when it does [rad].
    skids_per_metre : how often both wheels slip, and the measured path is too long [1/m].
    skid_length : mean excess length of a skid [m].
    time_offset : the odometry pose stored with a scan is this much newer than the scan [s].
    """

    translation_scale: float = 1.01
    rotation_scale: float = 0.98
    translation_noise: float = 0.01
    rotation_noise: float = 0.01
    drift_noise: float = 0.004
    slips_per_metre: float = 0.02
    slip_angle: float = 0.03
    skids_per_metre: float = 0.0
    skid_length: float = 0.1
    time_offset: float = 0.0

    def __post_init__(self) -> None:
        sizes = (self.translation_noise, self.rotation_noise, self.drift_noise, self.slip_angle)
        skids = (self.skids_per_metre, self.skid_length)
        if (
            min(*sizes, *skids, self.slips_per_metre, self.translation_scale, self.rotation_scale)
            < 0.0
        ):
            raise ConfigError("simulated odometry: scales, noise and slip must not be negative")


PERFECT_ODOMETRY = OdometryModel(
    translation_scale=1.0,
    rotation_scale=1.0,
    translation_noise=0.0,
    rotation_noise=0.0,
    drift_noise=0.0,
    slips_per_metre=0.0,
)


def odometry_poses(
    motion: Motion, times: FloatArray, model: OdometryModel, rng: np.random.Generator
) -> FloatArray:
    """Return the poses that the odometry measures.

    Parameters
    ----------
    motion : the true motion.
    times : float64, shape (n,) [s], increasing, n > 0.
    model : the errors.
    rng : the source of noise.

    Returns
    -------
    float64, shape (n, 3), x [m], y [m], theta [rad] in the odometry's frame, whose origin is the
    robot's true pose at the first time.
    """
    read_at = np.concatenate((times[:1], times + model.time_offset))
    truth = motion.poses_at(read_at)
    steps = relative_all(truth[:-1], truth[1:])
    distance, turned = np.hypot(steps[:, 0], steps[:, 1]), np.abs(steps[:, 2])

    stretch = model.translation_scale * distance
    stretch += rng.normal(size=len(steps)) * model.translation_noise * np.sqrt(distance)
    moving = distance > 0.0
    steps[moving, :2] *= (stretch[moving] / distance[moving])[:, None]
    steps[:, 2] *= model.rotation_scale
    steps[:, 2] += rng.normal(size=len(steps)) * np.sqrt(
        model.rotation_noise**2 * turned + model.drift_noise**2 * distance
    )
    slips = rng.poisson(model.slips_per_metre * distance)
    steps[:, 2] += rng.normal(size=len(steps)) * model.slip_angle * np.sqrt(slips)

    if model.skids_per_metre > 0.0:
        skids = rng.poisson(model.skids_per_metre * distance)
        steps[:, 0] += skids * rng.exponential(model.skid_length, len(steps))

    headings = np.concatenate(([0.0], np.cumsum(steps[:, 2])))
    origin_turned = np.column_stack((np.zeros((len(steps), 2)), headings[:-1]))
    positions = np.cumsum(compose_all(origin_turned, steps)[:, :2], axis=0)
    return np.column_stack((positions, wrap_angles(headings[1:])))
