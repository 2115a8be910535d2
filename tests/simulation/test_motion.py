# SPDX-License-Identifier: Apache-2.0
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cartoloop.errors import ConfigError
from cartoloop.sensor.pose import wrap_angles
from cartoloop.simulation import drive

coordinate = st.integers(-40, 40).map(lambda quarter: quarter / 4)
routes = st.lists(st.tuples(coordinate, coordinate), min_size=1, max_size=8).map(np.array)


@settings(deadline=None, max_examples=60)
@given(route=routes)
def test_speed_and_angular_rate_stay_within_their_limits(route):
    motion = drive(route, speed=0.8, turn_rate=0.7, acceleration=0.5)
    seconds = np.diff(motion.times)
    assert (seconds > 0.0).all()
    steps = np.hypot(*np.diff(motion.poses[:, :2], axis=0).T)
    turns = np.abs(np.diff(motion.poses[:, 2]))
    assert (steps <= 0.8 * seconds * (1 + 1e-6) + 1e-9).all()
    assert (turns <= 0.7 * seconds * (1 + 1e-6) + 1e-9).all()


@settings(deadline=None, max_examples=60)
@given(route=routes)
def test_the_motion_keeps_to_the_route_and_heads_along_it(route):
    motion = drive(route, corner_radius=0.5)
    assert motion.poses[0, :2] == pytest.approx(route[0])
    assert motion.poses[-1, :2] == pytest.approx(route[-1])
    steps = np.diff(motion.poses[:, :2], axis=0)
    moving = np.hypot(*steps.T) > 1e-6
    bearing = np.arctan2(steps[moving, 1], steps[moving, 0])
    aside = wrap_angles(bearing - motion.poses[:-1, 2][moving])
    assert (np.abs(aside) < 0.03).all()


def test_corners_are_rounded_and_reversals_turned_on_the_spot():
    bend = drive(np.array([[0.0, 0.0], [4.0, 0.0], [4.0, 4.0]]), corner_radius=0.5)
    assert bend.path_length == pytest.approx(7.0 + 0.25 * math.tau * 0.5, abs=1e-3)
    back = drive(np.array([[0.0, 0.0], [4.0, 0.0], [0.0, 0.0]]))
    assert back.path_length == pytest.approx(8.0)
    assert abs(back.poses[-1, 2]) == pytest.approx(math.pi)


def test_poses_are_wrapped_and_stand_still_before_and_after():
    motion = drive(np.array([[0.0, 0.0], [0.0, 2.0], [0.0, 1.0], [-1.0, 1.0]]))
    before, after = motion.poses_at(np.array([-5.0, 1e6]))
    assert before == pytest.approx([0.0, 0.0, math.pi / 2])
    assert after[:2] == pytest.approx([-1.0, 1.0])
    assert -math.pi < after[2] <= math.pi


def test_a_route_of_one_point_stands_still():
    motion = drive(np.array([[2.0, 3.0], [2.0, 3.0]]))
    assert motion.duration == 0.0
    assert motion.path_length == 0.0
    assert motion.poses_at(np.array([0.0, 9.0])).tolist() == [[2.0, 3.0, 0.0]] * 2


@pytest.mark.parametrize("limits", [{"speed": 0.0}, {"turn_rate": -1.0}, {"corner_radius": -0.1}])
def test_impossible_limits_are_refused(limits):
    with pytest.raises(ConfigError):
        drive(np.array([[0.0, 0.0], [1.0, 0.0]]), **limits)


def test_a_route_without_points_is_refused():
    with pytest.raises(ConfigError, match="no points"):
        drive(np.empty((0, 2)))


def test_a_short_step_between_turns_on_the_spot_takes_time():
    route = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 0.012], [0.0, 0.012]])
    motion = drive(route, speed=1.0, turn_rate=0.9, acceleration=0.6, corner_radius=0.5)
    seconds = np.diff(motion.times)
    assert np.all(np.isfinite(seconds))
    assert np.all(seconds > 0.0)
    steps = np.hypot(*np.diff(motion.poses[:, :2], axis=0).T)
    short = int(np.argmax(np.abs(motion.poses[1:, 1] - motion.poses[:-1, 1])))
    # Half of it speeding up, half slowing down.
    assert seconds[short] == pytest.approx(2.0 * np.sqrt(steps[short] / 0.6))
