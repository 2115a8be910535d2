# SPDX-License-Identifier: Apache-2.0
"""The motion that odometry which stopped alone has missed."""

from __future__ import annotations

import math

import pytest

from cartoloop.local_slam.missed_motion import MAX_TURN_RAD, MissedMotion
from cartoloop.sensor.pose import Pose

MISSED = MissedMotion(10.0, Pose(1.0, 2.0, 0.5 * math.pi), (0.5, 0.0))
"""Half a metre a second along y."""


def test_a_pose_is_where_the_motion_has_led():
    held = Pose(1.01, 2.1, 0.5 * math.pi)
    assert MISSED.corrected(14.0, held) == pytest.approx(Pose(1.0, 4.0, 0.5 * math.pi))


def test_the_heading_of_the_scan_is_kept_and_the_path_is_an_arc():
    turned = 0.5 * math.pi + 0.02
    corrected = MISSED.corrected(14.0, Pose(1.0, 2.0, turned))
    assert corrected.theta == turned
    assert (corrected.x, corrected.y) == pytest.approx(
        (1.0 - 2.0 * math.sin(0.01), 2.0 + 2.0 * math.cos(0.01))
    )


def test_poses_before_the_motion_stay():
    before = Pose(1.0, 1.9, 1.5)
    assert MISSED.corrected(9.8, before) is before


@pytest.mark.parametrize(
    ("moved", "turned", "is_held"),
    [(0.0, 0.0, True), (0.3, 0.05, True), (0.6, 0.0, False), (0.0, 1.1 * MAX_TURN_RAD, False)],
)
def test_matches_are_held_if_they_neither_move_nor_turn(moved, turned, is_held):
    pose = Pose(1.0, 2.0 + moved, 0.5 * math.pi + turned)
    assert MISSED.is_held(12.0, pose) == is_held
