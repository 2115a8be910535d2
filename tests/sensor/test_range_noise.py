# SPDX-License-Identifier: Apache-2.0
"""Noise that grows with the range limits the range of a scanner."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cartoloop.config import SensorConfig
from cartoloop.sensor.events import LaserScan, ScanGeometry
from cartoloop.sensor.range_filter import RangeFilter
from cartoloop.sensor.range_noise import MAX_NOISE_M, RangeNoise, noise_shares

STEP = math.radians(1.0)
ANGLES = STEP * np.arange(-90, 91)
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


def useful_range(ranges, deviation, seed=3):
    """What is found after some time in a place."""
    rng = np.random.default_rng(seed)
    noise = RangeNoise(STEP)
    for _ in range(2000):
        noise.add(ranges + deviation * rng.normal(size=len(ranges)), 0.1, 20.0)
    return noise.useful_range


@pytest.mark.parametrize("share", [0.015, 0.02, 0.03])
def test_noise_that_grows_with_the_range_limits_it(share):
    limit = useful_range(room(), share * room())
    assert limit == pytest.approx(MAX_NOISE_M / share, rel=0.15)


@pytest.mark.parametrize("deviation", [0.0, 0.01, 0.03])
def test_noise_that_is_the_same_at_all_ranges_limits_nothing(deviation):
    assert useful_range(room(), deviation) == math.inf


def test_a_small_room_shows_nothing():
    ranges = room(width=2.0, length=4.0)
    assert useful_range(ranges, 0.03 * ranges) == math.inf


@settings(max_examples=50)
@given(st.floats(0.5, 20.0), st.floats(-1.2, 1.2), st.floats(0.001, 0.1))
def test_a_straight_wall_has_no_noise_at_any_distance_and_slant(distance, normal, step):
    angles = normal + np.linspace(-0.5, 0.5, 21) * min(1.0, 20.0 * step)
    spacing = float(angles[1] - angles[0])
    _, shares = noise_shares(distance / np.cos(angles - normal), spacing)
    assert np.abs(shares).max(initial=0.0) < 1e-9


def test_edges_and_missing_returns_are_left_out():
    ranges = np.array([2.0, 2.0, np.nan, 2.0, 2.0, 2.0, 5.0, 5.0, 5.0, 5.0])
    middle, _ = noise_shares(ranges, STEP)
    np.testing.assert_array_equal(middle, [2.0, 5.0, 5.0])


def test_returns_beyond_the_useful_range_are_misses():
    rng = np.random.default_rng(4)
    range_filter = RangeFilter(SensorConfig())
    for time in np.arange(2000.0):
        ranges = room() * (1.0 + 0.03 * rng.normal(size=len(ANGLES)))
        data = range_filter.apply(LaserScan(time, time, ranges, GEOMETRY))
    farthest = np.linalg.norm(data.returns, axis=1).max()
    assert 3.0 < farthest < 1.2 * MAX_NOISE_M / 0.03
    assert len(data.misses) > 0
    assert range_filter.useful_ranges == {"": pytest.approx(farthest, abs=0.2)}
    assert data.noise_share == pytest.approx(0.03, rel=0.15)


def test_a_range_that_is_configured_is_not_limited():
    rng = np.random.default_rng(4)
    range_filter = RangeFilter(SensorConfig(max_range=15.0))
    for time in np.arange(2000.0):
        ranges = room() * (1.0 + 0.03 * rng.normal(size=len(ANGLES)))
        data = range_filter.apply(LaserScan(time, time, ranges, GEOMETRY))
    assert np.linalg.norm(data.returns, axis=1).max() > 5.5
    assert range_filter.useful_ranges == {}
    assert data.noise_share == 0.0


def test_ranges_of_zero_are_no_error():
    noise = RangeNoise(STEP)
    with np.errstate(all="raise"):
        for _ in range(10):
            noise.add(np.zeros(len(ANGLES)), 0.0, 20.0)
    assert noise.useful_range == math.inf
