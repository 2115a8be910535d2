# SPDX-License-Identifier: Apache-2.0
"""The odometry's clock offset, scales, yaw and lever arm are found from the motion itself."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cartoloop.local_slam.clock_offset import explains_more_than_none, is_likelier_than_none
from cartoloop.local_slam.odometry_calibration import (
    MAX_SCALE,
    MIN_SCALE,
    OdometryCalibration,
    estimate,
)
from cartoloop.local_slam.odometry_parameters import OdometryParameters
from cartoloop.local_slam.odometry_track import OdometryTrack
from cartoloop.local_slam.odometry_veer import NO_VEER, Veer
from cartoloop.sensor.pose import (
    Pose,
    compose,
    compose_all,
    inverse,
    relative,
    relative_all,
    wrap_angles,
)

PERIOD, FINE = 0.2, 0.01
UNKNOWN = OdometryParameters()


def winding_way(duration=120.0, before=3.0):
    """Where a robot is that drives on, now to the left, now to the right: times, poses."""
    times = np.arange(-before, duration + before, FINE)
    speed = 0.6 + 0.3 * np.sin(0.31 * times)
    turn_rate = 0.7 * np.sin(0.83 * times) + 0.4 * np.sin(0.29 * times + 1.0)
    theta = np.cumsum(turn_rate) * FINE
    return times, np.column_stack(
        (np.cumsum(speed * np.cos(theta)) * FINE, np.cumsum(speed * np.sin(theta)) * FINE, theta)
    )


def at(times, way):
    """The poses of a way at other times."""
    return np.column_stack([np.interp(times, way[0], way[1][:, k]) for k in range(3)])


def reported_by(model, way):
    """Odometry of that drive with the errors that `model` corrects, at the scans' stamps."""
    fine_times, poses = way
    reporting_point = compose_all(poses, np.array((-model.lever_x, -model.lever_y, 0.0)))
    steps = relative_all(reporting_point[:-1], reporting_point[1:])
    steps = compose_all(np.array((0.0, 0.0, -model.yaw)), steps)
    steps[:, 2] += model.yaw
    steps /= (model.translation_scale, model.translation_scale, model.rotation_scale)
    heading = np.concatenate(([0.0], np.cumsum(steps[:, 2])))
    cos, sin = np.cos(heading[:-1]), np.sin(heading[:-1])
    x = np.concatenate(([0.0], np.cumsum(cos * steps[:, 0] - sin * steps[:, 1])))
    y = np.concatenate(([0.0], np.cumsum(sin * steps[:, 0] + cos * steps[:, 1])))
    stamps = np.arange(0.0, fine_times[-1] - 2.0, PERIOD)
    return stamps, at(stamps + model.time_offset, (fine_times, np.column_stack((x, y, heading))))


def matched(stamps, way, noise=(0.005, 0.002), seed=4):
    """The scans' poses as matched: the truth and some noise."""
    rng = np.random.default_rng(seed)
    poses = at(stamps, way)
    poses += rng.normal(size=poses.shape) * (noise[0], noise[0], noise[1])
    poses[:, 2] = wrap_angles(poses[:, 2])
    return poses


def calibrated(model, **kwargs):
    way = winding_way()
    stamps, odometry = reported_by(model, way)
    return estimate(stamps, matched(stamps, way, **kwargs), stamps, odometry, UNKNOWN)


@pytest.mark.parametrize("offset", [-0.64, -0.25, 0.0, 0.14, 0.64])
def test_the_offset_of_the_clock_is_found(offset):
    found = calibrated(OdometryParameters(time_offset=offset))
    assert found.time_offset == pytest.approx(offset, abs=0.02)


@pytest.mark.parametrize("scale", [0.5, 0.82, 1.0, 1.2, 2.0])
def test_the_scale_of_rotation_is_found(scale):
    found = calibrated(OdometryParameters(rotation_scale=scale, time_offset=0.1))
    assert found.rotation_scale == pytest.approx(scale, rel=0.02)


