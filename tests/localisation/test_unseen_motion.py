# SPDX-License-Identifier: Apache-2.0
"""A robot whose scans show nothing is as uncertain as its motion, and then no longer located."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from cartoloop.localisation.answer import State
from cartoloop.localisation.local_motion import LocalMotion
from cartoloop.localisation.localizer import Localizer
from cartoloop.localisation.unseen_motion import UnseenMotion, unseen_error
from cartoloop.sensor.events import LaserScan
from cartoloop.sensor.pose import IDENTITY, Pose
from tests.localisation.rooms import GEOMETRY, ROOM, START, apart, drive, events, known_map

NOTHING, COVER = math.inf, 0.5
SEEN, UNSEEN = 20, 40
"""Numbers of scans before and while the scanner sees nothing."""


@pytest.fixture(scope="module")
def room():
    return known_map(ROOM)


def answers_where_unseen(room, measured, *, with_odometry, unseen=UNSEEN, after=1):
    """Return the poses and answers of a drive; all beams measure the same for a while."""
    poses = drive(START, SEEN + unseen + after, step=0.03, turn=0.03)
    localizer = Localizer(room)
    answers = []
    for event in events(ROOM, poses, with_odometry=with_odometry):
        is_unseen = SEEN <= round(10.0 * event.time) < SEEN + unseen
        if is_unseen and isinstance(event, LaserScan):
            covered = replace(event, ranges=np.full(GEOMETRY.num_beams, measured))
            localizer.add(covered, answers.append)
        else:
            localizer.add(event, answers.append)
    localizer.finish(answers.append)
    return poses, answers


def sigma(answer):
    return math.sqrt(np.trace(answer.covariance[:2, :2]))


@pytest.mark.parametrize("measured", [NOTHING, COVER])
def test_a_robot_that_sees_nothing_is_not_located_for_long(room, measured):
    _, answers = answers_where_unseen(room, measured, with_odometry=False)

    assert answers[SEEN + 5].state is State.LOCATED
    assert sigma(answers[SEEN + 5]) > 0.4
    assert answers[SEEN + UNSEEN - 1].state is State.LOST


@pytest.mark.parametrize("measured", [NOTHING, COVER])
def test_odometry_carries_a_robot_that_sees_nothing(room, measured):
    poses, answers = answers_where_unseen(room, measured, with_odometry=True)

    assert {answer.state for answer in answers} == {State.LOCATED}
    last = SEEN + UNSEEN - 1
    error, _ = apart(poses[last], answers[last].tf_map_tracking)
    assert max(error, 0.05) < 2.0 * sigma(answers[last]) < 0.5
    assert apart(poses[-1], answers[-1].tf_map_tracking)[0] < 0.05
    assert sigma(answers[-1]) < 0.1


@pytest.mark.parametrize("measured", [NOTHING, COVER])
def test_a_robot_that_sees_again_is_located_again(room, measured):
    poses, answers = answers_where_unseen(room, measured, with_odometry=False, after=30)

    assert answers[-1].state is State.LOCATED
    assert apart(poses[-1], answers[-1].tf_map_tracking)[0] < 0.05


def test_a_silent_scanner_is_not_located_by_its_last_pose(room):
    first = drive(START, SEEN, step=0.03)
    localizer = Localizer(room)
    for event in events(ROOM, first, with_odometry=False):
        localizer.add(event)
    before = localizer.answer
    corner = np.full(GEOMETRY.num_beams, 3.0)  # fits nowhere
    late = 0.1 * SEEN + 40.0
    after = localizer.add(LaserScan(late, late, corner, GEOMETRY))

    assert before.state is State.LOCATED
    assert after.state is State.LOST


def test_what_is_seen_ends_the_unseen_motion():
    unseen = UnseenMotion()
    step = Pose(1.0, 0.0, 0.0)
    for _ in range(100):
        unseen.add(step, unseen_error(step, 1.0, has_odometry=True))
    was_too_long = unseen.is_too_long
    unseen.add(step, None)

    assert was_too_long
    assert not unseen.is_too_long


def test_a_robot_at_rest_with_odometry_stays_where_it_is():
    unseen = UnseenMotion()
    for _ in range(1000):
        unseen.add(IDENTITY, unseen_error(IDENTITY, 1.0, has_odometry=True))

    assert not unseen.is_too_long


def test_slow_scans_begin_again_once_when_nothing_is_seen(room, monkeypatch):
    begun = []
    begin_again = LocalMotion.begin_again
    monkeypatch.setattr(
        LocalMotion, "begin_again", lambda motion: (begun.append(1), begin_again(motion))
    )
    poses = drive(START, 40, step=0.03, turn=0.03)
    localizer = Localizer(room)
    for event in events(ROOM, poses, with_odometry=False):
        slow = replace(event, time=25.0 * event.time, stamp=25.0 * event.stamp)
        if 10 <= round(10.0 * event.time) < 30:
            slow = replace(slow, ranges=np.full(GEOMETRY.num_beams, NOTHING))
        answer = localizer.add(slow)

    assert len(begun) == 1
    assert answer.state is State.LOCATED
