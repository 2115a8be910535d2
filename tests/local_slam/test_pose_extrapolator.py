# SPDX-License-Identifier: Apache-2.0
"""Predictions by odometry, by constant velocity and by an IMU."""

from __future__ import annotations

import math

import numpy as np
import pytest

from cartoloop.config import LocalSlamConfig
from cartoloop.local_slam.gap import (
    ANY_HEADING_RAD,
    MAX_ERROR_M,
    ODOMETRY_ERROR_SHARE,
    VELOCITY_ERROR,
)
from cartoloop.local_slam.moving_gain import Explained
from cartoloop.local_slam.odometry_window import Evidence
from cartoloop.local_slam.pose_extrapolator import PoseExtrapolator
from cartoloop.sensor.events import Imu
from cartoloop.sensor.pose import IDENTITY, Pose, compose

HORIZON_S = LocalSlamConfig().prediction.velocity_horizon


SEEN = Evidence(True, 0.0, lambda _: math.inf, lambda: math.inf)
"""Of a match that determines the position in both directions."""


@pytest.fixture
def extrapolator():
    return PoseExtrapolator(LocalSlamConfig())


def test_before_any_pose_the_robot_is_at_the_origin(extrapolator):
    extrapolator.add_odometry(0.0, Pose(5.0, 5.0, 1.0))
    extrapolator.add_odometry(1.0, Pose(6.0, 5.0, 1.0))
    prediction = extrapolator.predict(1.0)
    assert prediction.tf_local_tracking == IDENTITY
    assert not prediction.by_odometry


def test_after_one_pose_without_odometry_rest_is_predicted(extrapolator):
    extrapolator.add_pose(1.0, Pose(1.0, 2.0, 0.5))
    prediction = extrapolator.predict(1.2)
    assert prediction.tf_local_tracking == pytest.approx(Pose(1.0, 2.0, 0.5))
    assert not prediction.by_odometry


def test_constant_velocity_is_in_the_robots_own_frame(extrapolator):
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


def test_the_velocity_is_extrapolated_for_a_limited_time(extrapolator):
    extrapolator.add_pose(0.0, Pose(0.0, 0.0, 0.0))
    extrapolator.add_pose(0.5, Pose(0.5, 0.0, 0.0))
    after_hours = extrapolator.predict(36000.0).tf_local_tracking
    assert after_hours == pytest.approx(Pose(0.5 + HORIZON_S, 0.0, 0.0))


def test_odometry_predicts_the_step_in_any_frame(extrapolator):
    start, step = Pose(1.0, 2.0, 0.5), Pose(0.3, -0.05, 0.2)
    odometry = Pose(-40.0, 7.0, -2.9)
    extrapolator.add_odometry(1.0, odometry)
    extrapolator.add_pose(1.0, start)
    extrapolator.add_odometry(1.2, compose(odometry, step))
    prediction = extrapolator.predict(1.2)
    assert prediction.by_odometry
    assert prediction.tf_local_tracking == pytest.approx(compose(start, step))


@pytest.mark.parametrize(("speed", "by_odometry"), [(1.0, True), (2.0, False), (0.0, False)])
def test_after_a_fault_odometry_must_move_at_the_velocity(extrapolator, speed, by_odometry):
    """Bare walls do not show whether it is good again."""
    seen = Evidence(True, 0.0, lambda _: math.inf, lambda: math.inf)
    unseen = Evidence(False, 0.0, lambda _: math.inf, lambda: 0.0)
    measured = 0.0
    for k in range(30):
        extrapolator.add_odometry(0.2 * k, Pose(measured, 0.0, 0.0))
        pose, evidence = Pose(0.2 * k, 0.0, 0.0), seen if k < 15 else unseen
        extrapolator.add_pose(0.2 * k, pose, evidence=evidence)
        measured += 0.2 * (0.3 if k < 15 else speed)
    assert not extrapolator.odometry.is_trusted
    extrapolator.add_odometry(6.0, Pose(measured, 0.0, 0.0))
    assert extrapolator.predict(6.0).by_odometry == by_odometry


