# SPDX-License-Identifier: Apache-2.0
import math

import numpy as np
import pytest

from cartoloop.sensor.events import LaserScan, ScanGeometry
from cartoloop.sensor.no_return import find_no_return
from cartoloop.sensor.sensor_profile import (
    estimate_range_noise,
    find_range_quantum,
    profile_sensor,
)

DEGREE = math.radians(1.0)
SICK = ScanGeometry(-math.pi / 2, DEGREE, 180, 0.0, math.inf)


def hall(x, y, theta, width=20.0, depth=12.0, geometry=SICK):
    """Exact ranges to the walls of a rectangular hall."""
    angles = geometry.angles + theta
    with np.errstate(divide="ignore"):
        across = np.where(np.cos(angles) > 0, width - x, x) / np.abs(np.cos(angles))
        along = np.where(np.sin(angles) > 0, depth - y, y) / np.abs(np.sin(angles))
    return np.minimum(across, along)


def drive(num=60, seed=0):
    """Poses of a robot that drives across a hall and turns."""
    t = np.linspace(0.0, 1.0, num)
    return np.column_stack((3.0 + 14.0 * t, 4.0 + 3.0 * np.sin(5.0 * t), 6.0 * t + seed))


def scans(ranges, geometry=SICK, period=0.2):
    return [
        LaserScan(period * i, period * i, np.asarray(row, dtype=float), geometry)
        for i, row in enumerate(ranges)
    ]


def driven(no_return=None, limit=math.inf, jitter=0.0):
    rng = np.random.default_rng(2)
    ranges = np.array([hall(*pose) for pose in drive()]) + rng.normal(0.0, 0.01, (60, 180))
    if no_return is not None:
        shown = no_return + rng.uniform(-jitter, jitter, ranges.shape)
        ranges = np.where(ranges >= limit, shown, ranges)
    return ranges


@pytest.mark.parametrize("no_return", [81.91, 81.83, 50.0])
def test_a_pile_up_at_the_top_is_the_no_return_value(no_return):
    profile = profile_sensor(scans(driven(no_return, limit=9.0).round(2)))
    assert profile.no_return == pytest.approx(no_return)
    assert 0.97 * no_return < profile.range_max < no_return
    assert profile.share_no_return == pytest.approx(np.mean(driven() >= 9.0), abs=0.02)


def test_the_range_limit_is_below_a_jittering_no_return():
    profile = profile_sensor(scans(driven(51.06, limit=9.0, jitter=0.06).round(2)))
    assert profile.no_return == pytest.approx(51.06, abs=0.07)
    assert 50.0 < profile.range_max < 51.0


def test_a_scanner_that_clips_at_its_maximum_is_recognized():
    profile = profile_sensor(scans(np.minimum(driven(), 8.0)))
    assert profile.no_return == pytest.approx(8.0)
    assert 7.9 < profile.range_max < 8.0


def test_no_returns_that_are_rare_are_found():
    ranges = driven()
    ranges[5::5, 60] = 81.91
    assert profile_sensor(scans(ranges)).no_return == 81.91


def test_infinity_and_zero_can_stand_for_no_return():
    infinite = profile_sensor(scans(driven(math.inf, limit=9.0)))
    assert (infinite.no_return, infinite.range_max) == (math.inf, math.inf)
    zero = profile_sensor(scans(driven(0.0, limit=9.0)))
    assert (zero.no_return, zero.range_max) == (0.0, math.inf)
    assert zero.range_min >= 0.05


def test_walls_of_a_hall_are_not_a_no_return_value():
    profile = profile_sensor(scans(driven().round(2)))
    assert profile.no_return is None
    assert profile.range_max == math.inf
    assert "none seen" in profile.describe()


@pytest.mark.parametrize("theta", [0.0, 0.5, 1.5])
def test_a_long_wall_before_a_robot_at_rest_is_a_wall(theta):
    rng = np.random.default_rng(1)
    still = hall(2.0, 6.0, theta, width=42.0, depth=12.0)
    ranges = (still + rng.normal(0.0, 0.01, (100, 180))).round(2)
    assert find_no_return(ranges, DEGREE).value is None


def test_a_far_wall_behind_a_door_is_a_wall():
    near = np.minimum(hall(2.0, 6.0, 0.0), 6.0 + 0.2 * np.sin(np.arange(180)))
    near[85:95] = 14.0
    ranges = near + np.random.default_rng(1).normal(0.0, 0.005, (100, 180))
    assert find_no_return(ranges, DEGREE).value is None


