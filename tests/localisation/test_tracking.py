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
