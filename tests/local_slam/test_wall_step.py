# SPDX-License-Identifier: Apache-2.0
"""Steps along bare walls, from one scan to the next."""

import math
from functools import partial

import numpy as np
import pytest

from cartoloop.config import WallStepConfig
from cartoloop.local_slam.match_records import WallMemory
from cartoloop.local_slam.missed_motion import MissedMotion
from cartoloop.local_slam.wall_step import WallStep
from cartoloop.sensor.pose import IDENTITY, Pose, compose, inverse, transform_points

CONFIG = WallStepConfig()
BEARINGS = np.radians(np.arange(-90.0, 90.5, 0.5))
LEFT, RIGHT, RANGE = 1.2, -1.0, 30.0


def corridor_scan(x, rng, cupboards=(6.0, 7.5, 12.0, 14.0), reach=RANGE - 0.5, sigma=0.01):
    """Return the returns of a scanner at x between two walls; cupboards stand along the left."""
    edges = np.array(cupboards).reshape(-1, 2)
    ranges = []
    for bearing in BEARINGS:
        cos, sin = math.cos(bearing), math.sin(bearing)
        hits = [(LEFT if sin > 0 else RIGHT) / sin] if abs(sin) > 1e-9 else []
        for first, last in edges:
            front, depth = (first - x) / cos if cos > 1e-9 else -1.0, LEFT - 0.3
            if front > 0 and depth < front * sin < LEFT:
                hits.append(front)
            if sin > 0 and first <= x + depth / math.tan(bearing) <= last:
                hits.append(depth / sin)
        ranges.append(min(hits, default=RANGE) + rng.normal(0.0, sigma))
    ranges = np.array(ranges)
    seen = ranges < reach  # not the noise of no return
    return np.column_stack((ranges * np.cos(BEARINGS), ranges * np.sin(BEARINGS)))[seen]


def with_person(returns, x, y=0.3, radius=0.25):
    """Return returns as they are with a person, a disc, standing before the scanner."""
    distances = np.hypot(*returns.T)
    directions = returns / distances[:, np.newaxis]
    along = directions @ (x, y)
    across = directions @ (-y, x)
    is_hit = (along > 0.0) & (np.abs(across) < radius)
    near = along - np.sqrt(np.maximum(radius**2 - across**2, 0.0))
    return np.where(is_hit, np.minimum(distances, near), distances)[:, np.newaxis] * directions


def walk(wall_step, places, matched, cupboards, frame=IDENTITY, sigma=0.01, **odometry):
    """Return the poses found at `places`, scans that a match holds at `matched`; in the frame."""
    rng, found = np.random.default_rng(0), []
    for k, (x, held) in enumerate(zip(places, matched, strict=True)):
        returns = corridor_scan(x, rng, cupboards, sigma=sigma)
        pose = compose(frame, Pose(held, 0.0, 0.0))
        better = wall_step.better_pose(0.2 * k, pose, returns, **odometry)
        found.append(better)
        wall_step.add(0.2 * k, better or pose, IDENTITY, returns)
    return found


@pytest.mark.parametrize("frame", [IDENTITY, Pose(3.0, -2.0, 2.5)])
def test_a_robot_held_between_walls_is_released(frame):
    wall_step = WallStep(CONFIG)
    found = walk(wall_step, [0.0, 0.2], [0.0, 0.0], (6.0, 7.5, 12.0, 14.0), frame)
    assert found[0] is None
    x, y, theta = compose(inverse(frame), found[1])
    assert x == pytest.approx(0.2, abs=0.02)
    assert y == pytest.approx(0.0, abs=0.01)
    assert theta == pytest.approx(0.0, abs=1e-9)


def test_a_slow_robot_held_between_walls_is_released():
    wall_step, places = WallStep(CONFIG), 0.03 * np.arange(12)
    found = walk(wall_step, places, np.zeros(12), (6.0, 7.5, 12.0, 14.0))
    released = [(place, pose) for place, pose in zip(places, found, strict=True) if pose]
    assert released
    for place, pose in released:
        assert pose.x == pytest.approx(place, abs=0.05)


