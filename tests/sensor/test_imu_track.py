# SPDX-License-Identifier: Apache-2.0
"""Which way is up and how the robot turned, from accelerations and angular velocities."""

from __future__ import annotations

import math

import numpy as np
import pytest

from cartoloop.sensor.events import Imu
from cartoloop.sensor.imu_track import MAX_GAP_S, MAX_REACH_S, MEMORY, ImuTrack
from cartoloop.simulation import World, drive
from cartoloop.simulation.drives import simulate_rig
from cartoloop.simulation.gait import Gait
from cartoloop.simulation.imu import ImuModel
from cartoloop.simulation.motion import delayed

RATE = 100.0
UP = (0.0, 0.0, 9.81)


def track_of(readings, time_constant=10.0):
    track = ImuTrack(time_constant)
    for time, acceleration, rate in readings:
        track.add(Imu(time, time, acceleration, rate))
    return track


def steady(duration, acceleration=UP, rate=(0.0, 0.0, 0.0), begin=0.0):
    return [(begin + k / RATE, acceleration, rate) for k in range(int(duration * RATE) + 1)]


def test_a_level_robot_at_rest_is_level():
    track = track_of(steady(3.0))
    assert track.measures_gravity
    assert track.at(np.array((0.5, 2.5))) == pytest.approx(np.zeros((2, 3)))
    assert track.max_tilt == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize(("roll", "pitch"), [(0.1, 0.0), (0.0, 0.1), (-0.2, 0.3)])
def test_roll_and_pitch_follow_from_gravity(roll, pitch):
    up = (-math.sin(pitch), math.cos(pitch) * math.sin(roll), math.cos(pitch) * math.cos(roll))
    track = track_of(steady(1.0, tuple(9.81 * part for part in up)))
    assert track.at(np.array((0.5,)))[0, :2] == pytest.approx((roll, pitch))


def test_an_acceleration_without_gravity_is_ignored():
    track = track_of(steady(5.0, (0.3, 0.0, 0.2), (0.0, 0.0, 0.5)))
    assert not track.measures_gravity
    assert track.max_tilt == 0.0
    assert np.ptp(track.at(np.array((1.0, 3.0)))[:, 2]) == pytest.approx(1.0)


def test_the_heading_is_integrated_and_shortly_extrapolated():
    track = track_of(steady(2.0, rate=(0.0, 0.0, 0.5)))
    turned = track.at(np.array((1.0, 2.0, 2.0 + MAX_REACH_S, 9.0)))[:, 2]
    assert np.diff(turned) == pytest.approx((0.5, 0.5 * MAX_REACH_S, 0.0))


def test_only_lasting_accelerations_change_the_tilt():
    pushed = steady(20.0) + steady(0.5, (2.0, 0.0, 9.81), begin=20.01)
    assert abs(track_of(pushed).at(np.array((20.5,)))[0, 1]) < 0.02
    leaning = steady(20.0) + steady(60.0, (2.0, 0.0, 9.81), begin=20.01)
    assert track_of(leaning).at(np.array((80.0,)))[0, 1] == pytest.approx(
        -math.atan2(2.0, 9.81), abs=0.03
    )


def test_the_bias_is_the_mean_rate_at_rest():
    track = track_of(steady(2.5, rate=(0.01, -0.02, 0.03)))
    assert track.num_rests == 2
    assert track.gyro_bias == pytest.approx((0.01, -0.02, 0.03), abs=5e-4)
    before, after = track.at(np.array((2.1, 2.4)))[:, 2]
    assert after - before == pytest.approx(0.0, abs=1e-4)


def test_a_steady_turn_that_scans_confirm_is_no_bias():
    track = ImuTrack(10.0)
    for time, acceleration, rate in steady(3.0, rate=(0.0, 0.0, 0.05)):
        track.add(Imu(time, time, acceleration, rate))
        track.note_standing(False)
    assert track.num_rests == 0
    assert track.gyro_bias == (0.0, 0.0, 0.0)


def test_a_fast_turn_is_no_bias():
    assert track_of(steady(3.0, rate=(0.0, 0.0, 0.5))).num_rests == 0


def test_a_walkers_tilt_is_estimated_within_a_degree():
    route = np.array([(0.0, 0.0), (9.0, 0.0), (9.0, 6.0), (0.0, 6.0), (0.0, 0.0)])
    motion = delayed(drive(route, speed=1.2), 3.0)
    gait = Gait(math.radians(8.0), 0.015, start=3.0)
    recording = simulate_rig(
        World("yard", np.empty((0, 4)), route), gait=gait, imu=ImuModel(), motion=motion
    )
    track = ImuTrack(10.0)
    for event in recording.events():
        if isinstance(event, Imu):
            track.add(event)
    times = np.arange(4.0, motion.duration, 0.05)
    off = track.at(times + recording.start_stamp)[:, :2] - gait.attitudes_at(times)
    assert math.degrees(np.sqrt((off**2).mean())) < 1.0
    assert math.degrees(np.abs(gait.attitudes_at(times)).max()) > 5.0


def test_an_imu_on_its_side_does_not_measure_gravity():
    assert not track_of(steady(1.0, (9.81, 0.0, 0.0))).measures_gravity


def test_an_imu_without_acceleration_gives_the_heading():
    track = track_of(steady(1.0, (0.0, 0.0, 0.0), (0.0, 0.0, 1.0)))
    assert not track.measures_gravity
    assert np.ptp(track.at(np.array((0.0, 1.0)))[:, 2]) == pytest.approx(1.0)


def test_headings_are_not_known_across_gaps_nor_outside():
    track = track_of(steady(1.0) + steady(1.0, begin=1.5 + MAX_GAP_S))
    assert track.covers(0.2, 0.9)
    assert track.covers(1.6 + MAX_GAP_S, 2.5 + MAX_GAP_S + MAX_REACH_S)
    assert not track.covers(0.9, 1.7 + MAX_GAP_S)
    assert not track.covers(-0.1, 0.5)
    assert not track.covers(1.6 + MAX_GAP_S, 3.0 + MAX_GAP_S)
    assert not ImuTrack(10.0).covers(0.0, 1.0)


def test_late_and_repeated_readings_are_ignored():
    track = track_of([*steady(1.0), (0.5, UP, (0.0, 0.0, 9.0)), (1.0, UP, (0.0, 0.0, 9.0))])
    assert track.num_readings == 101
    assert track.at(np.array((1.0,)))[0, 2] == 0.0


def test_hours_of_readings_do_not_fill_the_memory():
    track = track_of((k / RATE, UP, (0.0, 0.0, 0.5)) for k in range(2 * MEMORY))
    assert len(track.headings()[0]) == MEMORY
    assert track.num_readings == 2 * MEMORY
    end = (2 * MEMORY - 1) / RATE
    assert np.ptp(track.at(np.array((end - 1.0, end)))[:, 2]) == pytest.approx(0.5)
