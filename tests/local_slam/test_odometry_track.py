# SPDX-License-Identifier: Apache-2.0
"""Odometry between, at, before and beyond its readings."""

from __future__ import annotations

import math

import numpy as np
import pytest

from cartoloop.local_slam.odometry_track import MAX_EXTRAPOLATION_S, MAX_HOLD_SHARE, OdometryTrack
from cartoloop.sensor.pose import IDENTITY, Pose, relative, wrap_angle


def track(*readings):
    track = OdometryTrack()
    for time, x, theta in readings:
        track.add(time, Pose(x, 2.0 * x, theta))
    return track


def test_a_track_without_readings_has_no_pose():
    assert OdometryTrack().at(0.0) is None
    times, poses = OdometryTrack().arrays()
    assert times.shape == (0,)
    assert poses.shape == (0, 3)


def test_readings_are_returned_as_they_are():
    readings = track((1.0, 0.0, 0.0), (1.2, 0.5, 0.1), (1.4, 0.7, -0.1))
    for time, x, theta in ((1.0, 0.0, 0.0), (1.2, 0.5, 0.1), (1.4, 0.7, -0.1)):
        assert readings.at(time) == pytest.approx(Pose(x, 2.0 * x, theta))


def test_odometry_has_moved_once_a_reading_differs():
    repeated = (1.0, 0.3, 0.1), (1.2, 0.3, 0.1)
    assert not track().has_moved
    assert not track(*repeated).has_moved
    assert track(*repeated, (1.4, 0.31, 0.1), (1.6, 0.31, 0.1)).has_moved


def test_between_readings_the_motion_is_straight():
    readings = track((1.0, 0.0, 0.0), (2.0, 1.0, 0.4))
    assert readings.at(1.25) == pytest.approx(Pose(0.25, 0.5, 0.1))


def test_turns_across_the_half_turn_are_short():
    readings = track((1.0, 0.0, 3.1), (2.0, 0.0, -3.1))
    assert abs(readings.at(1.5).theta) > 3.1


def test_before_the_first_reading_nothing_is_known():
    readings = track((1.0, 0.0, 0.0), (2.0, 1.0, 0.0))
    assert readings.at(0.999) is None


def test_motion_is_extrapolated_shortly_after_the_end():
    readings = track((1.0, 0.0, 0.0), (1.5, 1.0, 0.2))
    assert readings.at(1.75) == pytest.approx(Pose(1.5, 3.0, 0.3))


def test_long_after_the_end_nothing_is_known():
    readings = track((1.0, 0.0, 0.0), (1.5, 1.0, 0.2))
    assert readings.at(1.5 + MAX_EXTRAPOLATION_S) == pytest.approx(Pose(2.0, 4.0, 0.4))
    assert readings.at(1.51 + MAX_EXTRAPOLATION_S) is None


def test_readings_that_arrive_together_determine_no_speed():
    steady = [(0.2 * n, 0.1 * n, 0.0) for n in range(20)]
    burst = [(4.5 + 0.001 * n, 1.9 + 0.1 * n, 0.0) for n in range(1, 5)]
    readings = track(*steady, *burst)
    assert readings.num_jumps == 0
    assert readings.at(4.604).x == pytest.approx(2.3 + 0.1 * 0.4 / 0.704)


def test_a_reading_that_arrived_late_is_no_jump():
    fast = [(0.2 * n, 0.2 * n, 0.0) for n in range(60)]
    late = [(12.3, 12.0, 0.0), (12.3005, 12.3, 0.0)]
    assert track(*fast, *late).num_jumps == 0


def test_readings_at_random_jump_often_and_resets_do_not():
    rng = np.random.default_rng(1)
    wild = track(*((0.2 * n, *rng.uniform(-9.0, 9.0, 2).tolist()) for n in range(50)))
    reset = track(*((0.2 * n, 0.1 * (n % 20), 0.0) for n in range(400)))
    assert wild.jumps_often
    assert reset.num_jumps >= 10
    assert not reset.jumps_often


