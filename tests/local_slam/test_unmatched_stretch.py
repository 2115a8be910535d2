# SPDX-License-Identifier: Apache-2.0
"""How long the robot drove without a match, and how well the odometry knows where it is then."""

from __future__ import annotations

import math

import numpy as np
import pytest

from cartoloop.local_slam.gap import Gap
from cartoloop.local_slam.odometry_parameters import OdometryParameters
from cartoloop.local_slam.unmatched_stretch import (
    MAX_STRETCH_M,
    MIN_STRETCH_M,
    UnmatchedStretch,
)
from cartoloop.sensor.pose import Pose
from cartoloop.submaps.node import is_lost

KNOWN = OdometryParameters(rotation_error=0.001, translation_error=0.002)


def driven(metres, step=0.25):
    stretch = UnmatchedStretch()
    stretch.add(Pose(0.0, 0.0, 0.0))
    for k in range(1, round(metres / step) + 1):
        stretch.add(Pose(step * k, 0.0, 0.0))
    return stretch


def is_long(stretch):
    return stretch.end(KNOWN, np.eye(3)) is not None


def test_a_stretch_ends_where_it_was_long():
    assert is_long(driven(MIN_STRETCH_M))
    assert not is_long(driven(MIN_STRETCH_M - 0.5))
    assert not is_long(driven(MAX_STRETCH_M + 200.0, step=100.0))


def test_a_stretch_ends_once():
    stretch = driven(30.0)
    assert is_long(stretch)
    stretch.add(Pose(30.3, 0.0, 0.0))
    assert not is_long(stretch)


def test_a_match_ends_the_stretch_without_a_break():
    stretch = driven(30.0)
    stretch.add(Pose(30.2, 0.0, 0.0))
    stretch.clear()
    assert not is_long(stretch)


def test_pose_errors_are_those_of_steps_at_random():
    """Many drives of 200 steps, whose headings and lengths err at random."""
    rng = np.random.default_rng(4)
    step, number, drives = 0.25, 200, 4000
    headings = np.cumsum(rng.normal(0.0, 0.001, (drives, number)), axis=1)
    lengths = step + rng.normal(0.0, 0.002, (drives, number))
    across = (lengths * np.sin(headings)).sum(axis=1)
    information = driven(step * number).end(KNOWN, np.eye(3))
    sigma = np.sqrt(1.0 / np.diag(information))
    assert sigma[2] == pytest.approx(headings[:, -1].std(), rel=0.05)
    # With the error of the scale, which is along the path, a little more than across it.
    assert across.std() < sigma[1] < 2.5 * across.std()
    assert sigma[0] == pytest.approx(sigma[1])
    assert sigma[0] > 0.01 * step * number


@pytest.mark.parametrize("model", [OdometryParameters(), OdometryParameters(rotation_error=0.001)])
def test_without_calibrated_odometry_the_match_counts(model):
    matched = np.diag((1.0, 2.0, 3.0))
    np.testing.assert_array_equal(driven(10.0).end(model, matched), matched)
    assert not math.isnan(float(driven(10.0).end(KNOWN, matched).max()))


def test_odometry_without_any_error_is_not_certain():
    exact = OdometryParameters(rotation_error=0.0, translation_error=0.0)
    information = driven(10.0).end(exact, np.eye(3))
    assert np.isfinite(information).all()
    assert 0.0 < information[2, 2] < 1e6


def test_a_misfit_after_a_gap_has_the_errors_of_the_gap():
    stretch, matched = driven(1.0), 1e4 * np.eye(3)
    stretch.add_gap(Gap((Pose(1.0, 0.0, 0.0),), 0.3, 0.05, 0.2, 0.5, 0.1))
    stretch.clear()
    np.testing.assert_allclose(stretch.end(KNOWN, matched), np.diag((4.0, 4.0, 100.0)))
    assert stretch.end(KNOWN, matched) is None


def test_a_robot_with_odometry_is_never_lost():
    poor = OdometryParameters(rotation_error=0.05, translation_error=0.002)
    information = driven(60.0, step=0.02).end(poor, np.eye(3))
    assert information is not None
    assert not is_lost(0.7 * information)
