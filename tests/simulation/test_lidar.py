# SPDX-License-Identifier: Apache-2.0
import math
from dataclasses import replace

import numpy as np
import pytest

from cartoloop.errors import ConfigError
from cartoloop.sensor.pose import Pose
from cartoloop.simulation import LIDARS, Lidar, make_lidar, museum
from cartoloop.simulation.lidar import RangeNoise, true_ranges, walls_within

EXACT = Lidar(range_noise=0.0, dropout=0.0, range_quantum=0.0)
RNG_SEED = 5


def measure(ranges, lidar):
    ranges = np.atleast_2d(ranges)
    return RangeNoise(lidar, np.random.default_rng(RNG_SEED), ranges.size).apply(ranges)


def test_the_default_looks_from_right_to_left_as_a_sick_does():
    assert Lidar().geometry.angles[[0, 180, 360]] == pytest.approx([-math.pi / 2, 0, math.pi / 2])
    assert np.rad2deg(LIDARS["sick-180"].geometry.angles[[0, -1]]) == pytest.approx([-90.0, 89.0])
    assert np.rad2deg(LIDARS["wide"].geometry.angles[[0, -1]]) == pytest.approx([-135.0, 135.0])


def test_ranges_are_measured_from_where_the_scanner_sits():
    wall = np.array([[5.0, -9.0, 5.0, 9.0]])
    ahead = replace(EXACT, tf_tracking_sensor=Pose(0.3, 0.0, 0.0))
    assert true_ranges(wall, np.zeros((1, 3)), ahead)[0, 180] == pytest.approx(4.7)
    rearward = replace(EXACT, tf_tracking_sensor=Pose(-0.3, 0.0, math.pi))
    turned = np.array([[0.0, 0.0, math.pi]])
    assert true_ranges(wall, turned, rearward)[0, 180] == pytest.approx(4.7)


def test_an_exact_scanner_reports_the_truth():
    ranges = np.linspace(1.0, 29.0, 50)
    assert np.array_equal(measure(ranges, EXACT)[0], ranges)


def test_noise_has_the_given_deviation():
    noise = measure(np.full(20_000, 5.0), replace(EXACT, range_noise=0.02)) - 5.0
    assert noise.std() == pytest.approx(0.02, rel=0.05)
    assert abs(noise.mean()) < 1e-3


@pytest.mark.parametrize(("distance", "share"), [(0.5, 0.0117), (3.0, 0.02), (5.0, 0.0267)])
def test_a_cheap_scanners_noise_grows_from_one_to_three_percent(distance, share):
    lidar = replace(LIDARS["lds"], dropout=0.0)
    noise = measure(np.full(20_000, distance), lidar) - distance
    assert noise.std() == pytest.approx(share * distance, rel=0.03)
    assert abs(noise.mean()) < 0.03 * share * distance


def test_a_cheap_scanner_reports_no_return_as_zero():
    lidar = replace(LIDARS["lds"], dropout=0.0)
    assert measure(np.array([np.inf, 9.0, 0.05]), lidar)[0].tolist() == [0.0, 0.0, 0.0]


@pytest.mark.parametrize("sizes", [[7], [1] * 7, [3, 3, 1], [5, 2]])
def test_noise_does_not_depend_on_the_block_size(sizes):
    lidar = replace(LIDARS["lds"], dropout=0.2)
    exact = np.random.default_rng(2).uniform(0.1, 7.0, (7, 360))
    noise = RangeNoise(lidar, np.random.default_rng(RNG_SEED), exact.size)
    parts = np.split(exact, np.cumsum(sizes)[:-1])
    assert np.array_equal(np.vstack([noise.apply(part) for part in parts]), measure(exact, lidar))


def test_the_papers_scanners():
    backpack, lds = LIDARS["backpack"], LIDARS["lds"]
    assert math.degrees(backpack.field_of_view) == pytest.approx(269.5)
    assert (backpack.num_beams, backpack.range_max, backpack.rate) == (1079, 30.0, 10.0)
    assert math.degrees(lds.field_of_view) == pytest.approx(359.0)
    assert (lds.range_min, lds.range_max, lds.rate) == (0.15, 6.0, 2.0)


def test_walls_out_of_reach_are_left_out_and_change_nothing():
    world = museum(0)
    poses = np.column_stack((world.route[40:44], [0.0, 1.0, 2.0, 3.0]))
    near = walls_within(world.walls, poses, 30.0)
    assert 0 < len(near) < 0.7 * len(world.walls)
    lidar = LIDARS["backpack"]
    assert np.array_equal(true_ranges(near, poses, lidar), true_ranges(world.walls, poses, lidar))


def test_an_unknown_scanner_is_refused_with_the_nearest_name():
    with pytest.raises(ConfigError, match=r"'backpak'.*nearest: backpack"):
        make_lidar("backpak")


def test_beams_drop_out_with_the_given_probability():
    measured = measure(np.full(20_000, 5.0), replace(EXACT, dropout=0.1))
    assert (measured == EXACT.no_return).mean() == pytest.approx(0.1, abs=0.01)


def test_nothing_far_and_near_walls_have_their_own_values():
    measured = measure(np.array([np.inf, 30.0, 29.9, 0.1, 0.05]), EXACT)
    assert measured[0].tolist() == [81.91, 81.91, 29.9, 0.1, 0.0]


def test_ranges_are_multiples_of_the_quantum_and_survive_text():
    ranges = np.random.default_rng(1).uniform(0.2, 29.0, 500)
    millimetres = measure(ranges, replace(EXACT, range_quantum=0.001))[0]
    assert millimetres.tolist() == [float(f"{value:.3f}") for value in ranges]
    centimetres = measure(ranges, replace(EXACT, range_quantum=0.01))[0]
    assert centimetres.tolist() == [float(f"{value:.2f}") for value in ranges]


@pytest.mark.parametrize(
    "wrong",
    [
        {"num_beams": 0},
        {"num_beams": 361, "angle_increment": math.radians(1.0)},
        {"angle_increment": -0.01},
        {"rate": 0.0},
        {"range_min": 31.0},
        {"range_max": 90.0},
        {"no_return": 20.0},
        {"range_noise_share": -0.01},
        {"range_noise_growth": -0.01},
        {"range_noise": -0.1},
        {"dropout": 1.5},
    ],
)
def test_impossible_scanners_are_refused(wrong):
    with pytest.raises(ConfigError):
        Lidar(**wrong)