def test_a_match_that_is_right_is_left_alone():
    places = 0.2 * np.arange(6)
    assert walk(WallStep(CONFIG), places, places, (6.0, 7.5)) == [None] * 6


def test_a_robot_that_stands_still_is_left_alone():
    assert walk(WallStep(CONFIG), np.zeros(8), np.zeros(8), (6.0, 7.5)) == [None] * 8


@pytest.mark.parametrize("stands", [True, False])
def test_a_person_who_walks_by_moves_no_robot_that_stands(stands):
    rng, wall_step, found = np.random.default_rng(0), WallStep(CONFIG), []
    for k in range(8):
        returns = with_person(corridor_scan(0.0, rng, CUPBOARDS), 1.5 + 0.2 * k)
        found.append(wall_step.better_pose(0.2 * k, IDENTITY, returns, stands=stands))
        wall_step.add(0.2 * k, IDENTITY, IDENTITY, returns)
    assert found == [None] * 8


@pytest.mark.parametrize(("missed", "is_proven"), [(0.3, False), (1.0, True), (-1.0, False)])
def test_evidence_counts_for_steps_of_about_that_velocity(missed, is_proven):
    """Two metres a second are missed; the comparison itself is no evidence here."""
    rng, wall_step = np.random.default_rng(0), WallStep(WallStepConfig(noise_factor=1e3))
    wall_step.add(0.0, IDENTITY, IDENTITY, corridor_scan(0.0, rng))
    wall_step.memory = WallMemory(1e3, missed, 0.0, 0.0, 0.0, True, 0.0)
    found = wall_step.better_pose(0.2, IDENTITY, corridor_scan(0.4, rng))
    assert (found is not None) == is_proven


@pytest.mark.parametrize("seed", range(3))
def test_noise_between_walls_moves_no_robot(seed):
    """The best of many steps fits better by noise alone."""
    rng, wall_step = np.random.default_rng(seed), WallStep(CONFIG)
    for k in range(12):
        returns, pose = corridor_scan(0.2 * k, rng, (6.0, 7.5), sigma=0.03), Pose(0.2 * k, 0.0, 0.0)
        better = wall_step.better_pose(0.2 * k, pose, returns)
        assert better is None or better.x == pytest.approx(pose.x, abs=0.05)
        wall_step.add(0.2 * k, pose, IDENTITY, returns)


def test_bare_walls_show_no_step():
    places, held = 0.2 * np.arange(8), np.zeros(8)
    assert walk(WallStep(CONFIG), places, held, (), sigma=0.005) == [None] * 8


def test_scans_are_not_compared_across_a_large_turn():
    rng, wall_step = np.random.default_rng(0), WallStep(CONFIG)
    wall_step.add(0.0, IDENTITY, IDENTITY, corridor_scan(0.0, rng))
    turned = Pose(0.0, 0.0, math.radians(10.0))
    returns = transform_points(inverse(turned), corridor_scan(0.2, rng))
    assert wall_step.better_pose(0.2, turned, returns) is None


def test_few_returns_are_not_compared():
    wall_step = WallStep(CONFIG)
    few = corridor_scan(0.0, np.random.default_rng(0))[: CONFIG.min_num_returns - 1]
    wall_step.add(0.0, IDENTITY, IDENTITY, few)
    assert wall_step.better_pose(0.2, IDENTITY, few) is None


CUPBOARDS = (6.0, 7.5, 12.0, 14.0)


@pytest.mark.parametrize("said", [0.03, 0.42])
def test_wheels_that_slip_are_contradicted(said):
    rng, wall_step = np.random.default_rng(0), WallStep(CONFIG)
    pose = IDENTITY
    for k in range(8):
        returns = corridor_scan(0.2 * k, rng, CUPBOARDS)
        better = wall_step.better_pose(0.2 * k, pose, returns, by_odometry=True)
        pose = better or pose
        wall_step.add(0.2 * k, pose, IDENTITY, returns)
        if k < 7:
            pose = Pose(pose.x + said, 0.0, 0.0)
    assert pose.x == pytest.approx(1.4, abs=0.1)