@pytest.mark.parametrize(("pause", "expected"), [(0.3, 0.0), (3.0, 0.5)])
def test_across_a_gap_doubtful_odometry_beats_the_velocity(extrapolator, pause, expected):
    seen = Evidence(True, 0.0, lambda _: math.inf, lambda: math.inf)
    for k in range(40):
        extrapolator.add_odometry(0.1 * k, Pose(0.2 * k, 0.0, 0.0))
        extrapolator.add_pose(0.1 * k, Pose(0.05 * k, 0.0, 0.0), evidence=seen)
    assert not extrapolator.odometry.is_trusted
    extrapolator.add_odometry(3.9 + pause, Pose(7.8, 0.0, 0.5))
    prediction = extrapolator.predict(3.9 + pause)
    assert not prediction.by_odometry
    assert prediction.tf_local_tracking.theta == pytest.approx(expected)


def test_odometry_that_repeated_before_a_gap_counts_after_it(extrapolator):
    seen = Evidence(True, 0.0, lambda _: math.inf, lambda: math.inf)
    reported = np.cumsum([0.2] * 28 + [0.1, 0.03, 0.0, 0.0])
    for k, x in enumerate(reported.tolist()):
        extrapolator.add_odometry(0.2 * k, Pose(x, 0.0, 0.0))
        extrapolator.add_pose(0.2 * k, Pose(0.2 * k, 0.0, 0.0), evidence=seen)
    assert extrapolator.odometry.is_stale
    extrapolator.add_odometry(12.2, Pose(11.73, 0.0, 0.7))
    predicted = extrapolator.predict(12.2).tf_local_tracking
    assert predicted.x == pytest.approx(12.2, abs=0.1)
    assert predicted.theta == pytest.approx(0.7, abs=0.01)


@pytest.mark.parametrize("is_determined", [False, True])
def test_what_was_extrapolated_wrongly_is_made_up_for(extrapolator, is_determined):
    """Only where the match has followed the odometry."""
    evidence = Evidence(is_determined, 0.0, lambda _: math.inf, lambda: 0.0)
    for time, x in ((0.0, 0.0), (0.1, 0.02)):
        extrapolator.add_odometry(time, Pose(x, 0.0, 0.0))
    extrapolator.add_pose(0.1, IDENTITY, evidence=evidence)
    guessed = extrapolator.predict(0.2).tf_local_tracking
    assert guessed.x == pytest.approx(0.02)
    extrapolator.add_pose(0.2, guessed, evidence=evidence)
    for time, x in ((0.2, 0.08), (0.3, 0.14)):
        extrapolator.add_odometry(time, Pose(x, 0.0, 0.0))
    x = extrapolator.predict(0.3).tf_local_tracking.x
    assert x == pytest.approx(0.08 if is_determined else 0.12)


def test_wrong_guesses_in_turn_are_made_up_for_once_each(extrapolator):
    evidence = Evidence(False, 0.0, lambda _: math.inf, lambda: 0.0)
    for time, x in ((0.0, 0.0), (0.1, 0.02)):
        extrapolator.add_odometry(time, Pose(x, 0.0, 0.0))
    extrapolator.add_pose(0.1, Pose(0.02, 0.0, 0.0), evidence=evidence)
    for number in range(2, 8):
        time = 0.1 * number
        predicted = extrapolator.predict(time).tf_local_tracking
        extrapolator.add_pose(time, predicted, evidence=evidence)
        extrapolator.add_odometry(time, Pose(0.02 * number**2, 0.0, 0.0))
    extrapolator.add_odometry(0.8, Pose(0.02 * 8**2, 0.0, 0.0))
    assert extrapolator.predict(0.8).tf_local_tracking.x == pytest.approx(0.02 * 8**2)


def test_readings_that_give_way_to_others_do_not_add_up(extrapolator):
    """Two readings of each stamp differ, the second comes after the scan."""
    evidence = Evidence(False, 0.0, lambda _: math.inf, lambda: 0.0)
    extrapolator.add_odometry(0.0, IDENTITY)
    extrapolator.add_pose(0.0, IDENTITY, evidence=evidence)
    for number in range(1, 50):
        time = 0.1 * number
        extrapolator.add_odometry(time, Pose(0.1 * number, 0.0, 0.0))
        predicted = extrapolator.predict(time).tf_local_tracking
        extrapolator.add_pose(time, predicted, evidence=evidence)
        extrapolator.add_odometry(time, Pose(0.1 * number + 0.01, 0.0, 0.0))
    assert predicted.x == pytest.approx(4.9, abs=0.02)