def test_a_single_reading_is_extrapolated_for_a_moment():
    readings = track((1.0, 0.5, 0.1))
    assert readings.at(1.01) == pytest.approx(Pose(0.5, 1.0, 0.1))
    assert readings.at(1.3) is None


def test_readings_far_apart_do_not_determine_a_speed():
    readings = track((1.0, 0.0, 0.0), (11.0, 10.0, 0.0))
    assert readings.at(11.0 + 9.0 * MAX_HOLD_SHARE) == pytest.approx(Pose(10.0, 20.0, 0.0))
    assert readings.at(11.0 + 11.0 * MAX_HOLD_SHARE) is None


def test_of_readings_at_one_time_the_last_is_kept():
    readings = track((1.0, 0.0, 0.0), (2.0, 1.0, 0.0), (2.0, 3.0, 0.0))
    assert len(readings) == 2
    assert readings.at(2.0).x == 3.0


def test_readings_older_than_the_last_are_ignored():
    readings = track((1.0, 0.0, 0.0), (2.0, 1.0, 0.0), (1.5, 77.0, 0.0), (3.0, 2.0, 0.0))
    assert readings.arrays()[0].tolist() == [1.0, 2.0, 3.0]
    assert readings.at(1.5).x == pytest.approx(0.5)


def test_reset_odometry_continues_from_its_last_pose():
    readings = track((1.0, 5.0, 0.5), (1.2, 5.2, 0.5), (1.4, 0.0, 0.0), (1.6, 0.1, 0.0))
    assert readings.num_jumps == 1
    assert readings.at(1.4) == pytest.approx(readings.at(1.2))
    moved = relative(readings.at(1.4), readings.at(1.6))
    assert moved == pytest.approx(Pose(0.1, 0.2, 0.0))


def test_a_jump_of_the_heading_alone_is_a_reset():
    readings = track((1.0, 0.0, 0.0), (1.02, 0.0, 2.5), (1.04, 0.0, 2.55))
    assert readings.num_jumps == 1
    assert readings.at(1.04).theta == pytest.approx(0.05)


def test_a_single_stray_reading_moves_nothing():
    readings = track((1.0, 0.0, 0.0), (1.2, 0.1, 0.0), (1.4, 90.0, 0.0), (1.6, 0.3, 0.0))
    assert readings.num_jumps == 2
    assert readings.at(1.6) == pytest.approx(Pose(0.1, 0.2, 0.0))


def test_a_long_distance_in_a_long_time_is_no_jump():
    readings = track((1.0, 0.0, 0.0), (11.0, 8.0, 3.0))
    assert readings.num_jumps == 0
    assert readings.at(11.0) == pytest.approx(Pose(8.0, 16.0, 3.0))


def test_a_second_reading_at_a_reset_replaces_it():
    readings = track((1.0, 5.0, 0.0), (1.2, 0.0, 0.0), (1.2, 0.01, 0.0), (1.4, 0.11, 0.0))
    assert readings.num_jumps == 1
    assert readings.at(1.4).x == pytest.approx(5.11)


def test_motion_across_a_reset_is_not_known():
    readings = track((1.0, 0.0, 0.0), (1.2, 0.1, 0.0), (1.4, 50.0, 0.0), (1.6, 50.1, 0.0))
    assert not readings.jumps_between(1.0, 1.2)
    assert readings.jumps_between(1.1, 1.3)
    assert readings.jumps_between(1.3, 1.1)
    assert readings.jumps_between(1.3, 1.5)
    assert not readings.jumps_between(1.4, 1.7)


def test_across_resets_poses_are_known_as_they_were_reported():
    reported = (1.0, 0.0, 0.0), (1.2, 0.1, 0.0), (1.4, 50.0, 2.0), (1.6, 50.1, 2.1), (1.8, 0.3, 0.1)
    readings = track(*reported)
    assert readings.num_jumps == 2
    for time, x, theta in reported:
        assert readings.reported_at(time) == pytest.approx(Pose(x, 2.0 * x, theta))
    assert readings.reported_at(1.5) == pytest.approx(Pose(50.05, 100.1, 2.05))
    assert readings.reported_at(0.9) is None


