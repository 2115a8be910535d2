# SPDX-License-Identifier: Apache-2.0
"""A kept pose goes with the odometry of its scan, and is believed only where a scan shows it."""

from __future__ import annotations

import pytest

from cartoloop.localisation.answer import State
from cartoloop.localisation.lines import read_pose_file
from cartoloop.localisation.localizer import Localizer
from cartoloop.localisation.run import PoseKeeper
from cartoloop.localisation.start_pose import StartPose, claim_near
from cartoloop.localisation.trail import Trail
from cartoloop.sensor.events import Odometry
from cartoloop.sensor.pose import IDENTITY, Pose, compose
from tests.localisation.rooms import BOX, START, apart, events, known_map, points

CORRIDOR = (((0.0, 0.0), (17.5, 0.0), (17.5, 2.0), (0.0, 2.0)),)
MIDDLE = Pose(8.0, 1.0, 0.0)
RANGE_M = 6.0
"""Of a scanner that does not see the ends of the corridor [m]."""


def test_a_kept_pose_has_the_odometry_of_its_scan(tmp_path):
    localizer = Localizer(known_map(BOX), at=START)
    keeper = PoseKeeper(tmp_path / "kept.json", localizer, print)
    odometry, scan = events(BOX, [START])
    localizer.add(odometry)
    keeper.add(localizer.add(scan))
    localizer.add(Odometry(60.0, 60.0, Pose(5.0, 0.0, 0.0)))
    keeper.write()

    assert read_pose_file(tmp_path / "kept.json").tf_odom_tracking == odometry.tf_odom_tracking


@pytest.fixture
def in_corridor():
    """A localiser of a corridor, and a scan in its middle of bare walls alone."""
    _, scan = events(CORRIDOR, [MIDDLE])
    scan.ranges[scan.ranges > RANGE_M] = 1e3
    return Localizer(known_map(CORRIDOR)), scan


@pytest.mark.parametrize("metres", [0.0, 3.0])
def test_a_kept_pose_is_not_believed_along_bare_walls(in_corridor, metres):
    localizer, scan = in_corridor
    localizer.start_near(compose(MIDDLE, Pose(metres, 0.0, 0.0)))

    assert localizer.add(scan).state is not State.LOCATED


@pytest.mark.parametrize(("low_distinctness", "is_believed"), [(0.9, True), (1.2, False)])
def test_a_kept_pose_needs_a_scan_that_is_distinct(low_distinctness, is_believed):
    known, trail = known_map(BOX), Trail()
    known.low_distinctness = low_distinctness
    trail.add(IDENTITY, points(BOX, START), IDENTITY)
    claim = claim_near(known, trail.composite(0.0), StartPose(START, False), None, 0.02)

    assert (claim is not None) is is_believed


def test_a_user_is_believed_along_bare_walls(in_corridor):
    localizer, scan = in_corridor
    localizer.set_pose(MIDDLE)
    answer = localizer.add(scan)

    assert answer.state is State.LOCATED
    assert apart(MIDDLE, answer.tf_map_tracking)[0] < 1.1


def test_a_robot_out_of_sight_may_have_stood_or_moved_on():
    gone_on, shown = Pose(6.0, 4.0, 0.0), Pose(4.0, 4.0, 0.0)
    then, now = Pose(1.0, 0.0, 0.0), Pose(1.5, 0.0, 0.0)
    start = StartPose(gone_on, False, then, shown)

    assert start.poses(None) == [gone_on, shown]
    assert start.poses(now) == [Pose(6.5, 4.0, 0.0), gone_on, shown]