@pytest.mark.parametrize(
    ("share", "by_rest", "by_expected", "is_by_odometry"),
    [
        (0.0, 0.9, 0.9, True),
        (0.1, 0.9, 0.9, True),
        (0.1, 0.9, 0.95, False),
        (0.4, 0.6, 0.6, False),
        (0.4, 0.7, 0.4, True),
    ],
)
def test_odometry_rests_only_while_ranges_stay(
    extrapolator, share, by_rest, by_expected, is_by_odometry
):
    """Along bare walls, where the match follows the odometry; or people change the ranges."""
    explained = Explained(by_rest, by_expected, max(by_rest, by_expected))
    evidence = Evidence(
        False, 0.0, lambda _: math.inf, lambda: 0.0, lambda _: share, lambda *_: explained
    )
    steps = [0.0] + 8 * [0.1] + [0.07, 0.04, 0.01] + 10 * [0.0] + 3 * [0.05]
    predicted = []
    for number, x in enumerate(np.cumsum(steps).tolist()):
        extrapolator.add_odometry(0.2 * number, Pose(x, 0.0, 0.0))
        predicted.append(extrapolator.predict(0.2 * number).by_odometry)
        extrapolator.add_pose(0.2 * number, Pose(x, 0.0, 0.0), evidence=evidence)
    assert predicted[11]
    assert predicted[21] is is_by_odometry
    assert predicted[-1]


def test_noise_along_bare_walls_moves_no_robot_that_stands(extrapolator):
    """The matches drift by a few centimetres to and fro; constant velocity would go on with it."""
    evidence = Evidence(False, 0.0, lambda _: math.inf, lambda: 0.0)
    rng, x = np.random.default_rng(0), 0.0
    for number in range(200):
        time = 0.2 * number
        extrapolator.add_odometry(time, IDENTITY)
        if number:
            predicted = extrapolator.predict(time)
            assert not predicted.by_odometry
            x = predicted.tf_local_tracking.x + 0.02 * float(rng.normal())
        extrapolator.add_pose(time, Pose(x, 0.0, 0.0), evidence=evidence)
    assert abs(x) < 1.0


@pytest.mark.parametrize(("step", "is_stale"), [(0.04, False), (0.15, True)])
def test_odometry_that_never_moved_may_be_right(extrapolator, step, is_stale):
    """Scans of a noisy scanner move by centimetres while the robot stands."""
    seen = Evidence(True, 0.0, lambda _: math.inf, lambda: math.inf)
    for number in range(6):
        extrapolator.add_odometry(0.2 * number, IDENTITY)
        x = step * (number if is_stale else number % 2)
        extrapolator.add_pose(0.2 * number, Pose(x, 0.0, 0.0), evidence=seen)
    assert extrapolator.odometry.is_stale is is_stale


def test_odometry_that_never_moved_predicts_nothing(extrapolator):
    for number in range(4):
        extrapolator.add_odometry(0.2 * number, IDENTITY)
        assert not extrapolator.predict(0.2 * number).by_odometry
        extrapolator.add_pose(0.2 * number, IDENTITY)
    extrapolator.add_odometry(0.8, Pose(0.1, 0.0, 0.0))
    assert extrapolator.predict(0.8).by_odometry


def test_odometry_has_precedence_over_the_velocity(extrapolator):
    extrapolator.add_odometry(0.0, IDENTITY)
    extrapolator.add_pose(0.0, IDENTITY)
    extrapolator.add_odometry(1.0, Pose(1.0, 0.0, 0.0))
    extrapolator.add_pose(1.0, Pose(1.0, 0.0, 0.0))
    extrapolator.add_odometry(2.0, Pose(1.0, 0.0, 0.0))  # it has stopped
    assert extrapolator.predict(2.0).tf_local_tracking == pytest.approx(Pose(1.0, 0.0, 0.0))