@pytest.mark.parametrize("seed", range(8))
def test_noisy_headings_on_straight_lines_are_no_turns(seed):
    """Most steps that seem to turn are noise; a few turn indeed, as reported."""
    times, poses = winding_way()
    poses[:, 2] = np.cumsum(np.where(np.mod(times, 60.0) < 1.5, FINE, 0.0))
    poses[:, :2] = np.cumsum(0.006 * np.stack((np.cos(poses[:, 2]), np.sin(poses[:, 2])), 1), 0)
    stamps, odometry = reported_by(UNKNOWN, (times, poses))
    scans = matched(stamps, (times, poses))
    scans[:, 2] += np.cumsum(np.random.default_rng(seed).normal(0.0, 0.015, len(stamps)))
    found = estimate(stamps, scans, stamps, odometry, UNKNOWN)
    assert found.rotation_scale == pytest.approx(1.0, abs=0.1)


@pytest.mark.parametrize("scale", [0.5, 0.9, 1.0, 1.1, 2.0])
def test_the_scale_of_distance_is_found(scale):
    found = calibrated(OdometryParameters(translation_scale=scale, time_offset=0.1))
    assert found.translation_scale == pytest.approx(scale, rel=0.01)


@pytest.mark.parametrize("yaw_deg", [-3.0, 0.0, 1.0])
def test_the_yaw_of_a_scanner_is_found(yaw_deg):
    """Half a degree unknown bends long corridors: each prediction lies to the side of the truth."""
    found = calibrated(OdometryParameters(yaw=math.radians(yaw_deg), lever_x=0.1))
    assert found.yaw == pytest.approx(math.radians(yaw_deg), abs=math.radians(0.2))
    assert found.lever_x == pytest.approx(0.1, abs=0.02)


@pytest.mark.parametrize("lever", [(0.0, 0.0), (0.3, 0.0), (-0.1, 0.2)])
def test_the_lever_arm_is_found(lever):
    found = calibrated(OdometryParameters(lever_x=lever[0], lever_y=lever[1]))
    assert (found.lever_x, found.lever_y) == pytest.approx(lever, abs=0.02)


def test_the_model_predicts_the_motion_up_to_noise():
    true = OdometryParameters(0.2, 0.9, 1.05, yaw=-0.03, lever_x=0.15, lever_y=-0.05)
    found = calibrated(true)
    assert found.is_known
    assert found.rotation_error < 0.006
    assert found.translation_error < 0.012


def test_the_errors_are_those_of_the_odometry():
    good, bad = (calibrated(UNKNOWN, noise=noise) for noise in ((0.002, 0.001), (0.02, 0.01)))
    assert good.translation_error < 0.3 * bad.translation_error
    assert good.rotation_error < 0.3 * bad.rotation_error


def test_occasional_false_matches_do_no_harm():
    way = winding_way()
    stamps, odometry = reported_by(OdometryParameters(0.1, 0.9, 1.05), way)
    poses = matched(stamps, way)
    poses[10::40] += np.random.default_rng(1).normal(scale=0.5, size=poses[10::40].shape)
    found = estimate(stamps, poses, stamps, odometry, UNKNOWN)
    assert found.time_offset == pytest.approx(0.1, abs=0.03)
    assert found.rotation_scale == pytest.approx(0.9, rel=0.02)
    assert found.translation_scale == pytest.approx(1.05, rel=0.02)


def test_a_robot_at_rest_does_not_change_the_model():
    stamps = np.arange(0.0, 60.0, PERIOD)
    noise = np.random.default_rng(2).normal(scale=1e-3, size=(len(stamps), 3))
    before = OdometryParameters(0.1, 0.95, rotation_error=0.01, translation_error=0.01)
    assert estimate(stamps, noise, stamps, np.zeros_like(noise), before) is before


