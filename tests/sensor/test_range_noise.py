# SPDX-License-Identifier: Apache-2.0
"""The noise of a scanner, as the walls around it show it, and how it limits the range."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cartoloop.config import SensorConfig
from cartoloop.sensor.events import LaserScan, ScanGeometry
from cartoloop.sensor.range_filter import RangeFilter
from cartoloop.sensor.range_noise import (
    ESTIMATED_AFTER,
    EVERY_NTH_SCAN,
    MAX_NOISE_M,
    NO_NOISE,
    WINDOW,
    Noise,
    RangeNoise,
    wall_residuals,
)

STEP = math.radians(1.0)
ANGLES = STEP * np.arange(-90, 91)
ENOUGH_SCANS = ESTIMATED_AFTER[-1] * EVERY_NTH_SCAN
GEOMETRY = ScanGeometry(
    angle_min=float(ANGLES[0]),
    angle_increment=STEP,
    num_beams=len(ANGLES),
    range_min=0.1,
    range_max=20.0,
)


def room(width=3.0, length=12.0):
    """Ranges in the corner of a room: the walls beside and in front are straight."""
    with np.errstate(divide="ignore"):
        return np.minimum(0.5 * width / np.abs(np.sin(ANGLES)), 0.5 * length / np.cos(ANGLES))


def measured(ranges, deviation, num_scans=ENOUGH_SCANS, seed=3):
    """What is found after some time in a place."""
    rng = np.random.default_rng(seed)
    noise = RangeNoise(STEP)
    for _ in range(num_scans):
        noise.add(ranges + deviation * rng.normal(size=len(ranges)), 0.1, 20.0)
    return noise


@pytest.mark.parametrize("share", [0.015, 0.02, 0.03])
@pytest.mark.parametrize("constant", [0.0, 0.02])
def test_noise_that_grows_with_the_range_limits_it(share, constant):
    found = measured(room(), np.hypot(constant, share * room()))
    limit = math.sqrt(MAX_NOISE_M**2 - constant**2) / share
    assert found.useful_range == pytest.approx(limit, rel=0.1)
    for distance in (2.0, 5.0):
        expected = math.hypot(constant, share * distance)
        assert found.noise.at(distance) == pytest.approx(expected, rel=0.1)


@pytest.mark.parametrize("width", [3.0, 20.0])
@pytest.mark.parametrize("constant", [0.02, 0.04])
def test_noise_that_is_the_same_at_all_ranges_limits_nothing(constant, width):
    found = measured(room(width), constant)
    assert found.useful_range == math.inf
    assert found.noise.at(3.0) == pytest.approx(constant, rel=0.1)


@pytest.mark.parametrize("deviation", [0.0, 0.005, 0.01])
def test_a_good_scanner_has_no_noise_that_matters(deviation):
    found = measured(room(), deviation)
    assert found.noise == NO_NOISE
    assert found.useful_range == math.inf


def test_things_that_stand_about_are_no_noise():
    rng = np.random.default_rng(5)
    noise = RangeNoise(STEP)
    for _ in range(ENOUGH_SCANS):
        things = (rng.random(len(ANGLES)) < 0.05) * rng.uniform(0.05, 0.4, len(ANGLES))
        noise.add(room() - things + 0.005 * rng.normal(size=len(ANGLES)), 0.1, 20.0)
    assert noise.noise == NO_NOISE


def test_where_there_are_no_walls_there_is_no_noise():
    rng = np.random.default_rng(5)
    noise = RangeNoise(STEP)
    for _ in range(ENOUGH_SCANS):
        noise.add(room() * rng.uniform(0.7, 1.0, len(ANGLES)), 0.1, 20.0)
    assert noise.noise == NO_NOISE
    assert noise.useful_range == math.inf


def test_a_small_room_shows_no_limit():
    ranges = room(width=1.5, length=3.0)
    assert measured(ranges, 0.02).useful_range == math.inf


def test_noise_is_known_soon_and_no_longer_changes_once_it_is():
    early = measured(room(), 0.03, num_scans=ESTIMATED_AFTER[0])
    assert early.noise.at(2.0) == pytest.approx(0.03, rel=0.2)
    late = measured(room(), 0.03)
    known = late.noise
    for _ in range(ENOUGH_SCANS):
        late.add(room(), 0.1, 20.0)
    assert late.noise == known


@settings(max_examples=50)
@given(st.floats(0.5, 20.0), st.floats(-0.5, 0.5), st.floats(0.001, 0.1))
def test_a_straight_wall_has_no_noise_at_any_distance_and_slant(distance, normal, step):
    angles = normal + np.linspace(-0.5, 0.5, 21) * min(1.0, 20.0 * step)
    spacing = float(angles[1] - angles[0])
    middle, variances = wall_residuals(distance / np.cos(angles - normal), spacing)
    assert len(middle) > 0
    assert np.sqrt(variances).max() < 1e-9


def test_the_mean_squared_residual_is_the_variance():
    rng = np.random.default_rng(6)
    variances = [
        wall_residuals(2.0 / np.cos(ANGLES) + 0.03 * rng.normal(size=len(ANGLES)), STEP)[1]
        for _ in range(200)
    ]
    assert math.sqrt(np.concatenate(variances).mean()) == pytest.approx(0.03, rel=0.03)


def test_edges_and_missing_returns_are_left_out():
    ranges = np.full(3 * WINDOW + 1, 2.0)
    ranges[WINDOW] = np.nan
    ranges[WINDOW + 1 : 2 * WINDOW] = 5.0
    middle, _ = wall_residuals(ranges, STEP)
    np.testing.assert_array_equal(middle, np.full(3, 2.0))


def test_scans_with_few_beams_show_nothing():
    middle, variances = wall_residuals(np.full(WINDOW - 1, 2.0), STEP)
    assert len(middle) == len(variances) == 0


def test_returns_beyond_the_useful_range_are_misses():
    rng = np.random.default_rng(4)
    range_filter = RangeFilter(SensorConfig())
    for time in np.arange(float(ENOUGH_SCANS)):
        ranges = room() * (1.0 + 0.03 * rng.normal(size=len(ANGLES)))
        data = range_filter.apply(LaserScan(time, time, ranges, GEOMETRY))
    farthest = np.linalg.norm(data.returns, axis=1).max()
    assert 3.0 < farthest < 1.2 * MAX_NOISE_M / 0.03
    assert len(data.misses) > 0
    assert range_filter.useful_ranges == {"": pytest.approx(farthest, abs=0.2)}
    assert data.noise.at(4.0) == pytest.approx(0.12, rel=0.1)


def test_a_range_that_is_configured_is_not_limited():
    rng = np.random.default_rng(4)
    range_filter = RangeFilter(SensorConfig(max_range=15.0))
    for time in np.arange(float(ENOUGH_SCANS)):
        ranges = room() * (1.0 + 0.03 * rng.normal(size=len(ANGLES)))
        data = range_filter.apply(LaserScan(time, time, ranges, GEOMETRY))
    assert np.linalg.norm(data.returns, axis=1).max() > 5.5
    assert range_filter.useful_ranges == {}
    assert data.noise.at(4.0) == pytest.approx(0.12, rel=0.1)


def test_ranges_of_zero_are_no_error():
    noise = RangeNoise(STEP)
    with np.errstate(all="raise"):
        for _ in range(10):
            noise.add(np.zeros(len(ANGLES)), 0.0, 20.0)
    assert noise.noise == Noise()
