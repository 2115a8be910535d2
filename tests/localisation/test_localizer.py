# SPDX-License-Identifier: Apache-2.0
"""The localiser finds a robot, tracks it, notices when it is elsewhere, and finds it again."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

import cartoloop
from cartoloop.errors import UsageError
from cartoloop.localisation.answer import State
from cartoloop.localisation.localizer import Localizer
from cartoloop.sensor.pose import Pose
from tests.localisation.rooms import BOX, ROOM, START, apart, drive, events, known_map


@pytest.fixture(scope="module")
def room():
    return known_map(ROOM)


@pytest.fixture(scope="module")
def box():
    return known_map(BOX)


def answers_to(localizer, drive_events):
    answers = []
    for event in drive_events:
        localizer.add(event, answers.append)
    localizer.finish(answers.append)
    return answers


def test_each_scan_of_a_drive_has_a_pose_in_the_map(room):
    poses = drive(START, 60, step=0.04, turn=0.05)

    answers = answers_to(Localizer(room), events(ROOM, poses))

    assert len(answers) == len(poses)
    assert all(answer.state is State.LOCATED for answer in answers)
    errors = np.array(
        [apart(*pair) for pair in zip(poses, (a.tf_map_tracking for a in answers), strict=True)]
    )
    assert np.sqrt((errors**2).mean(axis=0)).tolist() < [0.03, 0.5]
    last = answers[-1]
    assert np.linalg.eigvalsh(last.covariance).min() > 0.0
    assert math.sqrt(last.covariance[0, 0]) < 0.05
    assert last.agreement > 0.9
    assert last.score > last.runner_up


def test_tracking_needs_no_odometry(room):
    poses = drive(START, 30, step=0.04, turn=0.05)

    answers = answers_to(Localizer(room), events(ROOM, poses, with_odometry=False))

    assert apart(poses[-1], answers[-1].tf_map_tracking)[0] < 0.05


def test_places_of_a_symmetrical_room_move_along(box):
    poses = drive(START, 20)

    answers = answers_to(Localizer(box), events(BOX, poses))

    assert {answer.state for answer in answers} == {State.AMBIGUOUS}
    for pose, answer in zip(poses, answers, strict=True):
        assert answer.tf_map_tracking is None
        assert min(apart(pose, place.tf_map_tracking)[0] for place in answer.places) < 0.15


def test_a_given_pose_decides_between_places_that_are_alike(box):
    near = Pose(START.x + 0.4, START.y - 0.3, START.theta + 0.15)

    answers = answers_to(Localizer(box, at=near), events(BOX, drive(START, 5)))

    assert answers[0].state is State.LOCATED
    assert apart(START, answers[0].tf_map_tracking)[0] < 0.05


def test_a_pose_that_does_not_fit_is_not_believed(room):
    localizer = Localizer(room)
    localizer.start_near(Pose(7.5, 8.5, 1.0))

    answers = answers_to(localizer, events(ROOM, [START]))

    assert apart(START, answers[0].tf_map_tracking)[0] < 0.05


def test_a_kept_pose_is_moved_by_the_odometry_since(box):
    before = Pose(4.0, 2.0, 0.2)
    poses = [before, START]
    localizer = Localizer(box)
    localizer.start_near(before, Pose(0.0, 0.0, 0.0))

    answers = answers_to(localizer, list(events(BOX, poses))[2:])

    assert answers[0].state is State.LOCATED
    assert apart(START, answers[0].tf_map_tracking)[0] < 0.05


def test_a_robot_carried_away_is_found_again(room):
    first, second = drive(START, 20, step=0.05), drive(Pose(7.5, 9.0, -1.6), 60, step=0.05)
    carried = [
        *events(ROOM, first),
        *events(ROOM, second, len(first), with_odometry=False),
    ]

    answers = answers_to(Localizer(room), carried)

    assert answers[len(first) - 1].state is State.LOCATED
    last = answers[-1]
    assert last.state is State.LOCATED
    assert apart(second[-1], last.tf_map_tracking)[0] < 0.1


def test_a_robot_in_another_building_becomes_lost(room):
    hall = (((0, 0), (11, 0), (11, 2), (0, 2)),)
    first, second = drive(START, 10, step=0.05), drive(Pose(2.0, 1.0, 0.0), 90, step=0.08)
    carried = [*events(ROOM, first), *events(hall, second, len(first), with_odometry=False)]

    answers = answers_to(Localizer(room), carried)

    assert answers[len(first) - 1].state is State.LOCATED
    assert answers[-1].state is not State.LOCATED


def test_a_pose_can_be_set_while_driving(box):
    localizer = Localizer(box)
    poses = drive(START, 10)
    drive_events = list(events(BOX, poses))
    answers_to(localizer, drive_events[:10])

    localizer.set_pose(poses[5])
    answers = answers_to(localizer, drive_events[10:])

    assert localizer.given_pose_fits is True
    assert answers[-1].state is State.LOCATED
    assert apart(poses[-1], answers[-1].tf_map_tracking)[0] < 0.1


def test_a_pose_that_is_set_where_no_scan_fits_changes_nothing(room):
    localizer = Localizer(room)
    poses = drive(START, 10)
    drive_events = list(events(ROOM, poses))
    answers_to(localizer, drive_events[:10])
    path_before = localizer.answer.tf_local_tracking

    localizer.set_pose(Pose(7.5, 8.5, 1.0))
    assert localizer.given_pose_fits is None
    answers = answers_to(localizer, drive_events[10:])

    assert localizer.given_pose_fits is False
    assert {answer.state for answer in answers} == {State.LOCATED}
    assert apart(poses[-1], answers[-1].tf_map_tracking)[0] < 0.1
    assert answers[-1].tf_local_tracking.x > path_before.x


def test_the_same_events_have_the_same_answers(room):
    poses = drive(START, 12, turn=0.1)
    first, second = (answers_to(Localizer(room), events(ROOM, poses)) for _ in range(2))

    assert [a.tf_map_tracking for a in first] == [a.tf_map_tracking for a in second]


def test_bad_scans_are_skipped_and_counted(room):
    localizer = Localizer(room)
    *_, scan = events(ROOM, [START])
    bad = cartoloop.LaserScan(math.nan, math.nan, scan.ranges, scan.geometry)

    assert localizer.add(bad) is None
    assert sum(localizer.skipped.values()) == 1


@pytest.mark.parametrize("call", [lambda: Localizer(3), lambda: Localizer(known_map(BOX), at=5)])
def test_what_is_no_map_or_pose_is_refused(call):
    with pytest.raises(UsageError, match="give"):
        call()


def test_what_is_no_event_is_refused(room):
    with pytest.raises(UsageError, match="event"):
        Localizer(room).add("scan")


@pytest.mark.parametrize("pose", [(math.inf, 0.0, 0.0), (math.nan, 0.0, 0.0), (1, 2)])
def test_an_impossible_pose_is_refused(room, pose):
    with pytest.raises(UsageError, match="Localizer"):
        Localizer(room, at=pose)
    with pytest.raises(UsageError, match="set_pose"):
        Localizer(room).set_pose(pose)
    with pytest.raises(UsageError, match="start_near"):
        Localizer(room).start_near(pose)


def test_odometry_that_went_astray_does_no_harm(room):
    localizer = Localizer(room)
    localizer.start_near(START, Pose(-9e5, 0.0, 0.0))
    far = [
        replace(event, tf_odom_tracking=Pose(1e300, 0.0, 0.0))
        if isinstance(event, cartoloop.Odometry)
        else event
        for event in events(ROOM, drive(START, 3))
    ]

    assert len(answers_to(localizer, far)) == 4


def test_a_start_pose_that_does_not_fit_is_known(room):
    localizer = Localizer(room, at=(500.0, 0.0, 0.0))
    assert localizer.given_pose_fits is None

    answers_to(localizer, events(ROOM, drive(START, 3)))

    assert localizer.given_pose_fits is False