def test_straight_driving_determines_only_scale_and_yaw():
    stamps = np.arange(0.0, 60.0, PERIOD)
    reported = np.column_stack((0.5 * stamps, 0.0 * stamps, 0.0 * stamps))
    yaw, scale = 0.02, 1.05
    true = np.column_stack(
        (scale * math.cos(yaw) * 0.5 * stamps, scale * math.sin(yaw) * 0.5 * stamps, 0.0 * stamps)
    )

    model = estimate(stamps, true, stamps, reported, UNKNOWN)

    assert (model.time_offset, model.rotation_scale) == (0.0, 1.0)
    assert model.translation_scale == pytest.approx(scale, abs=1e-3)
    assert model.yaw == pytest.approx(yaw, abs=1e-3)


def test_a_standing_robot_does_not_change_the_model():
    stamps = np.arange(0.0, 60.0, PERIOD)
    poses = np.zeros((len(stamps), 3))
    assert estimate(stamps, poses, stamps, poses, UNKNOWN) is UNKNOWN


def test_odometry_at_rest_during_a_turn_is_not_used():
    way = winding_way()
    stamps = np.arange(0.0, 100.0, PERIOD)
    frozen = np.zeros((len(stamps), 3))
    assert estimate(stamps, matched(stamps, way), stamps, frozen, UNKNOWN) is UNKNOWN


def test_no_odometry_does_not_change_the_model():
    stamps = np.arange(0.0, 10.0, PERIOD)
    poses = matched(stamps, winding_way())
    for count in (0, 1):
        odometry = np.zeros((count, 3))
        assert estimate(stamps, poses, np.zeros(count), odometry, UNKNOWN) is UNKNOWN


@pytest.mark.parametrize("seed", range(5))
def test_a_metre_of_noisy_steps_shows_no_other_scale(seed):
    """Slow steps that are matched to a centimetre, forwards by 5 mm too little in each."""
    stamps = 0.2 * np.arange(31)
    reported = np.zeros((31, 3))
    reported[:, 0] = 0.03 * np.arange(31)
    steps = np.random.default_rng(seed).normal((0.025, 0.0, 0.0), (0.01, 0.01, 0.002), (31, 3))
    scans = np.cumsum(steps, axis=0)
    scans[:, 2] = 0.0
    assert estimate(stamps, scans, stamps, reported, UNKNOWN).translation_scale > 0.9
    assert reported[-1, 0] < 1.0


def test_scales_stay_within_what_is_plausible():
    found = calibrated(OdometryParameters(rotation_scale=3.0, translation_scale=5.0))
    for scale in (found.rotation_scale, found.translation_scale):
        assert MIN_SCALE <= scale <= MAX_SCALE


def test_the_model_is_estimated_while_scans_come_in():
    true = OdometryParameters(0.1, 0.9, 1.05)
    way = winding_way()
    stamps, odometry = reported_by(true, way)
    odometry[:, 2] = wrap_angles(odometry[:, 2])
    calibration, track = OdometryCalibration(), OdometryTrack()
    for stamp, scan, reading in zip(
        stamps.tolist(), matched(stamps, way).tolist(), odometry.tolist(), strict=True
    ):
        track.add(stamp, Pose(*reading))
        calibration.add(stamp, Pose(*scan), track)
        if stamp < 2.0:
            assert not calibration.model.is_known
    assert calibration.model.time_offset == pytest.approx(0.1, abs=0.03)
    assert calibration.model.rotation_scale == pytest.approx(0.9, rel=0.02)
    assert calibration.model.translation_scale == pytest.approx(1.05, rel=0.02)


def left_out(odometry):
    """A calibration by scans, all of whose steps contradict the odometry."""
    way = winding_way()
    stamps, _ = reported_by(UNKNOWN, way)
    track, calibration = OdometryTrack(), OdometryCalibration()
    for time, pose, said in zip(stamps, matched(stamps, way), odometry, strict=True):
        track.add(float(time), Pose(*said.tolist()))
        calibration.add(float(time), Pose(*pose.tolist()), track, num_faulty=1)
    return calibration.model


def test_odometry_is_not_left_out_for_a_wrong_calibration():
    turned = OdometryParameters(yaw=math.radians(90.0), time_offset=0.1)
    _, odometry = reported_by(turned, winding_way())
    found = left_out(odometry)
    assert found.yaw == pytest.approx(turned.yaw, abs=math.radians(0.5))
    assert found.time_offset == pytest.approx(0.1, abs=0.02)