@pytest.mark.parametrize("speed", [0.8, 0.25])
def test_odometry_that_catches_up_shows_where_the_robot_is(extrapolator, speed):
    # At 0.25 m/s, only the long step afterwards shows that readings were repeated.
    def at(k):
        return Pose(0.2 * k * speed, 0.0, 0.0)

    for k in range(101):
        reading = at(k) if k < 90 else at(89)
        extrapolator.add_odometry(0.2 * k, reading)
        # Between bare walls, matches stay where the odometry stays.
        extrapolator.add_pose(0.2 * k, reading)
    extrapolator.add_odometry(20.2, at(101))
    prediction = extrapolator.predict(20.2)
    assert prediction.by_odometry
    assert prediction.tf_local_tracking == pytest.approx(at(101), abs=1e-6)
    assert prediction.information[0] < extrapolator.predict(20.2).information[0] / 10.0
    assert extrapolator.summary()["odometry"]["catch_ups"] == 1


def drive_and_stop(extrapolator, held, better, turn=0.0):
    """Drive at 0.25 m/s; then the odometry stops, and matches move at the share `held` of that.

    Scans show that the motion before explains them better than rest, by the share `better`.
    """
    explained = Explained(0.9 - better, 0.9, 0.9)
    evidence = SEEN._replace(changed_share=lambda _: 0.05, explained=lambda *_: explained)
    made_up = []
    for k in range(31):
        driven = Pose(0.05 * min(k, 20), 0.0, 0.0)
        extrapolator.add_odometry(0.2 * k, driven)
        made_up.append(extrapolator.make_up())
        matched = Pose(driven.x + 0.05 * held * max(k - 20, 0), 0.0, turn * max(k - 20, 0))
        extrapolator.add_pose(0.2 * k, matched, evidence=evidence)
    return made_up


def test_motion_that_odometry_at_rest_misses_is_made_up_for(extrapolator):
    made_up = drive_and_stop(extrapolator, held=0.0, better=0.05)
    (missed,) = (each for each in made_up if each is not None)
    assert missed.begin == pytest.approx(3.8)  # the last step may have been cut short
    assert missed.tf_local_tracking == pytest.approx(Pose(0.95, 0.0, 0.0))
    assert missed.velocity == pytest.approx((0.25, 0.0))


def test_the_next_scan_is_predicted_where_the_motion_leads(extrapolator):
    extrapolator.make_up = lambda: None
    drive_and_stop(extrapolator, held=0.0, better=0.05)
    del extrapolator.make_up
    assert extrapolator.make_up() is not None
    extrapolator.add_odometry(6.2, Pose(1.0, 0.0, 0.0))
    assert extrapolator.predict(6.2).tf_local_tracking == pytest.approx(Pose(1.55, 0.0, 0.0))


def test_the_step_after_it_was_made_up_for_does_not_calibrate(extrapolator):
    steps = []
    add_pose = extrapolator.odometry.add_pose

    def note(time, pose, num_faulty, scanner, *, is_matched):
        steps.append((time, num_faulty))
        add_pose(time, pose, num_faulty, scanner, is_matched=is_matched)

    extrapolator.odometry.add_pose = note
    extrapolator.make_up = lambda: None
    drive_and_stop(extrapolator, held=0.0, better=0.05)
    del extrapolator.make_up
    missed = extrapolator.make_up()
    extrapolator.add_odometry(6.2, Pose(1.05, 0.0, 0.0))  # it goes on
    extrapolator.add_pose(6.2, missed.corrected(6.2, Pose(1.0, 0.0, 0.0)), evidence=SEEN)
    assert steps[-1] == (6.2, 1)


@pytest.mark.parametrize(
    ("held", "better", "turn"), [(0.9, 0.05, 0.0), (0.0, -0.05, 0.0), (0.0, 0.05, 0.05)]
)
def test_matches_that_follow_are_not_made_up_for(extrapolator, held, better, turn):
    made_up = drive_and_stop(extrapolator, held, better, turn)
    assert not any(made_up)


