# SPDX-License-Identifier: Apache-2.0
"""Odometry that contradicts the scans is noticed, and good again when it agrees."""

from __future__ import annotations

import math

import numpy as np
import pytest

from cartoloop.local_slam.odometry_trust import OdometryTrust, follows
from cartoloop.local_slam.odometry_window import Evidence
from cartoloop.sensor.pose import Pose, compose
from cartoloop.simulation import drive, simulate
from tests.local_slam.small_world import LIDAR, errors, furnished_room, run

STEP = Pose(0.1, 0.0, 0.02)
STAND = Pose(0.0, 0.0, 0.0)
PERIOD = 0.2


def evidence(is_determined=True, direction=0.0, change=0.0):
    return Evidence(is_determined, direction, lambda _: change, lambda: 1.0)


def follow(matched, reported, seen=None, is_late=False, period=PERIOD):
    """Feed a trust with steps of scans and odometry: the trust, and the counts of faulty steps."""
    trust, pose = OdometryTrust(), Pose(1.0, 2.0, 0.7)
    counts = [trust.add(0.0, pose, None, evidence(), lambda *_: is_late, True)]
    for k, (step, said) in enumerate(zip(matched, reported, strict=True), 1):
        pose = compose(pose, step)
        counts.append(
            trust.add(k * period, pose, said, seen or evidence(), lambda *_: is_late, True)
        )
    return trust, counts


def follow_steady(reported, seen=None):
    """Feed a trust with a steady motion that constant velocity predicts."""
    trust, pose = OdometryTrust(), Pose(1.0, 2.0, 0.7)
    trust.add(0.0, pose, None, evidence(), lambda *_: False, True)
    for k, said in enumerate(reported, 1):
        pose = compose(pose, STEP)
        trust.add(k * PERIOD, pose, said, seen or evidence(), lambda *_: False, True, expected=STEP)
    return trust


def test_odometry_that_stands_and_leaps_is_left_out():
    """Over a second it moves as far as the scans do."""
    leaping = [STAND, STAND, Pose(0.3, 0.0, 0.06)] * 30
    trust = follow_steady(leaping + [STEP] * 5)
    assert not trust.is_trusted
    assert trust.is_unsteady
    (fault,) = trust.faults
    assert fault.kind == "moves unsteadily"
    assert fault.begin <= 2 * PERIOD
    assert fault.end is None


def test_leaps_where_scans_determine_nothing_are_no_fault():
    leaping = [STAND, STAND, Pose(0.3, 0.0, 0.06)] * 30
    assert follow_steady(leaping, evidence(is_determined=False)).is_trusted


def test_it_is_trusted_again_once_it_moves_steadily():
    leaping = [STAND, STAND, Pose(0.3, 0.0, 0.06)] * 30
    trust, pose = follow_steady(leaping), Pose(0.0, 0.0, 0.0)
    trust.add(100.0, pose, None, evidence(), lambda *_: False, True)
    for k in range(40):
        turn = Pose(0.1, 0.0, 0.2 * (-1) ** k)
        pose = compose(pose, turn)
        time = 100.0 + (k + 1) * PERIOD
        trust.add(time, pose, turn, evidence(), lambda *_: False, True, expected=STEP)
    assert trust.is_trusted
    assert trust.faults[0].end is not None


def test_odometry_that_agrees_is_trusted():
    trust, counts = follow([STEP] * 40, [Pose(0.11, 0.004, 0.015)] * 40)
    assert trust.is_trusted
    assert not trust.faults
    assert not any(counts)


def test_frozen_odometry_is_noticed_within_some_steps():
    trust, counts = follow([STEP] * 20, [STEP] * 10 + [STAND] * 10)
    assert not trust.is_trusted
    (fault,) = trust.faults
    assert fault.kind == "stands still"
    assert 1.0 <= fault.begin <= 2.4
    assert fault.end is None
    noticed = next(k for k, count in enumerate(counts) if count)
    assert 10 < noticed <= 15
    assert 5 <= counts[noticed] <= 7


@pytest.mark.parametrize("share", [0.3, 2.0])
def test_slow_wheels_that_slip_are_noticed(share):
    """In a second it moves by less than an error that is no fault."""
    slow = Pose(0.04, 0.0, 0.0)
    slips = Pose(share * slow.x, 0.0, 0.0)
    trust, counts = follow([slow] * 60, [slow] * 30 + [slips] * 30)
    (fault,) = trust.faults
    assert not trust.is_trusted
    assert 2.0 <= fault.begin <= 9.0
    noticed = next(k for k, count in enumerate(counts) if count)
    assert 30 < noticed <= 50


def test_slow_wheels_that_move_with_the_scans_are_trusted_again():
    slow = Pose(0.04, 0.0, 0.0)
    trust, _ = follow([slow] * 90, [slow] * 20 + [STAND] * 30 + [slow] * 40)
    assert trust.is_trusted
    assert trust.faults[0].end is not None


def test_it_is_trusted_again_once_it_moves_with_the_scans():
    trust, _ = follow([STEP] * 40, [STAND] * 15 + [STEP] * 25)
    assert trust.is_trusted
    assert trust.faults[0].end == pytest.approx(15 * PERIOD, abs=3 * PERIOD)


