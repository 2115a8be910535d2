# SPDX-License-Identifier: Apache-2.0
"""From a raw scan to range data: cropped, thinned, in the tracking frame."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from cartoloop.config import AdaptiveVoxelFilterConfig, SensorConfig
from cartoloop.sensor.events import CloudGeometry, LaserScan, PointCloud, ScanGeometry
from cartoloop.sensor.pose import Pose
from cartoloop.sensor.range_filter import RangeFilter, thin
from cartoloop.sensor.sweep_motion import AT_REST, SweepMotion

USEFUL_RANGE = SensorConfig().default_max_range

QUARTER_TURNS = ScanGeometry(
    angle_min=-math.pi / 2,
    angle_increment=math.pi / 2,
    num_beams=3,
    range_min=0.2,
    range_max=20.0,
)


def filtered(ranges, geometry=QUARTER_TURNS, **config):
    scan = LaserScan(0.0, 0.0, np.array(ranges, dtype=np.float64), geometry)
    config = {"missing_data_agreement_deg": 0.0} | config
    return RangeFilter(SensorConfig(**config)).apply(scan)


def assert_points(points, expected):
    assert points == pytest.approx(np.array(expected).reshape(-1, 2), abs=1e-12)


def test_beams_are_counter_clockwise_from_the_first_angle():
    data = filtered([1.0, 2.0, 3.0])
    assert_points(data.returns, [(0.0, -1.0), (2.0, 0.0), (0.0, 3.0)])
    assert_points(data.misses, [])


def test_a_clockwise_scanner_has_a_negative_increment():
    clockwise = replace(QUARTER_TURNS, angle_min=math.pi / 2, angle_increment=-math.pi / 2)
    assert_points(filtered([3.0, 2.0, 1.0], clockwise).returns, [(0, 3), (2, 0), (0, -1)])


def test_points_are_in_the_tracking_frame():
    mounted = replace(QUARTER_TURNS, tf_tracking_sensor=Pose(0.5, -0.25, math.pi / 2))
    data = filtered([1.0, math.inf, 3.0], mounted, missing_data_ray_length=2.0)
    assert_points(data.returns, [(1.5, -0.25), (-2.5, -0.25)])
    assert_points(data.misses, [(0.5, 1.75)])
    assert data.tf_tracking_sensor == mounted.tf_tracking_sensor


def test_range_limits_are_the_scanners_by_default():
    data = filtered([0.1, 0.2, 20.0])
    assert_points(data.returns, [(0.2, 0.0)])
    assert len(data.misses) == 1


def test_configured_limits_replace_those_of_the_scanner():
    data = filtered([0.1, 1.5, 3.0], min_range=0.05, max_range=2.0, missing_data_ray_length=1.0)
    assert_points(data.returns, [(0.0, -0.1), (1.5, 0.0)])
    assert_points(data.misses, [(0.0, 1.0)])


def test_returns_beyond_the_default_range_clear_free_space():
    far = replace(QUARTER_TURNS, range_max=80.0)
    data = filtered([USEFUL_RANGE + 1.0, 5.0, USEFUL_RANGE - 1.0], far)
    assert len(data.returns) == 2
    assert len(data.misses) == 1


@pytest.mark.parametrize("no_return_is_free", [True, False])
@pytest.mark.parametrize("measured", [20.0, 81.91])
def test_maximum_ranges_clear_free_space_if_they_mean_it(no_return_is_free, measured):
    geometry = replace(QUARTER_TURNS, no_return_is_free=no_return_is_free)
    data = filtered([1.0, measured, math.inf], geometry, missing_data_ray_length=2.0)
    assert_points(data.returns, [(0.0, -1.0)])
    free = [(2.0, 0.0), (0.0, 2.0)] if no_return_is_free else [(0.0, 2.0)]
    assert_points(data.misses, free)


@pytest.mark.parametrize(
    ("step_deg", "num_missing", "num_clear"), [(1.0, 3, 1), (0.5, 3, 0), (0.5, 5, 1), (0.25, 9, 1)]
)
def test_a_missing_return_counts_only_among_others(step_deg, num_missing, num_clear):
    """One degree on each side, whatever the angle between beams, which logs round."""
    step = round(math.radians(step_deg), 5)
    ranges = np.full(41, 2.0)
    ranges[20 : 20 + num_missing] = math.inf
    geometry = ScanGeometry(-0.3, step, 41, 0.15, 20.0)
    data = filtered(ranges, geometry, missing_data_agreement_deg=1.0, voxel_filter_size=0.001)
    assert len(data.misses) == num_clear


def test_a_ray_length_of_zero_clears_nothing():
    assert len(filtered([math.inf, 81.91, 1.0], missing_data_ray_length=0.0).misses) == 0


@pytest.mark.parametrize("measured", [math.nan, -math.inf, -1.0, 0.0])
def test_a_scan_without_valid_ranges_has_no_points(measured):
    data = filtered([measured] * 3)
    assert data.returns.shape == data.misses.shape == (0, 2)


def test_each_voxel_has_one_return_and_one_miss():
    close = ScanGeometry(0.0, 1e-4, 100, 0.1, 20.0)
    ranges = np.where(np.arange(100) < 50, 1.01, math.inf)
    data = filtered(ranges, close, voxel_filter_size=0.1, missing_data_ray_length=3.03)
    assert len(data.returns) == len(data.misses) == 1
    middle = 1e-4 * 24
    assert_points(data.returns, [(1.01 * math.cos(middle), 1.01 * math.sin(middle))])


def test_a_filter_follows_a_change_of_the_scanner():
    range_filter = RangeFilter(SensorConfig())
    turned = replace(QUARTER_TURNS, tf_tracking_sensor=Pose(0.0, 0.0, math.pi))
    ranges = np.array([math.nan, 2.0, math.nan])
    for geometry, x in ((QUARTER_TURNS, 2.0), (turned, -2.0), (QUARTER_TURNS, 2.0)):
        assert_points(range_filter.apply(LaserScan(0.0, 0.0, ranges, geometry)).returns, [(x, 0)])


def test_the_ranges_of_the_scan_are_not_changed():
    ranges = np.array([1.0, math.nan, math.inf])
    filtered(ranges)
    assert np.array_equal(ranges, [1.0, math.nan, math.inf], equal_nan=True)


def test_thinning_keeps_enough_near_points_and_no_far_ones():
    points = np.random.default_rng(4).uniform(-10.0, 10.0, (1000, 2))
    config = AdaptiveVoxelFilterConfig(max_length=5.0, min_num_points=100, max_range=8.0)
    thinned = thin(points, config)
    assert 100 <= len(thinned) < 300
    assert (np.hypot(*thinned.T) <= 8.0).all()
    assert {tuple(point) for point in thinned} <= {tuple(point) for point in points}


def test_thinning_of_no_points_gives_none():
    assert thin(np.zeros((0, 2)), AdaptiveVoxelFilterConfig()).shape == (0, 2)


def test_a_configured_mounting_replaces_the_recorded_one():
    geometry = ScanGeometry(0.0, math.pi / 2, 2, 0.1, 20.0, True, Pose(9.0, 9.0, 9.0))
    scan = LaserScan(0.0, 0.0, np.array([1.0, 2.0]), geometry)

    data = RangeFilter(SensorConfig(laser_pose=(0.5, 0.0, math.pi / 2))).apply(scan)

    assert data.tf_tracking_sensor == Pose(0.5, 0.0, math.pi / 2)
    np.testing.assert_allclose(data.returns, [[0.5, 1.0], [-1.5, 0.0]], atol=1e-12)


def test_several_scanners_have_their_own_mountings():
    other = replace(QUARTER_TURNS, sensor="rear", tf_tracking_sensor=Pose(-1.0, 0.0, math.pi))
    range_filter = RangeFilter(SensorConfig())
    for _ in range(2):
        for geometry, ahead in ((QUARTER_TURNS, (2.0, 0.0)), (other, (-3.0, 0.0))):
            scan = LaserScan(0.0, 0.0, np.array((math.nan, 2.0, math.nan)), geometry)
            assert_points(range_filter.apply(scan).returns, [ahead])


def test_many_geometries_do_not_fill_the_memory():
    range_filter = RangeFilter(SensorConfig())
    for beams in range(1, 300):
        geometry = ScanGeometry(0.0, 0.001, beams, 0.1, 20.0)
        data = range_filter.apply(LaserScan(0.0, 0.0, np.full(beams, 2.0), geometry))
        assert data.returns[0] == pytest.approx((2.0, 0.0))
    assert len(range_filter._scanners) < 100


def test_a_configured_pose_is_that_of_the_first_scanner():
    other = replace(QUARTER_TURNS, sensor="rear", tf_tracking_sensor=Pose(-1.0, 0.0, math.pi))
    range_filter = RangeFilter(SensorConfig(laser_pose=(0.5, 0.0, 0.0)))
    seen = [
        range_filter.apply(LaserScan(0.0, 0.0, np.array((math.nan, 2.0, math.nan)), geometry))
        for geometry in (QUARTER_TURNS, other)
    ]
    assert_points(seen[0].returns, [(2.5, 0.0)])
    assert_points(seen[1].returns, [(-3.0, 0.0)])


def test_beams_of_an_upside_down_scanner_are_mirrored():
    hanging = replace(QUARTER_TURNS, roll=math.pi)
    assert_points(filtered([1.0, 2.0, 3.0], hanging).returns, [(0, 1), (2, 0), (0, -3)])


def test_a_scanner_can_be_configured_as_upside_down():
    mounted = replace(QUARTER_TURNS, tf_tracking_sensor=Pose(0.5, 0.0, math.pi / 2))

    assert_points(filtered([1.0, 2.0, 3.0], upside_down=True).returns, [(0, 1), (2, 0), (0, -3)])
    data = filtered([1.0, 2.0, 3.0], mounted, upside_down=True)
    assert_points(data.returns, [(-0.5, 0.0), (0.5, 2.0), (3.5, 0.0)])


def test_a_pitched_scanner_ignores_the_floor():
    pitched = replace(QUARTER_TURNS, pitch=math.radians(30.0), height=0.5)
    data = filtered([1.0, 2.0, math.nan], pitched)
    assert_points(data.returns, [(0.0, -1.0), (2.0 * math.cos(math.radians(30.0)), 0.0)])
    assert_points(filtered([1.0, 3.0, math.nan], pitched).returns, [(0.0, -1.0)])


def test_a_motion_at_rest_equals_no_motion():
    ranges = (1.0, math.inf, math.inf)
    moving = RangeFilter(SensorConfig()).apply(
        LaserScan(0.0, 0.0, np.array(ranges), QUARTER_TURNS), AT_REST
    )
    plain = filtered(ranges, missing_data_agreement_deg=1.0)
    assert len(plain.misses) == 1
    assert_points(moving.returns, plain.returns)
    assert_points(moving.misses, plain.misses)


def cloud_of(points, times=None, config=None, motion=None, **geometry):
    cloud = PointCloud(0.0, 0.0, np.array(points, dtype=float), times, CloudGeometry(**geometry))
    return RangeFilter(config or SensorConfig()).apply(cloud, motion)


def test_the_nearest_point_in_each_direction_is_used():
    data = cloud_of([(3.0, 0.0, 0.0), (2.0, 0.001, 0.3), (0.0, 4.0, 0.0), (math.nan, 1.0, 0.0)])
    assert sorted(map(tuple, data.returns.tolist())) == [(0.0, 4.0), (2.0, 0.001)]
    assert len(data.misses) == 0


def test_points_near_the_scanners_height_are_used():
    points = [(3.0, 0.0, -0.5), (0.0, 3.0, 0.0), (-3.0, 0.0, 0.9)]
    assert_points(cloud_of(points, height=0.6).returns, [(0.0, 3.0)])


def test_a_cloud_is_cropped_at_both_height_limits():
    points = [(3.0, 0.0, -0.5), (0.0, 3.0, 0.0), (-3.0, 0.0, 0.9)]
    low = cloud_of(points, min_z=-0.6, max_z=0.5)
    assert_points(low.returns, [(3.0, 0.0), (0.0, 3.0)])
    config = SensorConfig(min_z=-0.2, max_z=0.95)
    high = cloud_of(points, config=config, min_z=-5.0, max_z=5.0)
    assert_points(high.returns, [(0.0, 3.0), (-3.0, 0.0)])


def test_a_cloud_is_cropped_at_the_ranges_of_its_scanner():
    near_and_far = [(0.2, 0.0, 0.0), (0.0, 2.0, 0.0), (-9.0, 0.0, 0.0)]
    assert_points(cloud_of(near_and_far, range_min=0.5, range_max=8.0).returns, [(0.0, 2.0)])


def test_points_of_a_cloud_are_deskewed_by_their_own_times():
    ahead = SweepMotion(-0.1, 0.1, np.array([(-0.3, 0, 0, 0, 0), (0.0, 0, 0, 0, 0)]))
    data = cloud_of([(2.0, 0.0, 0.0), (0.0, 2.0, 0.0)], times=np.array((-0.1, 0.0)), motion=ahead)
    assert_points(sorted(data.returns.tolist()), [(0.0, 2.0), (1.7, 0.0)])


def test_an_empty_cloud_has_no_returns():
    assert len(cloud_of(np.empty((0, 3))).returns) == 0
