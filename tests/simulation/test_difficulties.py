# SPDX-License-Identifier: Apache-2.0
"""Sparse scans, pauses, missing returns, glass and people in simulated recordings."""

import math
from dataclasses import replace

import numpy as np
import pytest

from cartoloop.errors import ConfigError
from cartoloop.readers import open_log
from cartoloop.sensor.events import LaserScan, Odometry
from cartoloop.sensor.pose import wrap_angle
from cartoloop.simulation import (
    LIDARS,
    Difficulties,
    MountedLidar,
    Pace,
    World,
    drive,
    make_world,
    simulate,
    simulate_rig,
)
from cartoloop.simulation.glass import glazed
from cartoloop.simulation.people import ASIDE, BODY_RADIUS, FARTHEST, People
from cartoloop.simulation.scan_times import TURN_PER_SCAN

RING = make_world("ring")
EXACT = replace(LIDARS["sick-180"], rate=2.0, range_noise=0.0, dropout=0.0, range_quantum=0.0)
ROOM = np.array(
    [(-5.0, -4.0, 5.0, -4.0), (5.0, -4.0, 5.0, 4.0), (5.0, 4.0, -5.0, 4.0), (-5.0, 4.0, -5.0, -4.0)]
)


def drive_ring(seed=1, duration=60.0, **difficulties):
    return simulate(
        RING, EXACT, seed=seed, duration=duration, difficulties=Difficulties(**difficulties)
    )


@pytest.fixture(scope="module")
def plain():
    return drive_ring()


@pytest.mark.parametrize(
    "difficulties",
    [
        {"scan_spacing": 1.0},
        {"pause": 4.0},
        {"missing_returns": 0.2},
        {"glass": 0.3},
        {"people": 5},
    ],
)
def test_difficulties_follow_from_the_seed(difficulties, plain):
    one, same = (drive_ring(**difficulties) for _ in range(2))
    assert np.array_equal(one.stamps, same.stamps)
    assert np.array_equal(one.ranges, same.ranges)
    assert not np.array_equal(one.ranges, plain.ranges)
    if "scan_spacing" not in difficulties:
        other = drive_ring(seed=2, **difficulties)
        assert not np.array_equal(one.ranges, other.ranges)


@pytest.mark.parametrize("size", [1, 13, 1000])
def test_glass_and_people_do_not_depend_on_the_block_size(size):
    recording = drive_ring(duration=20.0, glass=0.3, people=3)
    blocks = [block for _, block in recording.range_blocks(size)]
    assert np.array_equal(np.vstack(blocks), recording.ranges)


def test_sparse_scans_are_those_after_a_metre_or_a_turn(plain):
    sparse = drive_ring(scan_spacing=1.0)
    assert np.isin(sparse.stamps, plain.stamps).all()
    rows = np.searchsorted(plain.stamps, sparse.stamps)
    assert np.array_equal(sparse.ranges, plain.ranges[rows])
    assert np.array_equal(sparse.true_poses, plain.true_poses[rows])
    steps = np.hypot(*np.diff(sparse.true_poses[:, :2], axis=0).T)
    turns = np.abs(np.diff(np.unwrap(sparse.true_poses[:, 2])))
    assert ((steps > 0.9) | (turns >= TURN_PER_SCAN - 1e-9)).all()
    assert np.median(steps) == pytest.approx(1.25, abs=0.3)
    assert len(sparse.stamps) < len(plain.stamps) / 1.5


def test_a_log_of_sparse_scans_keeps_all_odometry(tmp_path, plain):
    sparse = drive_ring(scan_spacing=1.0)
    sparse.write_carmen(tmp_path / "sparse.log")
    events = list(open_log(tmp_path / "sparse.log"))
    poses = [event.tf_odom_tracking for event in events if isinstance(event, Odometry)]
    assert np.array(poses) == pytest.approx(plain.odometry_poses, abs=1e-6)
    stamps = [event.stamp for event in events if isinstance(event, LaserScan)]
    assert stamps == sparse.stamps.tolist()


@pytest.mark.parametrize("seed", range(4))
def test_a_pause_leaves_out_a_turn_of_up_to_90_degrees(seed):
    recording, whole = drive_ring(seed, 150.0, pause=5.0), drive_ring(seed, 150.0)
    assert np.isin(recording.stamps, whole.stamps).all()
    gaps = np.diff(recording.stamps)
    at = int(np.argmax(gaps))
    assert gaps[at] == pytest.approx(5.5, abs=0.51)
    assert np.delete(gaps, at) == pytest.approx(0.5, abs=1e-6)
    before, after = recording.true_poses[at : at + 2, 2].tolist()
    assert math.radians(60.0) < abs(wrap_angle(after - before)) < math.radians(90.1)
    assert len(recording.odometry_poses) == len(recording.stamps)


def test_a_pause_needs_a_recording_that_is_longer():
    with pytest.raises(ConfigError, match="too short"):
        drive_ring(duration=10.0, pause=9.0)


