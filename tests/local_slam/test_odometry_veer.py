# SPDX-License-Identifier: Apache-2.0
"""The odometry's veer is found where it explains the turns, and nowhere else."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cartoloop.local_slam.matched_scans import MatchedScans, ScanSeries, latest
from cartoloop.local_slam.odometry_calibration import OdometryCalibration
from cartoloop.local_slam.odometry_parameters import OdometryParameters
from cartoloop.local_slam.odometry_track import OdometryTrack
from cartoloop.local_slam.odometry_veer import (
    MAX_VEER,
    MIN_STRETCHES,
    NO_VEER,
    Veer,
    estimate_veer,
)
from cartoloop.sensor.pose import IDENTITY, Pose, compose, relative_all, wrap_angles
from cartoloop.simulation import LIDARS, Difficulties, OdometryFault, make_world, simulate
from tests.local_slam.small_world import run

PERIOD, STEP = 0.2, 0.12
NOISE = (0.01, 0.003)
"""Of the odometry's heading, for each square root of a metre, and of a match [rad]."""


def drive(num_scans, seed):
    """Steps of a robot that drives straight on and turns now and then, at times and poses."""
    rng = np.random.default_rng(seed)
    turns = np.zeros(num_scans)
    for begin in range(0, num_scans - 20, 50):
        turns[begin : begin + 10] = rng.choice((-1.0, 0.5, 1.0)) * math.pi / 20.0
    steps = np.column_stack((np.full(num_scans, STEP), np.zeros(num_scans), turns))
    return PERIOD * np.arange(num_scans + 1), chained(steps)


def chained(steps):
    poses = [IDENTITY]
    for step in steps.tolist():
        poses.append(compose(poses[-1], Pose(*step)))
    return np.array(poses)


def reported(poses, veer, rng, scale=1.0, noise=NOISE[0]):
    """Odometry that lacks the turn of a veer on each step, its heading continuous."""
    steps = relative_all(poses[:-1], poses[1:])
    steps[:, 2] += rng.normal(size=len(steps)) * noise * math.sqrt(STEP)
    found, heading = [], 0.0
    for x, y, theta in steps.tolist():
        turn = theta / scale
        for _ in range(5):  # the veer depends on the heading in the middle of the step
            middle = heading + 0.5 * turn
            rate = veer.constant + veer.cos * math.cos(middle) + veer.sin * math.sin(middle)
            turn = theta / scale - rate * x
        found.append((x, y, turn))
        heading += turn
    return continuous(chained(np.array(found)))


def continuous(poses):
    return np.column_stack((poses[:, :2], np.unwrap(poses[:, 2])))


def matched(times, poses, rng, noise=NOISE[1]):
    turned = poses.copy()
    turned[:, 2] = wrap_angles(turned[:, 2] + rng.normal(size=len(poses)) * noise)
    return MatchedScans(times, turned, np.arange(len(times)) > 0)


def estimated(veer, num_scans=1500, seed=1, scale=1.0, **noise):
    rng = np.random.default_rng(seed)
    times, poses = drive(num_scans, seed)
    odometry = reported(poses, veer, rng, scale, **noise)
    return estimate_veer(matched(times, poses, rng), times, odometry)


rates = st.floats(0.01, 0.06) | st.floats(-0.06, -0.01)


@settings(deadline=None, max_examples=15)
@given(rate=rates, scale=st.floats(0.9, 1.1), seed=st.integers(0, 99))
def test_a_constant_veer_is_found(rate, scale, seed):
    found, number = estimated(Veer(rate), seed=seed, scale=scale)
    assert found.constant == pytest.approx(rate, abs=0.004)
    assert math.hypot(found.cos, found.sin) < 0.006
    assert number == pytest.approx(1500 * STEP, abs=2)


