# SPDX-License-Identifier: Apache-2.0
"""The velocity without odometry: smoothed for fast scans, followed for slow ones."""

from __future__ import annotations

import math

import numpy as np
import pytest

from cartoloop.config import PredictionConfig
from cartoloop.local_slam.velocity_filter import VelocityFilter
from cartoloop.sensor.pose import IDENTITY, Pose

CONFIG = PredictionConfig(acceleration=1.0, angular_acceleration=3.0)
HORIZON_S, TRANSLATION_NOISE = CONFIG.velocity_horizon, CONFIG.matched_translation_sigma


@pytest.fixture
def velocity():
    return VelocityFilter(CONFIG)


def test_before_two_scans_the_velocity_is_unknown(velocity):
    assert velocity.step(0.1) == IDENTITY
    assert velocity.sigmas(0.1) == (math.inf, math.inf)


def test_first_step_is_taken_as_it_is(velocity):
    velocity.update(Pose(0.2, 0.01, 0.1), 0.5)
    assert velocity.step(0.25) == pytest.approx(Pose(0.1, 0.005, 0.05))


def test_steps_without_duration_are_ignored(velocity):
    velocity.update(Pose(0.2, 0.0, 0.0), 0.0)
    assert velocity.step(0.1) == IDENTITY


@pytest.mark.parametrize("duration", [5e-324, 1e-300, 1e-13])
def test_steps_too_short_for_a_velocity_are_ignored(velocity, duration):
    velocity.update(Pose(0.2, 0.0, 0.0), duration)
    assert velocity.step(0.1) == IDENTITY


def test_velocity_is_extrapolated_for_a_limited_time(velocity):
    velocity.update(Pose(0.1, 0.0, 0.0), 0.1)
    assert velocity.step(3600.0) == pytest.approx(Pose(HORIZON_S, 0.0, 0.0))


def test_noise_of_fast_scans_is_smoothed(velocity):
    rng = np.random.default_rng(1)
    seen, predicted = [], []
    for _ in range(300):
        x = 0.1 + rng.normal(0.0, TRANSLATION_NOISE)
        velocity.update(Pose(x, 0.0, 0.0), 0.1)
        seen.append(x)
        predicted.append(velocity.step(0.1).x)
    assert np.std(predicted[20:]) < 0.6 * np.std(seen[20:])
    assert np.mean(predicted[20:]) == pytest.approx(0.1, abs=0.005)


def test_slow_scans_are_followed(velocity):
    velocity.update(Pose(0.5, 0.0, 0.0), 0.5)
    velocity.update(Pose(0.1, 0.0, 0.0), 0.5)
    assert velocity.step(0.5).x == pytest.approx(0.1, abs=0.02)


def test_uncertainty_grows_with_the_time_between_scans(velocity):
    for _ in range(20):
        velocity.update(Pose(0.1, 0.0, 0.0), 0.1)
    sigmas = [velocity.sigmas(ahead) for ahead in (0.1, 0.2, 0.5)]
    assert sigmas == sorted(sigmas)
    assert TRANSLATION_NOISE < sigmas[0][0] < 0.03
    assert sigmas[2][0] > 0.2


def test_sigma_equals_the_error_of_the_prediction():
    rng = np.random.default_rng(2)
    duration, acceleration = 0.1, CONFIG.acceleration
    velocity = VelocityFilter(CONFIG)
    true_velocity, last_noise, errors = 1.0, 0.0, []
    for _ in range(4000):
        noise = rng.normal(0.0, TRANSLATION_NOISE)
        velocity.update(Pose(true_velocity * duration + noise - last_noise, 0.0, 0.0), duration)
        last_noise = noise
        true_velocity += rng.normal(0.0, acceleration * duration)
        errors.append(velocity.step(duration).x - true_velocity * duration + noise)
    assert np.std(errors) == pytest.approx(velocity.sigmas(duration)[0], rel=0.35)


def test_another_velocity_is_taken_and_the_turn_is_kept(velocity):
    for _ in range(20):
        velocity.update(Pose(0.0, 0.0, 0.02), 0.1)
    velocity.resume(0.5, -0.1)
    assert velocity.step(1.0) == pytest.approx(Pose(0.5, -0.1, 0.2), abs=1e-3)
