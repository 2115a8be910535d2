# SPDX-License-Identifier: Apache-2.0
"""Ranges averaged along walls, against a slow and obvious reference."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cartoloop.kernels.wall_smoothing import MAX_SHIFT, MAX_SLOPE, range_noise, smooth_on_walls

STEP, MIN_RANGE, END_RANGE = math.radians(0.25), 0.1, 30.0
HALF_LENGTH, MAX_HALF, MIN_RETURNS, MAX_RESIDUAL = 0.1, 10, 5, 0.02


def smooth(ranges):
    return smooth_on_walls(
        np.asarray(ranges, dtype=float), STEP, MIN_RANGE, END_RANGE,
        HALF_LENGTH, MAX_HALF, MIN_RETURNS, MAX_RESIDUAL,
    )  # fmt: skip


def is_return(distance):
    return MIN_RANGE <= distance < END_RANGE


def naive_smooth(ranges):
    smoothed = list(ranges)
    for i, distance in enumerate(ranges):
        if not is_return(distance):
            continue
        half = min(int(HALF_LENGTH / (distance * STEP)), MAX_HALF)
        while 2 * half + 1 >= MIN_RETURNS:
            near = [k for k in range(i - half, i + half + 1) if 0 <= k < len(ranges)]
            near = [k for k in near if is_return(ranges[k])]
            x = np.array([ranges[k] * math.cos((k - i) * STEP) for k in near])
            y = np.array([ranges[k] * math.sin((k - i) * STEP) for k in near])
            if len(near) >= MIN_RETURNS:
                slope, at_beam = np.polyfit(y, x, 1)
                residuals = x - at_beam - slope * y
                limit = MAX_RESIDUAL * math.hypot(1.0, slope)
                rms = math.sqrt((residuals**2).sum() / (len(near) - 2))
                is_near = abs(at_beam - distance) <= MAX_SHIFT * limit
                if abs(slope) <= MAX_SLOPE and rms <= limit and is_near:
                    smoothed[i] = at_beam
                    break
            half //= 2
    return smoothed


def wall(distance=4.0, slope=0.3, num_beams=301):
    """Ranges to a straight wall."""
    angles = STEP * (np.arange(num_beams) - num_beams // 2)
    return distance / (np.cos(angles) - slope * np.sin(angles))


@given(
    st.integers(0, 1000),
    st.floats(0.5, 12.0),
    st.floats(-1.5, 1.5),
    st.floats(0.0, 0.03),
    st.floats(0.0, 0.3),
)
def test_each_range_is_that_of_a_line_through_its_neighbours(seed, distance, slope, noise, missing):
    rng = np.random.default_rng(seed)
    ranges = wall(distance, slope, 61) + rng.normal(0.0, noise, 61)
    ranges[rng.random(61) < missing] = rng.choice([np.nan, np.inf, 0.0, 2.0])
    np.testing.assert_allclose(smooth(ranges), naive_smooth(ranges), atol=1e-6)


@pytest.mark.parametrize("slope", [0.0, 0.5, -2.0])
def test_a_straight_wall_without_noise_stays(slope):
    ranges = wall(3.0, slope, 61)
    np.testing.assert_allclose(smooth(ranges), ranges, atol=1e-9)


def test_noise_on_a_wall_is_less_than_half():
    noise = np.random.default_rng(1).normal(0.0, 0.015, 301)
    assert np.std(smooth(wall() + noise) - wall()) < 0.5 * np.std(noise)


def test_a_step_from_one_wall_to_another_stays():
    ranges = np.where(np.arange(101) < 50, 3.0, 4.0) + np.random.default_rng(2).normal(0, 0.01, 101)
    assert np.abs(smooth(ranges) - ranges).max() < 0.05


def test_ranges_without_a_return_stay():
    ranges = wall()
    ranges[[10, 20, 30]] = np.nan, np.inf, 0.05
    np.testing.assert_array_equal(smooth(ranges)[[10, 20, 30]], ranges[[10, 20, 30]])


@pytest.mark.parametrize("sigma", [0.005, 0.015, 0.04])
def test_noise_is_measured_on_walls(sigma):
    ranges = wall(num_beams=1001) + np.random.default_rng(3).normal(0.0, sigma, 1001)
    ranges[::50] = np.inf
    assert range_noise(ranges, MIN_RANGE, END_RANGE) == pytest.approx(sigma, rel=0.15)


def test_noise_of_no_three_neighbours_is_not_known():
    assert math.isnan(range_noise(np.array([1.0, np.nan, 1.0, np.inf]), MIN_RANGE, END_RANGE))
    assert math.isnan(range_noise(np.zeros(0), MIN_RANGE, END_RANGE))