@settings(deadline=None, max_examples=15)
@given(amplitude=st.floats(0.015, 0.04), phase=st.floats(-3.0, 3.0), seed=st.integers(0, 99))
def test_the_veer_of_a_synchro_drive_is_found(amplitude, phase, seed):
    true = Veer(0.005, amplitude * math.cos(phase), amplitude * math.sin(phase))
    assert estimated(true, seed=seed)[0] == pytest.approx(true, abs=0.006)


# Always the same drives: of thousands, one exceeds any bound that means something.
@settings(deadline=None, max_examples=25, derandomize=True)
@given(seed=st.integers(0, 9999), num_scans=st.integers(520, 1500), noise=st.floats(0.0, 0.05))
def test_noise_without_veer_gives_next_to_none(seed, num_scans, noise):
    """Random errors of the heading, however large, are nowhere near a veer that matters."""
    found, number = estimated(NO_VEER, num_scans, seed, noise=noise)
    length = STEP * num_scans
    assert math.hypot(*found) < 6.0 * (noise + 1e-4) / math.sqrt(length)
    assert number >= MIN_STRETCHES


def test_noise_is_almost_never_a_veer():
    found = [estimated(NO_VEER, 600, seed)[0] for seed in range(60)]
    assert sum(veer != NO_VEER for veer in found) <= 2


@pytest.mark.parametrize("num_scans", [1, 2, 10, 100])
def test_a_short_drive_keeps_what_was_known(num_scans):
    rng = np.random.default_rng(0)
    times, poses = drive(num_scans, 0)
    scans = matched(times, poses, rng)
    odometry = reported(poses, Veer(0.05), rng)
    for before in (NO_VEER, Veer(0.03)):
        found, number = estimate_veer(scans, times, odometry, previous=before)
        assert found == before
        assert number < MIN_STRETCHES
    assert estimate_veer(scans, times[:1], odometry[:1], previous=Veer(0.03)) == (Veer(0.03), 0)


def test_what_the_latest_scans_do_not_show_is_kept():
    """Straight on, only what the heading of the corridor gives is determined."""
    true = Veer(0.004, 0.02, -0.01)
    rng = np.random.default_rng(5)
    times = PERIOD * np.arange(801)
    poses = chained(np.tile((STEP, 0.0, 0.0), (800, 1)))
    odometry = reported(poses, true, rng, noise=0.002)
    known, _ = estimate_veer(matched(times, poses, rng), times, odometry, previous=true)
    assert known == pytest.approx(true, abs=0.006)


def test_a_veer_that_vanishes_is_given_up():
    rng = np.random.default_rng(6)
    times, poses = drive(1500, 6)
    odometry = reported(poses, NO_VEER, rng)
    found, _ = estimate_veer(matched(times, poses, rng), times, odometry, previous=Veer(0.05))
    assert abs(found.constant) < 0.003


def test_one_slip_is_no_veer():
    rng = np.random.default_rng(7)
    times, poses = drive(800, 7)
    odometry = reported(poses, NO_VEER, rng)
    steps = relative_all(odometry[:-1], odometry[1:])
    steps[300:340, 2] += 0.02
    found, _ = estimate_veer(matched(times, poses, rng), times, continuous(chained(steps)))
    assert math.hypot(*found) < 0.003


def test_steps_that_are_not_usable_do_not_count():
    rng = np.random.default_rng(8)
    times, poses = drive(800, 8)
    scans = matched(times, poses, rng)
    odometry = reported(poses, Veer(0.05), rng)
    found, number = estimate_veer(
        scans._replace(is_usable=np.zeros(len(times), dtype=bool)), times, odometry
    )
    assert (found, number) == (NO_VEER, 0)


def test_a_turn_that_no_robot_veers_is_not_learnt():
    assert estimated(Veer(1.5 * MAX_VEER))[0] == NO_VEER


def test_a_clock_offset_is_taken_into_account():
    rng = np.random.default_rng(9)
    times, poses = drive(1500, 9)
    odometry = reported(poses, Veer(0.03), rng)
    found, _ = estimate_veer(matched(times + 0.6, poses, rng), times, odometry, 0.6)
    assert found.constant == pytest.approx(0.03, abs=0.004)