def test_right_before_a_reset_the_pose_after_it_is_reported():
    readings = track((1.0, 0.0, 0.0), (1.2, 0.1, 0.0), (1.4, 50.0, 2.0), (1.6, 50.1, 2.1))
    assert readings.reported_at(1.2) == pytest.approx(Pose(0.1, 0.2, 0.0))
    assert readings.reported_at(1.35) == pytest.approx(Pose(50.0, 100.0, 2.0))


def test_a_step_from_right_before_a_reset_is_known():
    readings = track((1.0, 0.0, 0.0), (1.2, 0.1, 0.0), (1.4, 50.0, 0.0), (1.6, 50.1, 0.0))
    assert readings.known_from(1.32, 1.52) == 1.4
    # half of the step would not be known
    assert readings.known_from(1.25, 1.45) == 1.25
    assert readings.known_from(1.1, 1.3) == 1.1
    assert readings.known_from(1.5, 1.7) == 1.5


def test_motion_after_a_reset_is_known_at_the_next_reading():
    readings = track((1.0, 0.0, 0.0), (1.2, 0.1, 0.0), (1.4, 50.0, 0.0))
    assert readings.jumps_between(1.4, 1.5)
    assert not readings.jumps_between(1.0, 1.2)


def drive(until, period=0.2, speed=0.8, rate=0.5):
    """Return readings of a robot that has moved for a while: time, x, theta."""
    number = round(until / period)
    return [
        (k * period, k * period * speed / math.sqrt(5.0), k * period * rate)
        for k in range(number + 1)
    ]


def test_a_step_much_faster_than_all_before_is_a_reset():
    readings = drive(20.0)
    time, x, theta = readings[-1]
    jumped = track(*readings, (time + 0.2, x + 0.6, theta), (time + 0.4, x + 0.65, theta))
    assert jumped.num_jumps == 1
    assert relative(jumped.at(time), jumped.at(time + 0.2)) == pytest.approx(Pose(0.0, 0.0, 0.0))
    # At the beginning, nobody knows how fast the robot can be.
    assert track((0.0, 0.0, 0.0), (0.2, 0.05, 0.0), (0.4, 0.65, 0.0)).num_jumps == 0


def test_a_turn_much_faster_than_all_before_is_a_reset():
    readings = drive(20.0)
    time, x, theta = readings[-1]
    assert track(*readings, (time + 0.2, x, theta + 0.9)).num_jumps == 1
    assert track(*readings, (time + 0.2, x, theta + 0.4)).num_jumps == 0


def test_a_long_step_right_after_a_gap_may_be_of_the_gap():
    readings = drive(20.0)
    time, x, theta = readings[-1]
    late = track(*readings, (time + 3.0, x, theta + 0.4), (time + 3.2, x, theta + 1.4))
    assert late.num_jumps == 0


def test_a_second_reading_at_a_time_has_the_time_of_the_first():
    readings = [(0.1 * k, 0.05 * k, 0.0) for k in range(200)]
    # Several readings of a turn arrive with the stamp of the last one.
    readings += [(20.2, 10.1, 0.2), (20.2, 10.15, 0.45), (20.2, 10.2, 0.6), (20.3, 10.2, 0.7)]
    turning = track(*readings)
    assert turning.num_jumps == 0
    assert not turning.jumps_between(19.9, 20.3)
    assert turning.at(20.2) == pytest.approx(Pose(10.2, 20.4, 0.6))


def test_jitter_of_the_stamps_makes_no_resets():
    readings = [(time + 0.09 * (k % 3), x, theta) for k, (time, x, theta) in enumerate(drive(40.0))]
    assert track(*readings).num_jumps == 0


def repeating(readings, first, count):
    """Return readings, some of them repeating the one before."""
    return [
        (time, *readings[first - 1][1:]) if first <= k < first + count else (time, x, theta)
        for k, (time, x, theta) in enumerate(readings)
    ]


