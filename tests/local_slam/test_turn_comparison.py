# SPDX-License-Identifier: Apache-2.0
"""Whether odometry and scans turn to the same side."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cartoloop.local_slam.odometry_motion import OdometryMotion
from cartoloop.local_slam.turn_comparison import ENOUGH_RAD, TurnComparison
from cartoloop.sensor.pose import Pose, wrap_angle


def ratio_of(matched, reported):
    turns = TurnComparison()
    for heading, by_odometry in zip(matched, reported, strict=True):
        turns.add(wrap_angle(heading), None if by_odometry is None else wrap_angle(by_odometry))
    return turns.ratio


@given(
    steps=st.lists(st.floats(-0.5, 0.5), min_size=40, max_size=80),
    factor=st.sampled_from([1.0, -1.0, 0.0, 0.9, -1.1]),
)
def test_the_ratio_is_that_of_the_turns(steps, factor):
    matched = np.cumsum(steps)
    total = np.abs(steps).sum()

    ratio = ratio_of(matched, factor * matched)

    if ratio is None:
        # Turns to and fro that add up to nothing are not compared.
        assert total < 2.0 * ENOUGH_RAD or np.ptp(matched) < 2.0 * ENOUGH_RAD
    else:
        assert ratio == pytest.approx(factor, abs=1e-9)


def test_little_turning_shows_nothing():
    headings = np.linspace(0.0, 0.9 * ENOUGH_RAD, 50)

    assert ratio_of(headings, -headings) is None
    assert ratio_of(1.2 * headings, -1.2 * headings) == pytest.approx(-1.0)


@pytest.mark.parametrize(("factor", "are_opposite"), [(1.0, False), (0.0, False), (-1.0, True)])
def test_turns_to_different_sides_are_opposite(factor, are_opposite):
    turns = TurnComparison()
    for heading in np.linspace(0.0, 1.2 * ENOUGH_RAD, 60):
        assert not turns.are_opposite or heading >= ENOUGH_RAD
        turns.add(wrap_angle(heading), wrap_angle(factor * heading))

    assert turns.are_opposite is are_opposite


def test_noise_and_a_delay_hardly_change_the_ratio():
    times = np.arange(0.0, 300.0, 0.2)
    heading = 2.0 * np.sin(0.1 * times)
    noise = np.random.default_rng(0).normal(0.0, 0.02, len(times))

    assert ratio_of(heading, -2.0 * np.sin(0.1 * (times - 0.5)) + noise) == pytest.approx(
        -1.0, abs=0.1
    )


def test_the_turn_across_missing_odometry_is_not_compared():
    headings = np.linspace(0.0, 4.0 * math.pi, 200)
    reported = [*headings[:90], *[None] * 20, *(headings[110:] + 2.0)]

    assert ratio_of(headings, reported) == pytest.approx(1.0)


@pytest.mark.parametrize(("sign", "is_trusted"), [(1.0, True), (-1.0, False)])
def test_odometry_that_turns_to_the_other_side_is_not_trusted(sign, is_trusted):
    motion = OdometryMotion()
    for step in range(100):
        time, heading = 0.2 * step, 0.1 * step
        x, y = math.sin(heading), 1.0 - math.cos(heading)
        motion.add(time, Pose(x, sign * y, sign * wrap_angle(heading)))
        motion.add_pose(time, Pose(x, y, wrap_angle(heading)), 0, "laser", is_matched=True)
        assert motion.is_trusted or heading >= ENOUGH_RAD

    assert motion.is_trusted is is_trusted
    assert motion.summary()["turn_ratio"] == pytest.approx(sign, abs=0.1)


def on_a_circle(motion, sign, steps):
    """Add odometry and poses of a robot on a circle, also the odometry of one scan more."""
    for step in range(steps):
        time, heading = 0.2 * step, 0.1 * step
        x, y = math.sin(heading), 1.0 - math.cos(heading)
        motion.add(time, Pose(x, sign * y, sign * wrap_angle(heading)))
        if step + 1 < steps:
            pose = Pose(x, y, wrap_angle(heading))
            motion.add_pose(time, pose, 0, "laser", is_matched=True)
    return 0.2 * (steps - 2), 0.2 * (steps - 1)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_mirrored_odometry_predicts_nothing(sign):
    motion = OdometryMotion()
    span = on_a_circle(motion, sign, 100)
    assert (motion.step(*span) is None) is (sign < 0.0)
    assert (motion.doubtful_step(*span) is None) is (sign < 0.0)
    assert bool(motion.steps_over_gap(*span)) is (sign > 0.0)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_an_earlier_pass_knows_that_odometry_is_mirrored(sign):
    """The turns of this pass decide once they are enough: it may have other settings."""
    motion = OdometryMotion(is_mirrored=True)
    assert motion.step(*on_a_circle(motion, sign, 20)) is None
    motion = OdometryMotion(is_mirrored=True)
    assert (motion.step(*on_a_circle(motion, sign, 100)) is None) is (sign < 0.0)
