# SPDX-License-Identifier: Apache-2.0
"""Ranges averaged along walls, against a slow and obvious reference."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cartoloop.kernels.wall_smoothing import (
    MAX_SHIFT,
    MAX_SLOPE,
    second_differences,
    smooth_on_walls,
)

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


@given(st.lists(st.floats(0.0, 40.0) | st.just(math.nan), max_size=20))
def test_second_differences_are_those_of_three_returns(ranges):
    found = second_differences(np.array(ranges, dtype=float), MIN_RANGE, END_RANGE)
    expected = [
        abs(a + c - 2.0 * b)
        for a, b, c in zip(ranges, ranges[1:], ranges[2:], strict=False)
        if is_return(a) and is_return(b) and is_return(c)
    ]
    np.testing.assert_array_equal(found, expected)