def test_a_reading_repeated_at_speed_is_left_out():
    true = drive(20.0, rate=0.1)
    readings = track(*repeating(true, 60, 9))
    assert readings.num_jumps == 0
    assert readings.num_late == 1
    assert readings.late_since == pytest.approx(true[59][0])
    for time, x, theta in true[60:69]:
        assert readings.at(time) == pytest.approx(Pose(x, 2.0 * x, theta))


def test_while_a_reading_is_repeated_the_motion_is_soon_unknown():
    true = drive(13.6)
    readings = track(*repeating(true, 60, 9))
    assert readings.at(12.0).x == pytest.approx(true[60][1])
    assert readings.at(12.5) is None


@pytest.mark.parametrize(("period", "braking"), [(0.2, 1.5), (0.05, 5.0)])
def test_a_robot_that_brakes_and_stands_is_believed(period, braking):
    at, speed, readings = 0.0, 0.8, []
    for k in range(round(24.0 / period)):
        readings.append((period * k, at, 0.0))
        at += period * speed / math.sqrt(5.0)
        if period * k > 12.0:
            speed = max(speed - braking * period, 0.0)
    stopped = track(*readings)
    assert stopped.num_late == 0
    assert stopped.at(13.5) == pytest.approx(stopped.at(15.0))


def test_a_robot_that_stands_for_long_is_believed_in_the_end():
    true = drive(20.0)
    readings = track(*repeating(true, 60, 40), (20.2, true[59][1] + 0.01, true[59][2]))
    assert readings.at(16.0) == pytest.approx(readings.at(19.0))


def test_that_readings_were_repeated_may_show_afterwards():
    true = [
        (time, x if k < 55 else true_x(k), theta) for k, (time, x, theta) in enumerate(drive(20.0))
    ]
    readings = track(*repeating(true, 60, 9))
    assert readings.num_late == 1
    assert readings.late_since == pytest.approx(true[59][0])
    time, x, theta = true[64]
    found = readings.at(time)
    assert found.x == pytest.approx(x)
    assert wrap_angle(found.theta - theta) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(("turn", "is_caught_up"), [(1.5, True), (0.5, False)])
def test_a_robot_just_started_turns_no_faster_than_any(turn, is_caught_up):
    rests = [(0.2 * k, 0.02 * min(k, 3), 0.0) for k in range(8)]
    readings = track(*rests, (1.6, 0.06, turn))
    assert readings.num_late == is_caught_up
    assert readings.at(1.1).theta == pytest.approx(0.5 * turn if is_caught_up else 0.0)


@pytest.mark.parametrize("step", [Pose(0.9, 0.0, 0.0), Pose(0.0, 0.0, 0.9)])
def test_the_first_motion_of_a_robot_is_of_its_own_time(step):
    readings = OdometryTrack()
    for k in range(100):
        readings.add(0.05 * k, IDENTITY)
    readings.add(5.0, step)
    assert readings.num_late == 0
    assert readings.at(4.9) == IDENTITY


def test_a_reset_of_the_position_is_of_its_own_time():
    rests = [(0.2 * k, 0.02 * min(k, 3), 0.0) for k in range(12)]
    readings = track(*rests, (2.4, 0.5, 0.0), (2.402, 0.6, 0.0))
    assert readings.num_late == 0
    assert readings.at(2.2).x == pytest.approx(0.06)


def true_x(k):
    """Place of a robot that turns almost on the spot, where a repeated reading is no surprise."""
    return 54 * 0.2 * 0.8 / math.sqrt(5.0) + (k - 54) * 0.2 * 0.2 / math.sqrt(5.0)


def after_a_gap(*readings):
    """Return readings of a robot that turned by a radian in a gap of 3 s, and then some."""
    true = drive(20.0)
    time, x, theta = true[-1]
    return time, theta, track(*true, *[(time + since, x, theta + turn) for since, turn in readings])


def test_a_reading_of_before_the_end_of_a_gap_is_left_out():
    end, theta, readings = after_a_gap((3.0, 0.2), (3.2, 1.0))
    assert readings.num_jumps == 0
    assert wrap_angle(readings.at(end + 3.1).theta - theta) == pytest.approx(3.1 / 3.2)


