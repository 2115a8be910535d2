# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace

import numpy as np
import pytest

from cartoloop.errors import ConfigError
from cartoloop.sensor.pose import relative_all, wrap_angles
from cartoloop.simulation import PERFECT_ODOMETRY, OdometryModel, drive
from cartoloop.simulation.odometry import odometry_poses

ROUTE = np.array([[1.0, 2.0], [6.0, 2.0], [6.0, 7.0], [1.0, 7.0], [1.0, 3.0]])
MOTION = drive(ROUTE)
TIMES = np.arange(0.0, MOTION.duration, 0.2)
TRUTH = MOTION.poses_at(TIMES)


def measured(model, seed=0, times=TIMES, motion=MOTION):
    return odometry_poses(motion, times, model, np.random.default_rng(seed))


def test_perfect_odometry_is_the_motion_since_the_start():
    assert measured(PERFECT_ODOMETRY) == pytest.approx(relative_all(TRUTH[0], TRUTH), abs=1e-9)


def test_a_scale_error_stretches_the_steps():
    straight = drive(np.array([[0.0, 0.0], [10.0, 0.0]]))
    times = np.array([0.0, 1e3])
    poses = measured(
        replace(PERFECT_ODOMETRY, translation_scale=1.05), times=times, motion=straight
    )
    assert poses[-1] == pytest.approx([10.5, 0.0, 0.0])
    poses = measured(replace(PERFECT_ODOMETRY, rotation_scale=0.9))
    turned = np.unwrap(poses[:, 2])[-1] / np.unwrap(TRUTH[:, 2] - TRUTH[0, 2])[-1]
    assert turned == pytest.approx(0.9)


def test_a_time_offset_shifts_odometry_in_the_first_scan_s_frame():
    late = measured(replace(PERFECT_ODOMETRY, time_offset=0.4))
    expected = relative_all(TRUTH[0], MOTION.poses_at(TIMES + 0.4))
    assert late == pytest.approx(expected, abs=1e-9)


def test_a_robot_that_stands_has_odometry_that_stands():
    still = drive(np.array([[3.0, 3.0]]))
    assert not measured(OdometryModel(), motion=still).any()


def test_drift_grows_as_a_random_walk():
    straight = drive(np.array([[0.0, 0.0], [100.0, 0.0]]))
    times = np.linspace(0.0, straight.duration, 200)
    model = replace(PERFECT_ODOMETRY, drift_noise=0.01, translation_noise=0.02)
    ends = np.array([measured(model, seed, times, straight)[-1] for seed in range(300)])
    assert ends[:, 2].std() == pytest.approx(0.01 * np.sqrt(100.0), rel=0.2)
    only_length = replace(model, drift_noise=0.0)
    ends = np.array([measured(only_length, seed, times, straight)[-1] for seed in range(300)])
    assert ends[:, 0].std() == pytest.approx(0.02 * np.sqrt(100.0), rel=0.2)


def test_slips_are_rare_jumps_of_the_heading():
    model = replace(PERFECT_ODOMETRY, slips_per_metre=0.2, slip_angle=0.3)
    jumps = []
    for seed in range(50):
        error = wrap_angles(measured(model, seed)[:, 2] - (TRUTH[:, 2] - TRUTH[0, 2]))
        steps = wrap_angles(np.diff(error))
        jumps.extend(steps[np.abs(steps) > 1e-6])
    assert len(jumps) / 50 == pytest.approx(0.2 * MOTION.path_length, rel=0.2)
    assert np.std(jumps) == pytest.approx(0.3, rel=0.2)


def test_the_same_seed_gives_the_same_odometry():
    assert np.array_equal(measured(OdometryModel(), 4), measured(OdometryModel(), 4))
    assert not np.array_equal(measured(OdometryModel(), 4), measured(OdometryModel(), 5))


def test_negative_noise_is_refused():
    with pytest.raises(ConfigError):
        OdometryModel(drift_noise=-0.1)