def test_missing_returns_are_the_share_that_was_asked_for(plain):
    recording = drive_ring(missing_returns=0.25)
    missing = recording.ranges == EXACT.no_return
    assert missing.mean() == pytest.approx(0.25, abs=0.02)
    assert np.array_equal(recording.ranges[~missing], plain.ranges[~missing])


@pytest.mark.parametrize("share", [0.0, 0.3, 1.0])
def test_the_share_of_glass_is_that_of_the_walls(share):
    solid, glass = glazed(RING.walls, share, np.random.default_rng(5))

    def length(walls):
        return np.hypot(walls[:, 2] - walls[:, 0], walls[:, 3] - walls[:, 1]).sum()

    assert length(solid) + length(glass) == pytest.approx(length(RING.walls))
    assert length(glass) / length(RING.walls) == pytest.approx(share, abs=0.1)


def test_glass_is_seen_straight_on_and_looked_through_aslant():
    inner = np.array([(2.0, -3.0, 2.0, 3.0)])
    world = World("glass", np.vstack((ROOM, inner)), np.zeros((1, 2)))
    lidar = replace(EXACT, rate=10.0)

    def seen(share):
        return simulate(world, lidar, duration=20.0, difficulties=Difficulties(glass=share)).ranges

    angles = np.degrees(lidar.geometry.angles)
    facing, aslant = np.abs(angles) < 11.0, (np.abs(angles) > 14.0) & (np.abs(angles) < 35.0)
    everything_glass = seen(1.0)
    assert everything_glass[:, facing] == pytest.approx(seen(0.0)[:, facing])
    assert (everything_glass[:, aslant] > seen(0.0)[:, aslant] + 1.0).all()
    only_inner = World("glass", ROOM, np.zeros((1, 2)))
    behind = simulate(only_inner, lidar, duration=0.0).ranges[0]
    through = np.concatenate(
        [
            _pane_in_front_of(ROOM, inner, lidar, seed)[:, aslant] / behind[aslant]
            for seed in range(3)
        ]
    )
    assert (np.isclose(through, 1.0) | np.isinf(through)).all()
    assert np.isinf(through).mean() == pytest.approx(0.2, abs=0.05)


def _pane_in_front_of(walls, panes, lidar, seed):
    from cartoloop.simulation.glass import seen_through
    from cartoloop.simulation.lidar import true_ranges

    poses = np.zeros((50, 3))
    solid = true_ranges(walls, poses, lidar)
    return seen_through(solid, panes, poses, lidar, np.random.default_rng(seed))


def test_people_stay_near_the_robot_and_beside_its_path():
    motion = drive(np.array([(0.0, 0.0), (60.0, 0.0)]), *Pace())
    times = np.arange(0.0, motion.duration, 0.1)
    places = People(motion, 6, np.random.default_rng(2)).places_at(times)
    assert places.shape == (len(times), 6, 2)
    away = places[..., 0] - motion.poses_at(times)[:, None, 0]
    assert np.abs(away).max() <= FARTHEST[1]
    assert away.min() < -4.0 < 4.0 < away.max()
    aside = np.abs(places[..., 1])
    assert (aside >= ASIDE[0] - 1e-9).all()
    assert (aside <= ASIDE[1] + 1e-9).all()
    steps = np.hypot(*np.moveaxis(np.diff(places, axis=0), 2, 0))
    assert steps.max() < 0.1 * (1.5 + 1.0) + 1e-9


def test_people_are_seen_as_circles_in_front_of_the_walls(plain):
    recording = drive_ring(people=4)
    shorter = recording.ranges < plain.ranges - 1e-9
    assert not (recording.ranges > plain.ranges + 1e-9).any()
    assert 0.005 < shorter.mean() < 0.3
    schedule = recording.schedule.of_scans[:, 0]
    everybody = People(recording.motion, 4, np.random.default_rng((1, 103, 0))).places_at(schedule)
    scans, beams = np.nonzero(shorter)
    angles = recording.true_poses[scans, 2] + EXACT.geometry.angles[beams]
    ranges = recording.ranges[scans, beams]
    points = recording.true_poses[scans, :2] + ranges[:, None] * np.column_stack(
        (np.cos(angles), np.sin(angles))
    )
    distances = np.linalg.norm(everybody[scans] - points[:, None], axis=2).min(axis=1)
    assert distances[ranges > 0.1] == pytest.approx(BODY_RADIUS, abs=1e-6)


def test_glass_and_people_need_level_scanners():
    swept = [MountedLidar(EXACT, sweep=0.1)]
    with pytest.raises(ConfigError, match="level scanners"):
        simulate_rig(RING, swept, difficulties=Difficulties(people=1))


@pytest.mark.parametrize(
    "difficulties",
    [
        {"glass": 1.5},
        {"missing_returns": -0.1},
        {"people": -1},
        {"pause": math.inf},
        {"scan_spacing": -1.0},
        {"odometry_delay": math.nan},
    ],
)
def test_impossible_difficulties_are_refused(difficulties):
    with pytest.raises(ConfigError, match="simulated"):
        Difficulties(**difficulties)