def test_what_a_robot_does_after_a_gap_is_kept():
    end, theta, readings = after_a_gap((3.0, 0.8), (3.2, 1.0))
    assert wrap_angle(readings.at(end + 3.0).theta - theta) == pytest.approx(0.8)


def test_the_next_reading_shows_what_happened_in_a_gap():
    end, _, readings = after_a_gap((3.0, 0.2))
    assert readings.known_until == pytest.approx(end)
    end, _, readings = after_a_gap((3.0, 0.2), (3.2, 0.3))
    assert readings.known_until == pytest.approx(end + 3.2)


def held_for(readings, count):
    """Return readings, only one in some new; the others repeat the one before."""
    return [(time, *readings[k - k % count][1:]) for k, (time, _, _) in enumerate(readings)]


def test_odometry_that_is_read_seldom_moves_in_between():
    """So slowly that a single repeated reading is no surprise."""
    true = drive(60.0, speed=0.2, rate=0.05)
    readings = track(*held_for(true, 5))
    assert readings.num_jumps == 0
    for time, x, theta in true[60:296]:
        assert readings.at(time) == pytest.approx(Pose(x, 2.0 * x, theta))


def test_a_reading_that_is_sent_again_shows_no_motion():
    true = drive(60.6, speed=0.2, rate=0.05)
    readings = track(*held_for(true, 5))
    assert readings.latest == pytest.approx(60.6)
    assert readings.known_until == pytest.approx(60.0)
    assert track(*true).known_until == pytest.approx(60.6)


def test_with_held_readings_a_robot_at_rest_is_believed():
    true = held_for(drive(60.0, speed=0.2, rate=0.05), 5)
    time, x, theta = true[-1]
    at_rest = [(time + 0.2 * k, x, theta) for k in range(1, 100)]
    readings = track(*true, *at_rest)
    assert readings.known_until == pytest.approx(time + 19.8)
    assert readings.at(time + 5.0) == pytest.approx(Pose(x, 2.0 * x, theta))
    sets_off = track(*true, *at_rest, (time + 20.0, x + 0.02, theta))
    assert sets_off.at(time + 15.0) == pytest.approx(Pose(x, 2.0 * x, theta))
    assert x < sets_off.at(time + 19.5).x < x + 0.02


def test_a_robot_that_sets_off_has_repeated_nothing():
    readings = drive(20.0)
    time, x, theta = readings[-1]
    stands = [(time + 0.2 * k, x, theta) for k in range(1, 20)]
    goes = [(time + 4.0 + 0.2 * k, x + 0.04 * k, theta + 0.1 * k) for k in range(10)]
    assert track(*readings, (time + 0.2, x, theta), *stands, *goes).num_late == 0


def test_a_step_from_a_little_before_the_first_reading_is_known():
    track = OdometryTrack()
    assert track.known_from(0.5, 3.0) == 0.5
    for time in (1.0, 2.0, 3.0):
        track.add(time, Pose(time, 0.0, 0.0))
    assert track.known_from(0.8, 3.0) == 1.0
    assert track.known_from(1.2, 3.0) == 1.2
    # most of what such a step covers is not known
    assert track.known_from(0.8, 1.2) == 0.8
    assert track.known_from(-5.0, 3.0) == -5.0


def test_readings_around_a_time_are_as_reported():
    readings = track((0.0, 0.0, 0.0), (0.2, 0.05, 0.0), (0.4, 7.0, 2.0), (3.0, 7.1, 2.5))
    assert readings.num_jumps == 1
    around = readings.reported_around(0.3, 0.5)
    assert around == [
        pytest.approx(Pose(0.05, 0.1, 0.0)),
        pytest.approx(Pose(7.0, 14.0, 2.0)),
    ]
    assert readings.reported_around(2.9, 0.5) == [pytest.approx(Pose(7.1, 14.2, 2.5))]
    assert readings.reported_around(1.5, 0.5) == []
    assert OdometryTrack().reported_around(1.5, 0.5) == []
