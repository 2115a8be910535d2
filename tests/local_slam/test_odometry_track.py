# SPDX-License-Identifier: Apache-2.0
"""Odometry between, at, before and beyond its readings."""

from __future__ import annotations

import pytest

from cartoloop.local_slam.odometry_track import MAX_EXTRAPOLATION_S, MAX_HOLD_SHARE, OdometryTrack
from cartoloop.sensor.pose import Pose, relative


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


def test_motion_after_a_reset_is_known_at_the_next_reading():
    readings = track((1.0, 0.0, 0.0), (1.2, 0.1, 0.0), (1.4, 50.0, 0.0))
    assert readings.jumps_between(1.4, 1.5)
    assert not readings.jumps_between(1.0, 1.2)
