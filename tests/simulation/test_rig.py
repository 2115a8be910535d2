# SPDX-License-Identifier: Apache-2.0
"""Simulated bodies that sway, their scanners and their IMU."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from cartoloop.errors import ConfigError
from cartoloop.sensor.events import Imu, LaserScan, Odometry, PointCloud
from cartoloop.sensor.pose import Pose
from cartoloop.simulation import PERFECT_ODOMETRY, Lidar, Motion, World, drive, simulate
from cartoloop.simulation.drives import simulate_rig
from cartoloop.simulation.gait import Gait, body_poses, turned, turned_back
from cartoloop.simulation.imu import GRAVITY, ImuModel
from cartoloop.simulation.motion import delayed
from cartoloop.simulation.rig import FLOOR, MountedLidar, sweep_ranges

EXACT = Lidar(
    num_beams=91,
    angle_min=-math.pi / 4,
    angle_increment=math.pi / 180,
    range_noise=0.0,
    dropout=0.0,
    range_quantum=0.0,
)
NO_NOISE = ImuModel(
    gyro_noise=0.0, gyro_bias=(0.0,) * 3, acceleration_noise=0.0, acceleration_bias=(0.0,) * 3
)
WALLS = np.array([(5.0, -20.0, 5.0, 20.0), (-5.0, -20.0, -5.0, 20.0)])
YARD = World("yard", WALLS, np.array([(0.0, 0.0), (2.0, 0.0)]), lidar=EXACT)


def bodies(count, x=0.0, y=0.0, theta=0.0, roll=0.0, pitch=0.0):
    return np.tile((x, y, theta, roll, pitch), (count, 1)).astype(float)


def test_a_level_rig_has_the_ranges_of_a_plain_recording():
    plain = simulate(YARD, motion=drive(np.array([(0.5, 0.3)])), duration=1.0)
    rig = simulate_rig(YARD, motion=drive(np.array([(0.5, 0.3)])), duration=1.0)
    scans = [event for event in rig.events() if isinstance(event, LaserScan)]
    assert [scan.stamp for scan in scans] == plain.stamps.tolist()
    assert np.array([scan.ranges for scan in scans]) == pytest.approx(plain.ranges)


def test_a_body_that_leans_forward_sees_the_floor():
    nose_down = sweep_ranges(WALLS, bodies(91, pitch=0.3), MountedLidar(EXACT))
    assert nose_down[45] == pytest.approx(-FLOOR / math.sin(0.3))
    a_little = sweep_ranges(WALLS, bodies(91, pitch=0.1), MountedLidar(EXACT))
    assert a_little[45] == pytest.approx(5.0 / math.cos(0.1))


def test_pitch_of_scanner_and_of_body_give_the_same_ranges():
    leaning = sweep_ranges(WALLS, bodies(91, pitch=0.1, roll=0.05), MountedLidar(EXACT))
    mounted = sweep_ranges(WALLS, bodies(91), MountedLidar(EXACT, pitch=0.1, roll=0.05))
    assert mounted == pytest.approx(leaning)


def test_each_beam_is_measured_at_its_own_time():
    turning = Motion(np.array((0.0, 1.0)), np.array([(0.0, 0.0, 0.0), (0.0, 0.0, 1.0)]))
    scanner = MountedLidar(EXACT, sweep=0.1)
    rig = simulate_rig(YARD, [scanner], motion=turning, duration=0.1)
    ranges = next(rig.events()).ranges
    headings = scanner.geometry.angles + scanner.beam_times()
    assert ranges == pytest.approx(5.0 / np.cos(headings))
    assert scanner.geometry.time_increment == pytest.approx(0.1 / 90)


def test_rings_make_clouds_of_points_where_the_walls_are():
    rings = MountedLidar(EXACT, "rings", height=0.2, elevations=(-0.1, 0.1))
    cloud = next(simulate_rig(YARD, [rings], duration=0.0).events())
    assert isinstance(cloud, PointCloud)
    assert cloud.points[:, 0] == pytest.approx(np.full(182, 5.0))
    assert cloud.times is None
    assert (cloud.geometry.sensor, cloud.geometry.height) == ("rings", 0.2)


def test_gaits_stay_within_their_tilt_and_start_on_time():
    gait = Gait(math.radians(8.0), 0.02, start=3.0)
    times = np.arange(0.0, 120.0, 0.02)
    attitudes = np.degrees(gait.attitudes_at(times))
    assert np.abs(attitudes).max() <= 8.0
    assert (np.abs(attitudes).max(axis=0) > 6.0).all()
    assert np.abs(attitudes[times < 3.0]).max() == 0.0
    assert np.abs(gait.rise_at(times)).max() == pytest.approx(0.02, rel=0.01)


def test_turning_back_undoes_turning():
    rng = np.random.default_rng(3)
    attitudes, vectors = rng.uniform(-1.0, 1.0, (20, 3)), rng.normal(size=(20, 3))
    assert turned_back(attitudes, turned(attitudes, vectors)) == pytest.approx(vectors)


def test_a_body_at_rest_feels_gravity_alone():
    rig = simulate_rig(YARD, imu=NO_NOISE, motion=drive(np.zeros((1, 2))), duration=0.5)
    readings = [event for event in rig.events() if isinstance(event, Imu)]
    assert len(readings) == 101
    for reading in readings:
        assert reading.linear_acceleration == pytest.approx((0.0, 0.0, GRAVITY))
        assert reading.angular_velocity == pytest.approx((0.0, 0.0, 0.0))


def test_angular_velocities_lead_from_attitude_to_attitude():
    gait = Gait(0.14)
    turning = Motion(np.array((0.0, 20.0)), np.array([(0.0, 0.0, 0.0), (0.0, 0.0, 10.0)]))
    rig = simulate_rig(YARD, imu=NO_NOISE, gait=gait, motion=turning, duration=5.0)
    readings = [event for event in rig.events() if isinstance(event, Imu)]
    frame = np.eye(3)
    for before, after in pairwise(readings):
        mean = np.add(before.angular_velocity, after.angular_velocity) / 2.0
        x, y, z = mean / NO_NOISE.rate
        step = np.array(((0.0, -z, y), (z, 0.0, -x), (-y, x, 0.0)))
        frame = frame @ (np.eye(3) + step + step @ step / 2.0)
    begin, end = (body_poses(turning, gait, np.array((t,)))[:, [3, 4, 2]] for t in (0.0, 5.0))
    true = turned(np.repeat(end, 3, axis=0), np.eye(3)).T
    start = turned(np.repeat(begin, 3, axis=0), np.eye(3)).T
    assert start @ frame == pytest.approx(true, abs=2e-3)


def test_speeding_up_is_felt_forwards():
    rig = simulate_rig(YARD, imu=NO_NOISE, motion=drive(YARD.route, acceleration=0.5))
    felt = [e.linear_acceleration[0] for e in rig.events() if isinstance(e, Imu)]
    assert max(felt[:200]) == pytest.approx(0.5, abs=0.1)
    assert min(felt[-200:]) == pytest.approx(-0.5, abs=0.1)


def test_events_come_in_order_with_the_truth_of_each_scan():
    scanners = [MountedLidar(EXACT, "a"), MountedLidar(EXACT, "b", delay=0.07)]
    rig = simulate_rig(YARD, scanners, imu=ImuModel(), odometry=PERFECT_ODOMETRY)
    events = list(rig.events())
    times = [event.time for event in events]
    assert times == sorted(times)
    scans = [event for event in events if isinstance(event, LaserScan)]
    assert [scan.stamp for scan in scans] == pytest.approx(rig.stamps.tolist())
    assert len(rig.true_poses) == len(scans)
    last = [event for event in events if isinstance(event, Odometry)][-1]
    assert last.tf_odom_tracking == pytest.approx(Pose(2.0, 0.0, 0.0), abs=0.05)


def test_a_delayed_motion_stands_first():
    motion = delayed(drive(YARD.route), 3.0)
    assert motion.poses_at(np.array((0.0, 3.0)))[:, 0].tolist() == [0.0, 0.0]
    assert motion.poses_at(np.array((motion.duration,)))[0, 0] == pytest.approx(2.0)
    assert delayed(motion, 0.0) is motion


def test_only_the_same_seed_gives_the_same_rig_recording():
    def first(seed):
        return next(
            event
            for event in simulate_rig(YARD, [MountedLidar(Lidar())], seed=seed).events()
            if isinstance(event, LaserScan)
        ).ranges

    assert np.array_equal(first(1), first(1))
    assert not np.array_equal(first(1), first(2))


@pytest.mark.parametrize(
    "make",
    [
        lambda: MountedLidar(EXACT, sweep=1.0),
        lambda: MountedLidar(EXACT, delay=-1.0),
        lambda: ImuModel(rate=0.0),
        lambda: ImuModel(gyro_noise=-1.0),
        lambda: simulate_rig(YARD, duration=-1.0),
        lambda: simulate_rig(YARD, [MountedLidar(EXACT), replace(MountedLidar(EXACT), height=1.0)]),
    ],
)
def test_what_cannot_be_simulated_is_refused(make):
    with pytest.raises(ConfigError):
        make()


def test_a_clock_offset_is_in_the_stamps_and_not_in_the_truth():
    right = simulate_rig(YARD, [MountedLidar(EXACT)], duration=2.0)
    late = simulate_rig(YARD, [MountedLidar(EXACT, clock_offset=0.25)], duration=2.0)
    assert late.stamps == pytest.approx(right.stamps + 0.25, abs=1e-6)
    assert np.array_equal(late.true_poses, right.true_poses)
    assert np.array_equal(late.ranges, right.ranges)
