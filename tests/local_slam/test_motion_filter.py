# SPDX-License-Identifier: Apache-2.0
"""Which scans are worth inserting."""

from __future__ import annotations

import math

import pytest

from cartoloop.config import MotionFilterConfig
from cartoloop.local_slam.motion_filter import MotionFilter
from cartoloop.sensor.pose import Pose

LIMITS = MotionFilterConfig(max_time_seconds=5.0, max_distance_meters=0.2, max_angle_degrees=1.0)
START = Pose(3.0, -2.0, 3.141)


@pytest.fixture
def motion_filter():
    motion_filter = MotionFilter(LIMITS)
    assert motion_filter.is_new(100.0, START)
    return motion_filter


def moved(distance=0.0, turned_deg=0.0):
    return Pose(
        START.x + distance * math.cos(1.0),
        START.y + distance * math.sin(1.0),
        START.theta + math.radians(turned_deg),
    )


def test_the_first_scan_is_always_new():
    for time, pose in ((-1e9, Pose(0.0, 0.0, 0.0)), (1e9, Pose(1e6, -1e6, 3.0))):
        assert MotionFilter(LIMITS).is_new(time, pose)


def test_a_scan_that_differs_by_little_is_not_new(motion_filter):
    assert not motion_filter.is_new(104.9, moved(0.19, 0.9))


@pytest.mark.parametrize(
    ("time", "pose"),
    [(105.1, moved()), (100.2, moved(distance=0.21)), (100.2, moved(turned_deg=-1.1))],
    ids=["time", "distance", "rotation"],
)
def test_one_exceeded_limit_is_enough(motion_filter, time, pose):
    assert motion_filter.is_new(time, pose)


def test_a_turn_across_the_half_turn_is_small(motion_filter):
    assert not motion_filter.is_new(100.2, Pose(START.x, START.y, -3.141))


def test_small_motions_add_up_since_the_last_new_scan(motion_filter):
    new = [motion_filter.is_new(100.0 + 0.1 * k, moved(0.05 * k)) for k in range(1, 16)]
    assert [k + 1 for k, is_new in enumerate(new) if is_new] == [5, 10, 15]


def test_limits_of_zero_let_every_change_pass():
    motion_filter = MotionFilter(
        MotionFilterConfig(max_time_seconds=0.0, max_distance_meters=0.0, max_angle_degrees=0.0)
    )
    assert all(motion_filter.is_new(0.1 * k, START) for k in range(5))