@pytest.mark.parametrize("is_determined", [True, False])
def test_noisy_odometry_says_how_far_along_a_corridor(extrapolator, is_determined):
    """The robot moves steadily, unlike its odometry, and then stops, in a room or a corridor."""
    seen, open_ended = (
        Evidence(value, 0.0, lambda _: math.inf, lambda: math.inf) for value in (True, False)
    )
    for k in range(61):
        extrapolator.add_odometry(0.2 * k, Pose(0.2 * k + 0.15 * (-1) ** k, 0.0, 0.0))
        extrapolator.add_pose(0.2 * k, Pose(0.2 * k, 0.0, 0.0), evidence=seen)
    assert extrapolator.odometry.faults[0].kind == "moves unsteadily"
    extrapolator.add_odometry(12.2, Pose(12.2, 0.0, 0.3))
    evidence = seen if is_determined else open_ended
    extrapolator.add_pose(12.2, Pose(12.2, 0.0, 0.0), evidence=evidence)
    extrapolator.add_odometry(12.4, Pose(12.2, 0.0, 0.6))
    prediction = extrapolator.predict(12.4)
    assert prediction.by_odometry == (not is_determined)
    moved = 0.2 if is_determined else 0.0
    assert prediction.tf_local_tracking == pytest.approx(Pose(12.2 + moved, 0.0, 0.0), abs=0.02)


def test_odometry_that_began_after_the_last_pose_is_not_used(extrapolator):
    extrapolator.add_pose(0.0, IDENTITY)
    extrapolator.add_pose(1.0, Pose(0.5, 0.0, 0.0))
    extrapolator.add_odometry(1.5, Pose(9.0, 9.0, 0.0))
    prediction = extrapolator.predict(2.0)
    assert not prediction.by_odometry
    assert prediction.tf_local_tracking == pytest.approx(Pose(1.0, 0.0, 0.0))


def test_odometry_can_be_disabled():
    extrapolator = PoseExtrapolator(LocalSlamConfig(use_odometry=False))
    extrapolator.add_odometry(0.0, IDENTITY)
    extrapolator.add_pose(0.0, IDENTITY)
    extrapolator.add_odometry(1.0, Pose(1.0, 0.0, 0.0))
    prediction = extrapolator.predict(1.0)
    assert not prediction.by_odometry
    assert prediction.tf_local_tracking == pytest.approx(IDENTITY)


def test_odometry_that_never_moved_predicts_nothing_but_stands(extrapolator):
    for k in range(3):
        extrapolator.add_odometry(float(k), IDENTITY)
    extrapolator.add_pose(0.0, IDENTITY)
    prediction = extrapolator.predict(1.0)
    assert not prediction.by_odometry
    assert prediction.stands


def test_without_readings_no_odometry_stands(extrapolator):
    extrapolator.add_pose(0.0, IDENTITY)
    assert not extrapolator.predict(1.0).stands


def test_fallbacks_are_at_rest_and_at_constant_velocity(extrapolator):
    extrapolator.add_pose(0.0, IDENTITY)
    extrapolator.add_pose(1.0, Pose(1.0, 0.0, 0.0))
    at_rest, at_constant_velocity = extrapolator.predict(1.5).fallbacks()
    assert at_rest == Pose(1.0, 0.0, 0.0)
    assert at_constant_velocity == pytest.approx(Pose(1.5, 0.0, 0.0))


def turning(extrapolator, rate, end, acceleration=(0.0, 0.0, 9.81), begin=0.0):
    """IMU readings every 10 ms until `end`."""
    for k in range(round((end - begin) * 100) + 1):
        time = begin + 0.01 * k
        extrapolator.add_imu(Imu(time, time, acceleration, (0.0, 0.0, rate)))


def test_the_gyroscope_predicts_the_rotation(extrapolator):
    extrapolator.add_pose(0.0, IDENTITY)
    extrapolator.add_pose(0.1, Pose(0.1, 0.0, 0.0))
    turning(extrapolator, 1.5, 0.2)
    prediction = extrapolator.predict(0.2)
    assert not prediction.by_odometry
    assert prediction.tf_local_tracking == pytest.approx(Pose(0.2, 0.0, 0.15))
    assert prediction.information[5] > 0.01**-2


def test_the_gyroscope_has_precedence_over_wheels(extrapolator):
    turning(extrapolator, 1.5, 0.2)
    extrapolator.add_odometry(0.1, IDENTITY)
    extrapolator.add_pose(0.1, IDENTITY)
    extrapolator.add_odometry(0.2, Pose(0.1, 0.0, 0.5))
    prediction = extrapolator.predict(0.2)
    assert prediction.by_odometry
    assert prediction.tf_local_tracking == pytest.approx(Pose(0.1, 0.0, 0.15))


