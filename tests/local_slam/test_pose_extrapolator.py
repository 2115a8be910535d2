# SPDX-License-Identifier: Apache-2.0
"""Where the robot is expected: by odometry where there is any, by constant velocity otherwise."""

from __future__ import annotations

import math

import pytest

from cartoloop.config import PredictionConfig
from cartoloop.local_slam.pose_extrapolator import PoseExtrapolator
from cartoloop.local_slam.velocity_filter import HORIZON_S
from cartoloop.sensor.events import Imu
from cartoloop.sensor.pose import IDENTITY, Pose, compose


@pytest.fixture
def extrapolator():
    return PoseExtrapolator(PredictionConfig(), use_odometry=True)


def test_before_any_pose_the_robot_is_at_the_origin(extrapolator):
    extrapolator.add_odometry(0.0, Pose(5.0, 5.0, 1.0))
    extrapolator.add_odometry(1.0, Pose(6.0, 5.0, 1.0))
    prediction = extrapolator.predict(1.0)
    assert prediction.tf_local_tracking == IDENTITY
    assert not prediction.by_odometry


def test_after_one_pose_and_without_odometry_it_is_taken_to_stand(extrapolator):
    extrapolator.add_pose(1.0, Pose(1.0, 2.0, 0.5))
    prediction = extrapolator.predict(1.2)
    assert prediction.tf_local_tracking == pytest.approx(Pose(1.0, 2.0, 0.5))
    assert not prediction.by_odometry


def test_without_odometry_the_motion_goes_on_in_the_robot_s_own_frame(extrapolator):
    step = Pose(0.2, 0.0, 0.1)
    first = Pose(1.0, 2.0, 3.1)
    second = compose(first, step)
    extrapolator.add_pose(1.0, first)
    extrapolator.add_pose(1.5, second)
    prediction = extrapolator.predict(2.0)
    assert prediction.tf_local_tracking == pytest.approx(compose(second, step))
    assert not prediction.by_odometry
    half = extrapolator.predict(1.75).tf_local_tracking
    assert half == pytest.approx(compose(second, Pose(0.1, 0.0, 0.05)))


def test_the_velocity_is_held_only_for_a_while(extrapolator):
    extrapolator.add_pose(0.0, Pose(0.0, 0.0, 0.0))
    extrapolator.add_pose(0.5, Pose(0.5, 0.0, 0.0))
    after_hours = extrapolator.predict(36000.0).tf_local_tracking
    assert after_hours == pytest.approx(Pose(0.5 + HORIZON_S, 0.0, 0.0))


def test_odometry_tells_the_step_whatever_its_frame(extrapolator):
    start, step = Pose(1.0, 2.0, 0.5), Pose(0.3, -0.05, 0.2)
    odometry = Pose(-40.0, 7.0, -2.9)
    extrapolator.add_odometry(1.0, odometry)
    extrapolator.add_pose(1.0, start)
    extrapolator.add_odometry(1.2, compose(odometry, step))
    prediction = extrapolator.predict(1.2)
    assert prediction.by_odometry
    assert prediction.tf_local_tracking == pytest.approx(compose(start, step))


def test_odometry_wins_over_the_velocity(extrapolator):
    extrapolator.add_odometry(0.0, IDENTITY)
    extrapolator.add_pose(0.0, IDENTITY)
    extrapolator.add_odometry(1.0, Pose(1.0, 0.0, 0.0))
    extrapolator.add_pose(1.0, Pose(1.0, 0.0, 0.0))
    extrapolator.add_odometry(2.0, Pose(1.0, 0.0, 0.0))  # it has stopped
    assert extrapolator.predict(2.0).tf_local_tracking == pytest.approx(Pose(1.0, 0.0, 0.0))


def test_odometry_that_began_after_the_last_pose_is_of_no_use_yet(extrapolator):
    extrapolator.add_pose(0.0, IDENTITY)
    extrapolator.add_pose(1.0, Pose(0.5, 0.0, 0.0))
    extrapolator.add_odometry(1.5, Pose(9.0, 9.0, 0.0))
    prediction = extrapolator.predict(2.0)
    assert not prediction.by_odometry
    assert prediction.tf_local_tracking == pytest.approx(Pose(1.0, 0.0, 0.0))


def test_odometry_can_be_switched_off():
    extrapolator = PoseExtrapolator(PredictionConfig(), use_odometry=False)
    extrapolator.add_odometry(0.0, IDENTITY)
    extrapolator.add_pose(0.0, IDENTITY)
    extrapolator.add_odometry(1.0, Pose(1.0, 0.0, 0.0))
    prediction = extrapolator.predict(1.0)
    assert not prediction.by_odometry
    assert prediction.tf_local_tracking == pytest.approx(IDENTITY)


def test_other_guesses_are_at_hand_for_when_odometry_fails(extrapolator):
    extrapolator.add_pose(0.0, IDENTITY)
    extrapolator.add_pose(1.0, Pose(1.0, 0.0, 0.0))
    assert extrapolator.at_rest() == Pose(1.0, 0.0, 0.0)
    assert extrapolator.at_constant_velocity(1.5) == pytest.approx(Pose(1.5, 0.0, 0.0))


def test_inertial_readings_are_taken_in_without_harm(extrapolator):
    extrapolator.add_pose(0.0, Pose(1.0, 0.0, 0.0))
    extrapolator.add_imu(Imu(0.1, 0.1, (0.0, 0.0, 9.81), (0.0, 0.0, 0.3)))
    assert extrapolator.predict(0.2).tf_local_tracking == pytest.approx(Pose(1.0, 0.0, 0.0))


def test_a_known_offset_of_the_clock_is_taken_into_account():
    """Odometry of a stamp shows the robot a quarter of a second later than its scan."""
    offset, period = 0.25, 0.25

    def true_pose(time):
        return Pose(2.0 * math.sin(0.3 * time), 0.5 * time, 1.5 * math.sin(0.9 * time))

    extrapolator = PoseExtrapolator(PredictionConfig(), use_odometry=True)
    times = [period * k for k in range(400)]
    for time in times:
        extrapolator.add_odometry(time, true_pose(time + offset))
        extrapolator.add_pose(time, true_pose(time))
    assert extrapolator.odometry_model.time_offset == pytest.approx(offset, abs=0.03)
    extrapolator.add_odometry(times[-1] + period, true_pose(times[-1] + period + offset))
    expected = true_pose(times[-1] + period)
    predicted = extrapolator.predict(times[-1] + period).tf_local_tracking
    assert predicted[:2] == pytest.approx(expected[:2], abs=0.02)
    assert predicted.theta == pytest.approx(expected.theta, abs=0.03)