def test_steps_missed_before_slip_is_proven_are_made_up_for():
    """The evidence of one comparison is too little."""
    wall_step = WallStep(WallStepConfig(min_odometry_evidence=150.0))
    scan = partial(corridor_scan, rng=Silent(), cupboards=CUPBOARDS)
    found = []
    for k in range(4):
        pose = Pose(0.02 * k, 0.0, 0.0)
        found.append(wall_step.better_pose(0.4 * k, pose, scan(0.2 * k), by_odometry=True))
        if found[-1] is not None:
            break
        wall_step.add(0.4 * k, pose, IDENTITY, scan(0.2 * k))
    assert len(found) > 2
    assert found[-1].x == pytest.approx(0.2 * (len(found) - 1), abs=0.03)


@pytest.mark.parametrize(("ratio", "is_left_alone"), [(0.05, False), (0.5, True)])
def test_matches_that_do_not_follow_wheels_are_left_alone(ratio, is_left_alone):
    rng, wall_step, found = np.random.default_rng(0), WallStep(CONFIG), []
    for k in range(8):
        returns, pose = corridor_scan(0.2 * k, rng, CUPBOARDS), Pose(0.03 * k, 0.0, 0.0)
        found.append(
            wall_step.better_pose(0.2 * k, pose, returns, by_odometry=True, match_ratio=ratio)
        )
        wall_step.add(0.2 * k, pose, IDENTITY, returns)
    assert (found == [None] * 8) == is_left_alone


@pytest.mark.parametrize(("reach", "sigma"), [(3.0, 0.01), (RANGE - 0.5, 0.02)])
def test_wheels_are_right_where_bare_walls_say_nothing(reach, sigma):
    rng, wall_step = np.random.default_rng(1), WallStep(CONFIG)
    for k in range(150):
        returns, pose = corridor_scan(0.2 * k, rng, (), reach, sigma), Pose(0.2 * k, 0.0, 0.0)
        assert wall_step.better_pose(0.2 * k, pose, returns, by_odometry=True) is None
        wall_step.add(0.2 * k, pose, IDENTITY, returns)


class Silent:
    """A random generator without noise."""

    def normal(self, *_):
        return 0.0


def test_evidence_against_wheels_ends_where_they_are_right():
    wall_step, scan = WallStep(CONFIG), partial(corridor_scan, rng=Silent(), cupboards=CUPBOARDS)
    wall_step.add(0.0, IDENTITY, IDENTITY, scan(0.0))
    slipping = Pose(0.05, 0.0, 0.0), scan(0.25)
    pose = wall_step.better_pose(0.4, *slipping, by_odometry=True)
    assert pose.x == pytest.approx(0.25, abs=0.03)

    at_rest, seen = Pose(0.25, 0.0, 0.0), scan(0.25)
    for time in (0.4, 0.8):
        wall_step.add(time, at_rest, IDENTITY, seen)
        assert wall_step.better_pose(time + 0.4, at_rest, seen, by_odometry=True) is None
    # soon after, and near: not compared unless wheels are suspected, so that nothing is found
    slipped = scan(0.45)
    assert wall_step.better_pose(0.9, at_rest, slipped, by_odometry=True) is None


@pytest.mark.parametrize("max_loss_share", [CONFIG.max_loss_share, 1.0])
def test_people_who_walk_along_do_not_contradict_wheels(max_loss_share):
    config = CONFIG.model_copy(update={"max_loss_share": max_loss_share, "close_fit": 0.0})
    rng, wall_step, found = np.random.default_rng(0), WallStep(config), []
    for k in range(8):
        x = 0.2 * k
        people = tuple(x + edge for edge in (1.2, 1.6, 2.4, 2.9, 3.6, 4.2))
        returns = corridor_scan(x, rng, (*people, 7.0, 7.5))
        pose = Pose(x, 0.0, 0.0)
        found.append(wall_step.better_pose(x, pose, returns, by_odometry=True))
        wall_step.add(x, pose, IDENTITY, returns)
    # the cupboard that stands there distinguishes them from wheels that spin
    assert any(found) == (max_loss_share == 1.0)