def test_what_no_calibration_explains_stays_left_out():
    _, odometry = reported_by(UNKNOWN, winding_way())
    rng = np.random.default_rng(1)
    random = np.cumsum(rng.normal(0.0, 0.05, odometry.shape), axis=0)
    for wrong in (np.zeros_like(odometry), odometry * (0.0, 0.0, 1.0), random):
        assert left_out(wrong) == UNKNOWN


def test_what_readings_do_not_show_is_not_used():
    """Those of half a minute are missing; between them the robot drove in curves."""
    model = OdometryParameters(rotation_scale=1.1, translation_scale=0.95, lever_x=0.1)
    way = winding_way()
    stamps, reported = reported_by(model, way)
    scans = matched(stamps, way)
    is_there = (stamps < 40.0) | (stamps > 70.0)
    whole = estimate(stamps, scans, stamps, reported, UNKNOWN)
    found = estimate(stamps, scans, stamps[is_there], reported[is_there], UNKNOWN)
    assert found.rotation_scale == pytest.approx(whole.rotation_scale, abs=0.01)
    assert found.translation_scale == pytest.approx(whole.translation_scale, abs=0.01)
    assert found.translation_error == pytest.approx(whole.translation_error, rel=0.2)


def test_sparse_readings_do_not_show_an_offset():
    """Scans at irregular times between readings a second apart: averaging these explains a part."""
    rng = np.random.default_rng(8)
    way = winding_way()
    stamps = np.arange(0.0, 110.0)
    poses = matched(stamps - rng.uniform(0.0, 0.7, len(stamps)), way)
    found = estimate(stamps, poses, stamps, at(stamps, way), UNKNOWN)
    assert found.time_offset == 0.0
    assert found.knows_rotation


@pytest.mark.parametrize("seed", range(5))
def test_noise_is_no_offset(seed):
    rng = np.random.default_rng(seed)
    way = winding_way(duration=10.0)
    stamps, odometry = reported_by(UNKNOWN, way)
    odometry[:, 2] += np.cumsum(rng.normal(scale=0.05, size=len(odometry)))
    found = estimate(stamps, matched(stamps, way), stamps, odometry, UNKNOWN)
    assert found.time_offset == 0.0


def test_an_accepted_offset_stays_while_it_is_better_than_none():
    way = winding_way()
    stamps, odometry = reported_by(OdometryParameters(0.1), way)
    few = slice(0, 35)
    poses = matched(stamps, way, noise=(0.005, 0.01))
    before = OdometryParameters(0.1)
    found = [
        estimate(stamps[few], poses[few], stamps, odometry, model).time_offset
        for model in (UNKNOWN, before)
    ]
    assert found == [0.0, 0.1]


def test_the_further_readings_are_apart_the_more_is_required():
    errors = np.random.default_rng(3).normal(size=400)
    exact = np.zeros(9)
    assert explains_more_than_none(0.6 * errors, errors, 0.2, exact)
    assert not explains_more_than_none(0.6 * errors, errors, 0.5, exact)
    assert not explains_more_than_none(0.01 * errors, errors, 1.0, exact)
    assert not explains_more_than_none(exact, exact, 0.1, exact)


def test_the_noise_of_matches_hides_no_offset():
    """It is in all errors: what is left of them at the offset is mostly noise."""
    errors = np.random.default_rng(3).normal(size=400)
    assert explains_more_than_none(0.6 * errors, errors, 0.5, 0.5 * errors)
    assert not explains_more_than_none(0.6 * errors, errors, 0.5, 0.1 * errors)
    assert not explains_more_than_none(0.9 * errors, errors, 0.5, errors[:0])


def test_a_few_smaller_errors_may_be_chance():
    errors = np.random.default_rng(3).normal(size=400)
    assert is_likelier_than_none(0.6 * errors, errors)
    assert not is_likelier_than_none(0.6 * errors[:15], errors[:15])
    assert not is_likelier_than_none(errors, errors)
    assert not is_likelier_than_none(np.zeros(9), np.zeros(9))