def test_a_turn_does_not_show_how_far_wheels_roll():
    turn = Pose(0.0, 0.0, 0.1)
    slipping, _ = follow([STEP] * 20 + [turn] * 20, [Pose(0.25, 0.0, 0.02)] * 20 + [turn] * 20)
    skidding, _ = follow([STEP] * 20 + [turn] * 20, [Pose(0.1, 0.0, 0.12)] * 20 + [turn] * 20)
    assert not slipping.is_trusted
    assert skidding.is_trusted


def test_standing_still_together_proves_nothing():
    trust, _ = follow([STEP] * 10 + [STAND] * 30, [STAND] * 40)
    assert not trust.is_trusted


@pytest.mark.parametrize(
    ("said", "kind"),
    [
        (Pose(0.25, 0.0, 0.02), "moves too far"),
        (Pose(0.1, 0.0, 0.12), "moves otherwise"),
        (Pose(0.03, 0.0, 0.02), "moves otherwise"),
    ],
)
def test_slipping_wheels_are_noticed(said, kind):
    trust, _ = follow([STEP] * 20, [said] * 20)
    assert [fault.kind for fault in trust.faults] == [kind]


def test_spinning_wheels_are_noticed_if_the_ranges_stand_too():
    for change, is_trusted in ((0.02, False), (0.3, True), (math.inf, True)):
        trust, _ = follow([STAND] * 20, [STEP] * 20, evidence(change=change))
        assert trust.is_trusted == is_trusted


def test_along_a_corridor_the_scans_contradict_nothing():
    """Heading 0.7: the direction that the match leaves open is the one in which the robot moves."""
    straight = Pose(0.1, 0.0, 0.0)
    along, across = (evidence(False, 0.7 + turn) for turn in (0.0, math.pi / 2))
    assert follow([STAND] * 20, [straight] * 20, along)[0].is_trusted
    assert not follow([straight] * 20, [STAND] * 20, across)[0].is_trusted


def test_late_odometry_is_not_faulty():
    assert follow([STEP] * 20, [STAND] * 20, is_late=True)[0].is_trusted


def test_sparse_scans_contradict_nothing():
    assert follow([STEP] * 20, [STAND] * 20, period=1.5)[0].is_trusted


def faulty(events, change):
    """Events of a recording with the odometry readings changed; None leaves one out."""
    readings = 0
    for event in events:
        if hasattr(event, "tf_odom_tracking"):
            pose = change(readings, event.tf_odom_tracking)
            readings += 1
            if pose is not None:
                yield type(event)(event.stamp, event.time, pose)
        else:
            yield event


@pytest.mark.parametrize("begin", [0, 60])
def test_a_room_is_mapped_in_spite_of_frozen_odometry(begin):
    world = furnished_room()
    motion = drive(np.vstack([world.route] * 2), 0.8, 1.0)
    recording = simulate(world, LIDAR, seed=3, motion=motion)
    frozen = []

    def freeze(k, pose):
        if k == begin:
            frozen.append(pose)
        return frozen[0] if frozen else pose

    poses, _, slam = run(faulty(recording.events(), freeze))

    assert errors(poses, recording.true_poses)[0].max() < 0.1
    (fault,) = slam.extrapolator.odometry.faults
    assert fault.end is None
    assert fault.begin - recording.stamps[begin] < 6.0


def test_repeated_readings_do_no_harm():
    world = furnished_room()
    motion = drive(np.vstack([world.route] * 2), 0.8, 1.0)
    recording = simulate(world, LIDAR, seed=4, motion=motion)
    last = [Pose(0.0, 0.0, 0.0)]

    def repeat(k, pose):
        if k % 40 >= 8 or k < 40:
            last[0] = pose
        return last[0]

    poses, _, _ = run(faulty(recording.events(), repeat))

    assert errors(poses, recording.true_poses)[0].max() < 0.15


@pytest.mark.parametrize("is_calibrated", [True, False])
def test_calibrated_odometry_may_differ_by_less(is_calibrated):
    slipping = Pose(1.7 * STEP.x, 0.0, STEP.theta)
    trust, pose = OdometryTrust(), Pose(1.0, 2.0, 0.7)
    for k in range(30):
        said = None if k == 0 else slipping
        trust.add(k * PERIOD, pose, said, evidence(), lambda *_: False, is_calibrated)
        pose = compose(pose, STEP)
    assert trust.is_trusted != is_calibrated


def test_a_fault_that_the_odometry_explains_is_forgotten():
    trust, _ = follow([STEP] * 20, [STEP] * 10 + [STAND] * 10)
    assert not trust.forgive(since=10.0)
    assert trust.forgive(since=2.0)
    assert not trust.faults


def test_bad_predictions_before_a_fault_are_part_of_it():
    """Odometry is used again as soon as the fault is over."""
    said = [STEP] * 20 + [STAND, STAND, Pose(0.3, 0.0, 0.06)] * 6 + [STAND] * 10 + [STEP] * 15
    trust = follow_steady(said)
    assert [fault.kind for fault in trust.faults] == ["stands still"]
    assert trust.is_trusted


@pytest.mark.parametrize(
    ("step", "is_followed"),
    [
        (Pose(0.11, 0.0, 0.02), True),
        (Pose(0.2, 0.0, 0.02), False),
        (Pose(0.1, 0.0, 0.2), False),
        (STAND, False),
    ],
)
def test_odometry_follows_where_it_moves_as_expected(step, is_followed):
    assert follows(step, STEP) == is_followed
    assert not follows(STAND, STAND)