def test_an_imu_can_be_disabled_and_old_readings_are_not_used():
    extrapolator = PoseExtrapolator(LocalSlamConfig(use_imu=False))
    turning(extrapolator, 1.5, 0.2)
    assert extrapolator.gyroscope.track is None
    stopped = PoseExtrapolator(LocalSlamConfig())
    turning(stopped, 1.5, 0.2)
    stopped.add_pose(0.2, Pose(1.0, 0.0, 0.0))
    assert stopped.predict(0.6).tf_local_tracking == pytest.approx(Pose(1.0, 0.0, 0.0))


def test_the_motion_of_a_sweep_follows_the_odometry(extrapolator):
    for k in range(5):
        extrapolator.add_odometry(0.05 * k, Pose(0.1 * k, 0.0, 0.0))
    motion = extrapolator.sweep_motion(0.05, 0.0, 0.1)
    assert motion.start + motion.step * (len(motion.knots) - 1) == pytest.approx(0.1)
    assert motion.knots[0] == pytest.approx((0.0,) * 5)
    assert motion.knots[-1] == pytest.approx((0.2, 0.0, 0.0, 0.0, 0.0))


def test_a_sweep_may_precede_its_stamp(extrapolator):
    for k in range(5):
        extrapolator.add_odometry(0.05 * k, Pose(0.1 * k, 0.0, 0.0))
    assert extrapolator.sweep_motion(0.2, -0.1, 0.0).knots[0, 0] == pytest.approx(-0.2)


def test_without_sweep_and_imu_there_is_no_motion(extrapolator):
    extrapolator.add_odometry(0.0, IDENTITY)
    assert extrapolator.sweep_motion(0.0, 0.0, 0.0) is None


def test_gravity_gives_roll_and_pitch_of_each_scan(extrapolator):
    turning(extrapolator, 0.0, 1.0, (-9.8 * math.sin(0.1), 0.0, 9.8 * math.cos(0.1)))
    motion = extrapolator.sweep_motion(0.5, 0.0, 0.0)
    assert motion.knots == pytest.approx(np.array([(0.0, 0.0, 0.0, 0.0, 0.1)]))


@pytest.mark.parametrize(("up", "is_used"), [(9.8, True), (-9.8, False), (0.2, True)])
def test_an_upside_down_imu_is_first_compared_with_scans(extrapolator, up, is_used):
    turning(extrapolator, 0.5, 1.0, (0.0, 0.0, up))
    extrapolator.add_pose(0.5, IDENTITY)
    turned = extrapolator.predict(0.9).tf_local_tracking.theta
    assert turned == pytest.approx(0.2 if is_used else 0.0)


def test_odometry_that_ends_does_not_stop_the_robot(extrapolator):
    for k in range(11):
        extrapolator.add_odometry(0.1 * k, Pose(0.1 * k, 0.0, 0.0))
        extrapolator.add_pose(0.1 * k, Pose(0.1 * k, 0.0, 0.0))
    for k in range(11, 20):
        extrapolator.add_pose(0.1 * k, Pose(0.1 * k, 0.0, 0.0))
    prediction = extrapolator.predict(2.0)
    assert not prediction.by_odometry
    assert prediction.tf_local_tracking.x == pytest.approx(2.0, abs=0.01)


def test_projection_can_be_disabled():
    extrapolator = PoseExtrapolator(LocalSlamConfig(project_to_horizontal=False))
    turning(extrapolator, 0.0, 1.0, (-9.8 * math.sin(0.1), 0.0, 9.8 * math.cos(0.1)))
    assert extrapolator.sweep_motion(0.5, 0.0, 0.0) is None


def test_an_overlong_sweep_counts_as_instantaneous(extrapolator):
    assert extrapolator.sweep_motion(0.0, 0.0, 100.0) is None
    assert extrapolator.summary()["sweeps_too_long"] == 1