def test_a_person_who_walks_ahead_does_not_contradict_wheels():
    rng, wall_step = np.random.default_rng(0), WallStep(CONFIG)
    for k in range(15):
        x = 0.2 * k
        returns = with_person(corridor_scan(x, rng, ()), 1.5)
        pose = Pose(x, 0.0, 0.0)
        assert wall_step.better_pose(x, pose, returns, by_odometry=True) is None
        wall_step.add(x, pose, IDENTITY, returns)


def test_people_who_overtake_the_robot_do_not_contradict_wheels():
    """They hide what stands; wheels that slip do not turn the robot's motion round."""
    rng, wall_step = np.random.default_rng(0), WallStep(CONFIG)
    for k in range(8):
        x = 0.2 * k
        people = tuple(edge + 0.4 * k for edge in (1.2, 1.6, 2.4, 2.9, 3.6, 4.2))
        returns = corridor_scan(x, rng, people)
        pose = Pose(x, 0.0, 0.0)
        assert wall_step.better_pose(x, pose, returns, by_odometry=True) is None
        wall_step.add(x, pose, IDENTITY, returns)


@pytest.mark.parametrize("error", [0.0, 0.01])
def test_small_errors_are_left_to_odometry(error):
    places = 0.2 * np.arange(10)
    wall_step = WallStep(CONFIG)
    found = walk(wall_step, places, places * (1.0 + error), CUPBOARDS, by_odometry=True)
    assert found == [None] * 10


def test_scans_far_apart_do_not_contradict_odometry():
    far = CONFIG.max_odometry_step + 0.1
    places = (far + 0.2) * np.arange(5)
    wall_step = WallStep(CONFIG)
    found = walk(wall_step, places, far * np.arange(5), CUPBOARDS, by_odometry=True)
    assert found == [None] * 5


def test_clutter_that_fits_nowhere_contradicts_nothing():
    rng, wall_step = np.random.default_rng(0), WallStep(CONFIG)
    for k in range(8):
        returns = corridor_scan(0.2 * k, rng, CUPBOARDS)
        returns += rng.normal(0.0, 0.08, returns.shape)
        pose = Pose(0.05 * k, 0.0, 0.0)
        assert wall_step.better_pose(0.2 * k, pose, returns, by_odometry=True) is None
        wall_step.add(0.2 * k, pose, IDENTITY, returns)


def test_odometry_that_repeats_a_reading_is_given_time():
    wall_step, places = WallStep(CONFIG), 0.2 * np.arange(30)
    walk(wall_step, places[:1], places[:1], CUPBOARDS, by_odometry=True)
    odometry = {"by_odometry": True, "stands": True}
    found = walk(wall_step, places, np.zeros(30), CUPBOARDS, **odometry)
    first = next(k for k, pose in enumerate(found) if pose is not None)
    assert 0.2 * first == pytest.approx(CONFIG.max_standstill, abs=0.5)


def test_a_scan_that_was_held_is_corrected():
    """The scan before was where its odometry stopped, by its match; a metre further, in fact."""
    rng, wall_step = np.random.default_rng(0), WallStep(CONFIG)
    wall_step.add(0.0, IDENTITY, IDENTITY, corridor_scan(1.0, rng))
    wall_step.correct(MissedMotion(-2.0, IDENTITY, (0.5, 0.0)))
    found = wall_step.better_pose(0.2, Pose(1.0, 0.0, 0.0), corridor_scan(1.3, rng))
    assert found is not None
    assert found.x == pytest.approx(1.3, abs=0.05)
