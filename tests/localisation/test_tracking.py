# SPDX-License-Identifier: Apache-2.0
"""A tracked pose follows the map, also where local SLAM has slipped."""

from __future__ import annotations

import numpy as np
import pytest

from cartoloop.config import LocalSlamConfig
from cartoloop.localisation.tracking import Tracker
from cartoloop.sensor.pose import IDENTITY, Pose, compose
from tests.localisation.rooms import ROOM, START, apart, known_map, points


@pytest.fixture
def tracker():
    tracker = Tracker(known_map(ROOM), LocalSlamConfig(), START, 1e-4 * np.eye(3))
    for _ in range(5):
        tracker.correct(points(ROOM, START), IDENTITY)
    return tracker


def test_a_pose_that_slipped_is_found_nearby(tracker):
    tracker.move(Pose(0.5, -0.4, 0.06))

    tracker.correct(points(ROOM, START), IDENTITY)

    distance, angle = apart(START, tracker.pose)
    assert distance < 0.05
    assert angle < 1.0


def test_a_place_nearby_that_fits_poorly_is_not_taken(tracker):
    nearby = compose(START, Pose(0.6, -0.3, 0.08))
    changed = np.concatenate((points(ROOM, START)[::3], points(ROOM, nearby)[1::2]))

    for _ in range(3):
        tracker.correct(changed, IDENTITY)

    assert apart(START, tracker.pose)[0] < 0.15


def test_where_the_map_ends_no_pose_nearby_is_taken(tracker):
    slip = Pose(0.5, -0.4, 0.06)
    slipped = compose(tracker.pose, slip)
    tracker.move(slip)
    seen = points(ROOM, START)
    beyond = np.column_stack((np.linspace(30.0, 38.0, 4 * len(seen)), np.full(4 * len(seen), 9.0)))

    tracker.correct(np.concatenate((seen, beyond)), IDENTITY)

    assert apart(slipped, tracker.pose)[0] < 0.15


def test_a_pose_is_not_moved_to_where_scans_do_not_fit(tracker):
    walls_elsewhere = points(ROOM, Pose(7.5, 8.0, -2.0))

    agreement = tracker.correct(walls_elsewhere, IDENTITY)

    assert agreement < 0.7
    assert apart(START, tracker.pose)[0] < 0.2


def test_the_covariance_grows_with_the_path(tracker):
    before = np.trace(tracker.covariance)
    tracker.move(Pose(1.0, 0.0, 0.0))

    assert np.trace(tracker.covariance) > before


CORRIDOR = (((0.0, 0.0), (17.5, 0.0), (17.5, 2.0), (0.0, 2.0)),)
MIDDLE = Pose(8.0, 1.0, 0.0)


@pytest.fixture
def in_corridor():
    """A tracker between bare walls, whose ends are out of sight, and what it sees."""
    seen = points(CORRIDOR, MIDDLE)
    seen = seen[np.abs(seen[:, 0]) < 6.0]
    tracker = Tracker(known_map(CORRIDOR), LocalSlamConfig(), MIDDLE, 1e-3 * np.eye(3))
    tracker.correct(seen, IDENTITY)
    return tracker, seen


def sigma_along(tracker):
    return float(np.sqrt(tracker.covariance[0, 0]))


@pytest.mark.parametrize(("has_odometry", "least", "most"), [(True, 0.1, 0.5), (False, 1.5, 5.0)])
def test_nothing_is_known_along_bare_walls(in_corridor, has_odometry, least, most):
    tracker, seen = in_corridor
    for _ in range(10):
        tracker.move(Pose(0.2, 0.0, 0.0), 0.2, has_odometry=has_odometry)
        tracker.correct(seen, IDENTITY)

    assert least < sigma_along(tracker) < most
    assert np.sqrt(tracker.covariance[1, 1]) < 0.1


def test_a_place_found_nearby_stays_open_along_bare_walls(in_corridor):
    tracker, seen = in_corridor
    tracker.move(Pose(0.0, 0.6, 0.0))
    tracker.correct(seen, IDENTITY)

    assert abs(tracker.pose.y - MIDDLE.y) < 0.1
    assert sigma_along(tracker) > 0.3


def test_a_robot_that_stands_with_odometry_stays_known(in_corridor):
    tracker, seen = in_corridor
    before = sigma_along(tracker)
    for _ in range(50):
        tracker.move(IDENTITY, 0.2)
        tracker.correct(seen, IDENTITY)

    assert sigma_along(tracker) == pytest.approx(before, rel=0.2)


def test_where_the_map_decides_the_position_stays_known(tracker):
    for _ in range(20):
        tracker.move(IDENTITY, 0.2, has_odometry=False)
        tracker.correct(points(ROOM, START), IDENTITY)

    assert np.sqrt(np.trace(tracker.covariance[:2, :2])) < 0.05
