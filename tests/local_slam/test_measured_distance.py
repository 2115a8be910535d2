# SPDX-License-Identifier: Apache-2.0
"""Distances between scans, by the scans alone, and the scale of the odometry that follows."""

from __future__ import annotations

import math

import numpy as np
import pytest

from cartoloop.local_slam.measured_distance import (
    MAX_DISTANCE_M,
    DistanceMeter,
    MeasuredDistance,
)
from cartoloop.local_slam.odometry_calibration import OdometryCalibration
from cartoloop.local_slam.odometry_parameters import OdometryParameters
from cartoloop.local_slam.odometry_scale import (
    MIN_DISTANCES,
    combined,
    measured_ratio,
    with_measured_scale,
)
from cartoloop.local_slam.odometry_track import OdometryTrack
from cartoloop.sensor.pose import IDENTITY, Pose, compose
from tests.local_slam.test_wall_step import corridor_scan

CUPBOARDS = (2.0, 2.8, 5.0, 6.2, 9.0, 9.6)


def measure(true, matched, cupboards=CUPBOARDS, frame=IDENTITY, turn=0.0, seed=0):
    """Return what is measured between scans a distance `true` apart, matched at another one."""
    rng, meter = np.random.default_rng(seed), DistanceMeter()
    assert meter.add(0.0, frame, IDENTITY, corridor_scan(0.0, rng, cupboards)) is None
    pose = compose(frame, Pose(matched, 0.0, turn))
    return meter.add(1.5, pose, IDENTITY, corridor_scan(true, rng, cupboards))


@pytest.mark.parametrize("frame", [IDENTITY, Pose(3.0, -2.0, 2.5)])
@pytest.mark.parametrize("held", [-0.1, -0.03, 0.0, 0.05])
def test_scans_measure_a_distance_wherever_they_are_matched(frame, held):
    found = measure(1.2, 1.2 + held, frame=frame)
    assert found.distance == pytest.approx(1.2, abs=0.01)
    assert (found.begin, found.end) == (0.0, 1.5)
    assert found.along == pytest.approx((1.0, 0.0))


def test_bare_walls_hardly_measure_a_distance():
    bare = measure(1.2, 1.2, ())
    assert bare is None or bare.information < 0.1 * measure(1.2, 1.2).information


def test_near_scans_are_not_compared():
    assert measure(0.8, 0.8) is None


def test_scans_far_apart_are_not_compared():
    assert measure(2.1, MAX_DISTANCE_M + 0.1) is None


def test_scans_across_a_turn_are_not_compared():
    assert measure(1.2, 1.2, turn=math.radians(20.0)) is None


def test_scans_of_few_returns_are_not_compared():
    rng, meter = np.random.default_rng(0), DistanceMeter()
    meter.add(0.0, IDENTITY, IDENTITY, corridor_scan(0.0, rng)[:20])
    returns = corridor_scan(1.2, rng)
    assert meter.add(1.5, Pose(1.2, 0.0, 0.0), IDENTITY, returns) is None


def test_a_meter_that_forgets_compares_nothing():
    rng, meter = np.random.default_rng(0), DistanceMeter()
    meter.add(0.0, IDENTITY, IDENTITY, corridor_scan(0.0, rng))
    meter.forget()
    assert meter.add(1.5, Pose(1.2, 0.0, 0.0), IDENTITY, corridor_scan(1.2, rng)) is None


def measured_as(lengths):
    """Distances of these lengths [m], one a second."""
    return [
        MeasuredDistance(float(k), k + 1.0, float(one), (1.0, 0.0), 1000.0)
        for k, one in enumerate(lengths)
    ]


def distances(scale, number=100, noise=0.02, seed=1):
    """Return distances along x, one a second, and the odometry that reports 1 m for each."""
    rng = np.random.default_rng(seed)
    measured = scale + rng.normal(0.0, noise, number)
    times = np.arange(number + 1.0)
    odometry = np.column_stack((times, np.zeros(number + 1), np.zeros(number + 1)))
    return measured_as(measured), times, odometry