@pytest.mark.parametrize("duration, is_known", [(25.0, False), (60.0, True)])
def test_while_an_offset_is_likely_the_rotation_is_not_known(duration, is_known):
    """Matches would be drawn to the odometry, turn when it does and never show the offset."""
    way = winding_way(duration)
    stamps, odometry = reported_by(OdometryParameters(0.3), way)
    rare = slice(None, None, 3)
    poses = matched(stamps, way, noise=(0.005, 0.02))
    found = estimate(stamps, poses, stamps[rare], odometry[rare], UNKNOWN)
    assert found.time_offset == 0.0
    assert found.is_known
    assert found.knows_rotation == is_known


def test_the_rotation_is_unknown_again_once_an_offset_is_likely():
    """Few turns may have seemed to be without an offset; noise had hidden it."""
    way = winding_way(25.0)
    stamps, odometry = reported_by(OdometryParameters(0.3), way)
    rare = slice(None, None, 3)
    poses = matched(stamps, way, noise=(0.005, 0.02))
    known = OdometryParameters(rotation_error=0.01, translation_error=0.01)
    found = estimate(stamps, poses, stamps[rare], odometry[rare], known)
    assert known.knows_rotation
    assert not found.knows_rotation


def test_straight_driving_does_not_show_the_error_of_rotation():
    """The weak prior stays until turns are compared, or a wrong offset would confirm itself."""
    stamps = np.arange(0.0, 60.0, PERIOD)
    poses = np.column_stack((0.5 * stamps, 0.0 * stamps, 0.0 * stamps))
    found = estimate(stamps, poses, stamps, poses, UNKNOWN)
    assert found.is_known
    assert not found.knows_rotation
    assert found.summary()["rotation_error_rad"] is None


def test_the_initial_model_is_the_identity():
    step = Pose(0.3, -0.1, 0.4)
    assert UNKNOWN.predict(step) == pytest.approx(step)
    assert not UNKNOWN.is_known


coordinate = st.floats(-2.0, 2.0)


@settings(deadline=None, max_examples=60)
@given(
    lever=st.tuples(coordinate, coordinate),
    start=st.builds(Pose, coordinate, coordinate, st.floats(-3.0, 3.0)),
    step=st.builds(Pose, coordinate, coordinate, st.floats(-3.0, 3.0)),
)
def test_a_lever_arm_moves_the_tracking_frame_as_a_rigid_body(lever, start, step):
    """The reporting point carries the tracking frame at a fixed place."""
    tf_report_tracking = Pose(*lever, 0.0)
    tracking = compose(start, tf_report_tracking)
    moved = compose(compose(start, step), tf_report_tracking)
    predicted = OdometryParameters(lever_x=lever[0], lever_y=lever[1]).predict(step)
    assert predicted == pytest.approx(relative(tracking, moved), abs=1e-9)
    back = compose(inverse(tracking), moved)
    assert math.hypot(predicted.x - back.x, predicted.y - back.y) < 1e-9


@settings(deadline=None, max_examples=60)
@given(
    seed=st.integers(0, 2**32 - 1),
    rotation_scale=st.floats(MIN_SCALE, MAX_SCALE),
    yaw=st.floats(-0.3, 0.3),
    lever=st.tuples(st.floats(-1.0, 1.0), st.floats(-1.0, 1.0)),
    veer=st.just(NO_VEER) | st.builds(Veer, *[st.floats(-0.1, 0.1)] * 3),
)
def test_predictions_of_an_array_equal_single_ones(seed, rotation_scale, yaw, lever, veer):
    model = OdometryParameters(0.0, rotation_scale, 1.1, yaw, *lever, veer=veer)
    rng = np.random.default_rng(seed)
    reported = rng.normal(scale=(1.0, 0.2, 0.5), size=(20, 3))
    headings = rng.uniform(-9.0, 9.0, 20)
    each = [
        model.predict(Pose(*step), heading)
        for step, heading in zip(reported.tolist(), headings.tolist(), strict=True)
    ]
    assert model.predict_all(reported, headings).tolist() == [list(pose) for pose in each]
