# SPDX-License-Identifier: Apache-2.0
"""Mapping with odometry that is wrong in every respect: scans decide, and nothing fails."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cartoloop import Config, Mapper, Odometry, Pose
from cartoloop.evaluation.trajectories import absolute_trajectory_error
from cartoloop.simulation import office, simulate


@pytest.fixture(scope="module")
def drive():
    return simulate(office(), duration=60.0)


def at_random(pose, rng):
    return Pose(*rng.normal(0.0, (5.0, 5.0, 2.0)).tolist())


WRONG = {
    "in centimetres": lambda pose, _: Pose(100.0 * pose.x, 100.0 * pose.y, pose.theta),
    "in degrees": lambda pose, _: Pose(pose.x, pose.y, np.degrees(pose.theta)),
    "that only turns": lambda pose, _: Pose(0.0, 0.0, pose.theta),
    "that never turns": lambda pose, _: Pose(pose.x, pose.y, 0.0),
    "that never moves": lambda pose, _: Pose(1.0, 2.0, 0.5),
    "mirrored": lambda pose, _: Pose(pose.x, -pose.y, -pose.theta),
    "turned the other way": lambda pose, _: Pose(pose.x, pose.y, -pose.theta),
    "that hardly moves": lambda pose, _: Pose(1e-9 * pose.x, 1e-9 * pose.y, 1e-9 * pose.theta),
    "huge": lambda pose, _: Pose(1e9 * pose.x, 1e9 * pose.y, 1e9 * pose.theta),
    "at random": at_random,
}


@pytest.mark.parametrize("how", WRONG)
def test_wrong_odometry_does_not_stop_the_mapper(drive, how):
    rng = np.random.default_rng(1)
    mapper = Mapper(Config())
    for event in drive.events():
        if isinstance(event, Odometry):
            wrong = WRONG[how](event.tf_odom_tracking, rng)
            mapper.add(replace(event, tf_odom_tracking=wrong))
        else:
            mapper.add(event)
    result = mapper.finish()

    assert len(result.trajectory) == len(drive.true_poses)
    error = float(absolute_trajectory_error(result.trajectory, drive.true_poses).mean())
    assert error < 0.02