def test_a_match_corrects_the_motion_during_its_sweep(extrapolator):
    """It begins to turn at 1 rad/s: the middle of the sweep is correct anyway."""
    extrapolator.add_pose(0.0, IDENTITY, extrapolator.sweep_motion(0.0, 0.0, 0.08))
    assumed = extrapolator.sweep_motion(0.1, 0.0, 0.08)
    corrected = extrapolator.corrected_motion(0.1, Pose(0.0, 0.0, 0.1), assumed)
    assert corrected.knots[-1, 2] == pytest.approx(0.08)
    extrapolator.add_pose(0.1, Pose(0.0, 0.0, 0.06), corrected)
    assert extrapolator.corrected_motion(0.2, Pose(0.0, 0.0, 0.16), corrected) is None


def test_a_measured_motion_is_not_corrected(extrapolator):
    extrapolator.add_odometry(-0.05, Pose(-0.01, 0.0, 0.0))
    for k in range(5):
        extrapolator.add_odometry(0.05 * k, IDENTITY)
    extrapolator.add_pose(0.0, IDENTITY)
    assumed = extrapolator.sweep_motion(0.1, 0.0, 0.08)
    assert extrapolator.corrected_motion(0.1, Pose(0.0, 0.0, 0.1), assumed) is None


def test_the_offset_of_the_odometrys_clock_is_corrected():
    """Odometry is a quarter of a second newer than the scan of the same stamp."""
    offset, period = 0.25, 0.25

    def true_pose(time):
        return Pose(2.0 * math.sin(0.3 * time), 0.5 * time, 1.5 * math.sin(0.9 * time))

    extrapolator = PoseExtrapolator(LocalSlamConfig())
    times = [period * k for k in range(400)]
    for time in times:
        extrapolator.add_odometry(time, true_pose(time + offset))
        extrapolator.add_pose(time, true_pose(time), evidence=SEEN)
    assert extrapolator.odometry.model.time_offset == pytest.approx(offset, abs=0.03)
    extrapolator.add_odometry(times[-1] + period, true_pose(times[-1] + period + offset))
    expected = true_pose(times[-1] + period)
    predicted = extrapolator.predict(times[-1] + period).tf_local_tracking
    assert predicted[:2] == pytest.approx(expected[:2], abs=0.02)
    assert predicted.theta == pytest.approx(expected.theta, abs=0.03)


def test_the_offset_of_the_imus_clock_is_corrected():
    offset, period = 0.3, 0.2

    def heading(time):
        return 1.5 * math.sin(0.9 * time)

    extrapolator = PoseExtrapolator(LocalSlamConfig())
    for k in range(300):
        begin = period * k
        for j in range(20):
            time = begin + 0.01 * j
            rate = 1.5 * 0.9 * math.cos(0.9 * (time + offset))
            extrapolator.add_imu(Imu(time, time, (0.0, 0.0, 9.81), (0.0, 0.0, rate)))
        extrapolator.add_pose(begin, Pose(0.0, 0.0, heading(begin)), evidence=SEEN)
    assert extrapolator.gyroscope.calibration.time_offset == pytest.approx(offset, abs=0.02)
    expected = heading(300 * period)
    predicted = extrapolator.predict(300 * period).tf_local_tracking.theta
    assert predicted == pytest.approx(expected, abs=0.01)


def test_a_gyroscope_mounted_upside_down_is_not_used():
    extrapolator = PoseExtrapolator(LocalSlamConfig())
    for k in range(100):
        time = 0.2 * k
        for j in range(10):
            extrapolator.add_imu(
                Imu(time + 0.02 * j, time + 0.02 * j, (0.0, 0.0, 9.81), (0.0, 0.0, -0.5))
            )
        extrapolator.add_pose(
            time, Pose(0.0, 0.0, math.remainder(0.5 * time, math.tau)), evidence=SEEN
        )
    assert not extrapolator.gyroscope.calibration.agrees
    ahead = extrapolator.predict(20.0).tf_local_tracking.theta
    assert math.remainder(ahead - 10.0, math.tau) == pytest.approx(0.0, abs=0.01)