def test_the_ratio_is_that_of_most_distances():
    measured, _, _ = distances(0.98)
    slipping = [one._replace(distance=0.2) for one in measured[:8]]
    ratio, error, noise = measured_ratio(slipping + measured[8:], np.ones(100))
    assert ratio == pytest.approx(0.98, abs=0.005)
    assert 0.001 <= error < 0.005
    assert noise == pytest.approx(0.02, rel=0.3)


def test_the_noise_is_that_of_a_metre():
    rng = np.random.default_rng(2)
    walked = rng.uniform(0.5, 2.0, 400)
    measured = measured_as(1.01 * walked + rng.normal(0.0, 0.03, 400) * np.sqrt(walked))
    assert measured_ratio(measured, walked)[2] == pytest.approx(0.03, rel=0.15)


def test_noise_of_the_odometry_does_not_change_the_ratio():
    rng = np.random.default_rng(5)
    lengths = rng.uniform(1.0, 1.2, 4000)
    ratio, error, _ = measured_ratio(measured_as(lengths), lengths + rng.normal(0.0, 0.15, 4000))
    assert ratio == pytest.approx(1.0, abs=3.0 * error)
    assert error < 0.004


def test_a_ratio_of_nothing_is_not_known():
    measured, _, _ = distances(1.0, number=10)
    ratio, error, noise = measured_ratio(measured, np.zeros(10))
    assert (ratio, error) == (1.0, math.inf)
    assert math.isnan(noise)


def test_values_are_weighted_by_their_errors():
    mean, error = combined([(1.0, 0.01), (1.02, 0.01), (7.0, math.inf)])
    assert mean == pytest.approx(1.01)
    assert error == pytest.approx(0.01 / math.sqrt(2.0))


@pytest.mark.parametrize("scale", [0.97, 1.03])
def test_a_scale_that_confirms_itself_is_corrected(scale):
    measured, *odometry = distances(scale)
    matched = OdometryParameters(translation_error=0.001)  # as was assumed: 1
    found = with_measured_scale(matched, measured, *odometry, OdometryParameters())
    assert found.translation_scale == pytest.approx(scale, abs=0.005)
    assert found.knows_scale
    assert (found.metre_noise, found.num_metres) == (pytest.approx(0.02, rel=0.3), 100)


def test_what_was_known_counts_where_little_is_measured():
    measured, *odometry = distances(0.97, number=5)
    known = OdometryParameters(translation_scale=0.95, scale_error=0.001)
    matched = OdometryParameters(translation_error=0.001)
    found = with_measured_scale(matched, measured, *odometry, known)
    assert found.translation_scale == pytest.approx(0.957, abs=0.002)


def test_a_scale_that_few_distances_contradict_does_not_count():
    measured, *odometry = distances(0.94, number=12)
    matched = OdometryParameters(translation_error=0.001)  # as was assumed: 1
    found = with_measured_scale(matched, measured, *odometry, OdometryParameters())
    assert found.translation_scale == pytest.approx(0.94, abs=0.015)


def test_the_scale_is_known_once_few_distances_are():
    measured, times, odometry = distances(0.94, number=12)
    track, calibration = OdometryTrack(), OdometryCalibration()
    for time, pose in zip(times.tolist(), odometry.tolist(), strict=True):
        track.add(time, Pose(*pose))
    known = []
    for one in measured:
        calibration.add_distance(one)
        calibration.add(one.end, Pose(one.end, 0.0, 0.0), track)
        known.append(calibration.model.knows_scale)
    assert known.index(True) == MIN_DISTANCES - 1
    assert calibration.model.translation_scale == pytest.approx(0.94, abs=0.015)


def test_a_scale_that_nothing_measured_is_that_of_the_matches():
    measured, *odometry = distances(0.97, number=5)
    matched = OdometryParameters(translation_scale=1.01, translation_error=0.001)
    assert with_measured_scale(matched, measured, *odometry, OdometryParameters()) == matched


def test_odometry_that_never_moves_shows_no_scale():
    measured, times, poses = distances(0.97)
    matched = OdometryParameters(translation_error=0.001)
    at_rest = np.zeros_like(poses)
    found = with_measured_scale(matched, measured, times, at_rest, OdometryParameters(), math.inf)
    assert found == matched