def test_driving_backwards_veers_to_the_other_side():
    ahead, back = (Veer(0.05).corrected(Pose(x, 0.0, 0.0), 0.3) for x in (0.4, -0.4))
    assert ahead.theta == -back.theta == pytest.approx(0.02)


@settings(deadline=None, max_examples=40)
@given(
    veer=st.builds(Veer, *[st.floats(-0.1, 0.1)] * 3),
    heading=st.floats(-7.0, 7.0),
    length=st.floats(-0.5, 0.5),
)
def test_a_corrected_step_is_an_arc(veer, heading, length):
    """The limit of many short steps; to the third order in the turn."""
    whole = veer.corrected(Pose(length, 0.0, 0.0), heading)
    rate = veer.constant + veer.cos * math.cos(heading) + veer.sin * math.sin(heading)
    parts = chained(np.tile((length / 50, 0.0, rate * length / 50), (50, 1)))[-1]
    assert whole == pytest.approx(tuple(parts), abs=1e-3)


def test_scans_of_two_scanners_are_not_steps_of_each_other():
    one, other = ScanSeries(), ScanSeries()
    for series, times in ((one, (0.0, 1.0, 2.0)), (other, (0.5, 1.5))):
        for time in times:
            series.add(time, Pose(time, 0.0, 0.0), is_matched=True)
    scans = latest([one, other], 2)
    assert scans.times.tolist() == scans.poses[:, 0].tolist() == [1.0, 2.0, 0.5, 1.5]
    assert scans.is_usable.tolist() == [False, True, False, True]
    assert one.is_usable == [False, True, True]


def test_the_veer_is_learnt_while_scans_come_in():
    rng = np.random.default_rng(3)
    times, poses = drive(1000, 3)
    true = Veer(-0.04)
    scans, odometry = matched(times, poses, rng), reported(poses, true, rng)
    calibration, track = OdometryCalibration(), OdometryTrack()
    for time, scan, reading in zip(
        times.tolist(), scans.poses.tolist(), odometry.tolist(), strict=True
    ):
        track.add(time, Pose(*reading))
        calibration.add(time, Pose(*scan), track)
    model = calibration.model
    assert model.veer.constant == pytest.approx(-0.04, abs=0.006)
    assert model.summary()["veer_rad_per_m"]["constant"] == model.veer.constant
    assert model.rotation_scale == pytest.approx(1.0, abs=0.02)
    assert model.rotation_error < 0.008


def test_what_is_known_before_a_drive_is_used_at_once():
    known = OdometryParameters(veer=Veer(0.03), rotation_error=0.01, translation_error=0.01)
    times, poses = drive(120, 4)
    calibration, track = OdometryCalibration(known), OdometryTrack()
    odometry = reported(poses, known.veer, np.random.default_rng(4))
    for time, scan, reading in zip(times.tolist(), poses.tolist(), odometry.tolist(), strict=True):
        track.add(time, Pose(*reading))
        calibration.add(time, Pose(*scan), track)
        assert calibration.model.veer == known.veer


def test_the_veer_of_a_simulated_drive_is_found():
    bad = Difficulties(odometry_faults=(OdometryFault.VEER,))
    recording = simulate(
        make_world("ring"), LIDARS["sick-180"], seed=2, duration=120.0, difficulties=bad
    )
    steps = [relative_all(p[:-1], p[1:]) for p in (recording.true_poses, recording.odometry_poses)]
    driven = steps[0][:, 0] > 0.05
    missing = float(np.median((steps[0] - steps[1])[driven, 2] / steps[0][driven, 0]))

    _, _, slam = run(recording.events())

    veer = slam.extrapolator.odometry.model.veer
    assert abs(missing) > 0.01
    assert veer.constant == pytest.approx(missing, abs=0.008)