@pytest.mark.parametrize("is_matched", [True, False])
def test_scans_that_were_not_matched_calibrate_nothing(extrapolator, is_matched):
    """Their poses follow the odometry, whatever it is calibrated to."""
    pose = reported = IDENTITY
    seen = Evidence(True, 0.0, lambda _: math.inf, lambda: math.inf)
    for k in range(120):
        heading = 0.3 * math.sin(0.35 * k)
        reported = compose(reported, Pose(0.1, 0.0, heading))
        pose = compose(pose, Pose(0.09, 0.0, heading))
        extrapolator.add_odometry(0.2 * k, reported)
        extrapolator.add_pose(0.2 * k, pose, evidence=seen if is_matched or k % 2 else None)
    found = extrapolator.odometry.model
    assert found.is_known == is_matched
    assert found.translation_scale == pytest.approx(0.9 if is_matched else 1.0, abs=1e-3)


@pytest.mark.parametrize(("pause", "is_gap"), [(0.3, False), (3.0, True)])
def test_after_a_gap_odometry_may_have_been_buffered(extrapolator, pause, is_gap):
    """The last reading before it was already of after the turn, or the first still of before."""
    for k in range(20):
        extrapolator.add_odometry(0.2 * k, Pose(0.05 * k, 0.0, 0.0))
        extrapolator.add_pose(0.2 * k, Pose(0.05 * k, 0.0, 0.0))
    after = 3.8 + pause
    extrapolator.add_odometry(after, Pose(0.95, 0.0, 0.0))
    extrapolator.add_odometry(after + 0.2, Pose(0.95, 0.0, 0.9))
    prediction = extrapolator.predict(after)
    assert prediction.tf_local_tracking == pytest.approx(Pose(0.95, 0.0, 0.0))
    assert (prediction.gap is not None) == is_gap
    if is_gap:
        assert prediction.gap.poses[0] == prediction.tf_local_tracking
        assert any(abs(pose.theta - 0.9) < 1e-6 for pose in prediction.gap.poses)


def test_where_scans_are_sparse_no_interval_is_a_gap(extrapolator):
    for k in range(20):
        extrapolator.add_odometry(3.0 * k, Pose(0.8 * k, 0.0, 0.0))
        extrapolator.add_pose(3.0 * k, Pose(0.8 * k, 0.0, 0.0))
    extrapolator.add_odometry(60.0, Pose(16.0, 0.0, 0.0))
    assert extrapolator.predict(60.0).gap is None


def test_without_odometry_a_gap_is_as_uncertain_as_it_is_long(extrapolator):
    for k in range(20):
        extrapolator.add_pose(0.2 * k, Pose(0.1 * k, 0.0, 0.0))
    assert extrapolator.predict(4.0).gap is None
    errors = []
    for pause in (1.5, 2.0, 60.0):
        prediction = extrapolator.predict(3.8 + pause)
        assert prediction.gap.poses == (prediction.tf_local_tracking,)
        errors.append(prediction.gap.linear_error)
    assert errors[0] < errors[1] < errors[2] == MAX_ERROR_M
    # Where scans fit nowhere, it may be as far as it has been without a limit, at any heading.
    assert prediction.gap.lost_linear_error == pytest.approx(60.0 * VELOCITY_ERROR)
    assert prediction.gap.lost_angular_error == pytest.approx(ANY_HEADING_RAD)


def test_a_robot_with_a_gyroscope_is_not_lost_in_a_gap(extrapolator):
    for k in range(121):
        extrapolator.add_imu(Imu(0.1 * k, 0.1 * k, (0.0, 0.0, 0.1), (0.0, 0.0, 9.81)))
        if k <= 40:
            extrapolator.add_pose(0.1 * k, Pose(0.05 * k, 0.0, 0.01 * k))
    gap = extrapolator.predict(12.0).gap
    assert (gap.lost_linear_error, gap.lost_angular_error) == (gap.linear_error, gap.angular_error)


def test_after_a_gap_odometry_errs_by_a_share_of_the_distance(extrapolator):
    for k in range(20):
        extrapolator.add_odometry(0.2 * k, Pose(0.1 * k, 0.0, 0.0))
        extrapolator.add_pose(0.2 * k, Pose(0.1 * k, 0.0, 0.0))
    extrapolator.add_odometry(6.0, Pose(1.9 + 4.0, 0.0, 0.0))
    gap = extrapolator.predict(6.0).gap
    assert gap.linear_error == pytest.approx(ODOMETRY_ERROR_SHARE * 4.0)
    assert (gap.lost_linear_error, gap.lost_angular_error) == (gap.linear_error, gap.angular_error)
