# SPDX-License-Identifier: Apache-2.0
"""Dense scans have less noise on walls; others stay as they are."""

from __future__ import annotations

import math

import numpy as np
import pytest

from cartoloop.config import SensorConfig
from cartoloop.sensor.events import LaserScan, ScanGeometry
from cartoloop.sensor.range_filter import RangeFilter
from cartoloop.sensor.wall_smoothing import MAX_STEP_RAD, MIN_NOISE_M, range_noise, smoothed

WALL_M, STEP = 2.0, math.radians(0.25)


def scan(step=STEP, noise=0.015, num_beams=401):
    """Return a wall 2 m ahead, and its ranges with noise."""
    angles = step * (np.arange(num_beams) - num_beams // 2)
    true = WALL_M / np.cos(angles)
    return true, true + np.random.default_rng(1).normal(0.0, noise, num_beams)


def test_dense_scans_have_less_noise():
    true, ranges = scan()
    assert np.std(smoothed(ranges, STEP, 0.1, 30.0) - true) < 0.007


def test_beams_may_turn_either_way():
    _, ranges = scan()
    np.testing.assert_array_equal(
        smoothed(ranges, -STEP, 0.1, 30.0), smoothed(ranges, STEP, 0.1, 30.0)
    )


@pytest.mark.parametrize(
    ("step", "noise"), [(1.1 * MAX_STEP_RAD, 0.015), (0.004, 0.5 * MIN_NOISE_M), (0.004, 0.2)]
)
def test_sparse_precise_and_scattered_scans_stay(step, noise):
    _, ranges = scan(step, noise, 301)
    assert smoothed(ranges, step, 0.1, 30.0) is ranges


@pytest.mark.parametrize("is_smoothed", [True, False])
def test_scans_are_smoothed_before_they_are_used(is_smoothed):
    geometry = ScanGeometry(
        angle_min=-200 * STEP, angle_increment=STEP, num_beams=401, range_min=0.1, range_max=30.0
    )
    config = SensorConfig(voxel_filter_size=0.001, smooth_walls=is_smoothed)
    returns = RangeFilter(config).apply(LaserScan(0.0, 0.0, scan()[1], geometry)).returns
    assert (np.std(returns[:, 0] - WALL_M) < 0.007) == is_smoothed


@pytest.mark.parametrize("sigma", [0.005, 0.015, 0.04])
def test_noise_is_measured_on_walls(sigma):
    _, ranges = scan(noise=sigma)
    ranges[::50] = np.inf
    assert range_noise(ranges, 0.1, 30.0) == pytest.approx(sigma, rel=0.2)


def test_noise_of_no_three_neighbours_is_not_known():
    assert math.isnan(range_noise(np.array([1.0, np.nan, 1.0, np.inf]), 0.1, 30.0))
    assert math.isnan(range_noise(np.zeros(0), 0.1, 30.0))