def test_no_returns_of_a_robot_at_rest_are_recognized():
    still = hall(2.0, 6.0, 0.0)
    arc = np.tile(np.where(still > 11.0, 12.5, still), (50, 1))
    assert find_no_return(arc, DEGREE).value == 12.5
    few = np.tile(still, (50, 1))
    few[:, 3] = 81.91
    assert find_no_return(few, DEGREE).value == 81.91


@pytest.mark.parametrize("value", [81.91, 30.0])
def test_without_returns_there_is_no_measurement(value):
    profile = profile_sensor(scans(np.full((3, 180), value)))
    assert (profile.no_return, profile.share_no_return) == (value, 1.0)
    assert profile.range_noise == 0.0


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, 0.0, -3.0, 1e300])
def test_scans_without_any_measurement_can_be_profiled(value):
    profile = profile_sensor(scans(np.full((3, 180), value)))
    assert profile.num_beams == 180
    assert profile.range_quantum == 0.0
    assert profile.describe()


def test_one_scan_is_enough_and_none_is_not():
    profile = profile_sensor(scans([hall(3.0, 4.0, 0.0)]))
    assert (profile.num_scans, profile.rate) == (1, 0.0)
    with pytest.raises(ValueError, match="at least one scan"):
        profile_sensor([])


def test_beams_are_counted_and_measured():
    profile = profile_sensor(scans(driven(), period=0.25), has_odometry=True)
    assert profile.num_beams == 180
    assert profile.field_of_view == pytest.approx(math.radians(179.0))
    assert profile.angular_resolution == pytest.approx(DEGREE)
    assert profile.rate == pytest.approx(4.0)
    assert (profile.has_odometry, profile.has_imu) == (True, False)
    assert "180 over 179 deg, one each 1 deg" in profile.describe()
    assert "also has   odometry" in profile.describe()


def test_clockwise_scanners_have_a_positive_resolution():
    clockwise = ScanGeometry(math.pi / 2, -DEGREE, 180, 0.0, math.inf)
    assert profile_sensor(scans(driven(), clockwise)).angular_resolution == pytest.approx(DEGREE)


def test_the_most_frequent_beam_count_is_the_profiles():
    odd = ScanGeometry(0.0, DEGREE, 90, 0.0, math.inf)
    mixed = scans(driven()) + scans(np.ones((5, 90)), odd)
    assert profile_sensor(mixed).num_beams == 180


@pytest.mark.parametrize("quantum", [0.1, 0.05, 0.01, 0.001])
def test_the_step_of_the_ranges_is_found(quantum):
    ranges = np.random.default_rng(0).uniform(0.3, 30.0, 2000)
    assert find_range_quantum(np.round(ranges / quantum) * quantum) == quantum
    assert find_range_quantum(ranges) == 0.0


@pytest.mark.parametrize("sigma", [0.003, 0.01, 0.03])
@pytest.mark.parametrize("quantum", [0.0, 0.01])
def test_noise_is_measured_at_rest(sigma, quantum):
    rng = np.random.default_rng(7)
    exact = np.repeat([hall(*pose) for pose in drive(40)], 3, axis=0)
    ranges = exact + rng.normal(0.0, sigma, exact.shape)
    ranges[rng.random(ranges.shape) < 0.02] = 4.2  # people walk by
    if quantum:
        ranges = np.round(ranges / quantum) * quantum
    expected = math.hypot(sigma, quantum / math.sqrt(12.0))
    # The spread of what is near the median misses the tails of coarse steps.
    found = estimate_range_noise(ranges, math.inf, quantum)
    assert found == pytest.approx(expected, rel=0.35)


def test_noise_without_rest_is_measured_along_the_beams():
    rng = np.random.default_rng(7)
    ranges = driven() + rng.normal(0.0, 0.02, (60, 180))
    assert estimate_range_noise(ranges, math.inf, 0.0) == pytest.approx(0.022, rel=0.4)


def test_a_profile_narrows_a_geometry_but_never_widens_it():
    profile = profile_sensor(scans(driven(81.91, limit=9.0)))
    applied = profile.apply(SICK)
    assert applied.range_max == profile.range_max
    assert applied.range_min == profile.range_min > 0.0
    assert (applied.num_beams, applied.angle_min) == (180, SICK.angle_min)
    tighter = ScanGeometry(0.0, DEGREE, 180, 0.5, 8.0)
    assert (profile.apply(tighter).range_min, profile.apply(tighter).range_max) == (0.5, 8.0)
