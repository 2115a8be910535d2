# SPDX-License-Identifier: Apache-2.0
"""The clock offset of a further scanner is found from where it sees the robot."""

from __future__ import annotations

import heapq
from dataclasses import replace

import numpy as np
import pytest

from cartoloop.local_slam.scanner_clocks import WINDOW, ScannerClocks, scanner_offset
from cartoloop.sensor.events import LaserScan
from cartoloop.sensor.pose import Pose, compose_all
from cartoloop.simulation import Lidar, OdometryModel, drive
from cartoloop.simulation.drives import simulate_rig
from cartoloop.simulation.rig import MountedLidar
from tests.local_slam.small_world import errors, furnished_room, run
from tests.local_slam.test_odometry_calibration import at, winding_way

WAY = winding_way()


def scans(offset=0.0, period=0.1, begin=5.0, end=60.0, noise=(0.008, 0.002), seed=1):
    """Times by the scanner's clock, and where it sees the robot."""
    stamps = np.arange(begin, end, period)
    poses = at(stamps + offset, WAY)
    poses += np.random.default_rng(seed).normal(size=poses.shape) * (noise[0], noise[0], noise[1])
    return stamps, poses


@pytest.mark.parametrize("offset", [-0.3, -0.1, 0.04, 0.25])
def test_an_offset_is_found_to_some_milliseconds(offset):
    times, poses = scans(offset)
    reference = scans(period=0.083, begin=1.0, end=70.0, seed=2)
    assert scanner_offset(times, poses, *reference) == pytest.approx(offset, abs=0.006)


def test_equal_clocks_have_no_offset():
    for seed in range(5):
        times, poses = scans(seed=seed)
        assert scanner_offset(times, poses, *scans(begin=1.0, end=70.0, seed=seed + 10)) == 0.0


def test_a_wrong_mounting_is_no_offset():
    times, poses = scans(0.1)
    off = compose_all(poses, np.array((0.05, -0.03, 0.02)))
    found = scanner_offset(times, off, *scans(begin=1.0, end=70.0, seed=2))
    assert found == pytest.approx(0.1, abs=0.006)


def test_a_robot_at_rest_shows_no_offset():
    times, poses = scans(0.2)
    still = poses * 1e-3
    assert scanner_offset(times, still, times, still) == 0.0


def test_without_the_reference_nothing_is_known():
    times, poses = scans()
    assert scanner_offset(times, poses, times[:1], poses[:1]) is None
    assert scanner_offset(times, poses, times + 500.0, poses) is None


def test_offsets_are_estimated_while_scans_come_in():
    clocks, changes = ScannerClocks(), []
    streams = [
        [(time, name, Pose(*pose)) for time, pose in zip(*scans(offset, end=100.0), strict=True)]
        for name, offset in (("front", 0.0), ("rear", 0.12))
    ]
    for time, name, pose in heapq.merge(*streams):
        changes.append(clocks.add(name, time + clocks.offset_of(name), pose))
    assert clocks.offsets["front"] == 0.0
    assert clocks.offsets["rear"] == pytest.approx(0.12, abs=0.006)
    assert sum(changes) == pytest.approx(clocks.offsets["rear"])
    assert all(len(series.times) <= 2 * WINDOW for series in clocks._series.values())


def test_what_was_known_before_is_used_at_once():
    clocks = ScannerClocks({"front": 0.3, "rear": 0.1})
    assert [clocks.offset_of(name) for name in ("front", "rear", "top")] == [0.0, 0.1, 0.0]


OFFSET = 0.1


@pytest.mark.slow
def test_two_scanners_with_different_clocks_make_one_map():
    lidar = Lidar(rate=10.0)
    front = MountedLidar(replace(lidar, tf_tracking_sensor=Pose(0.3, 0.1, 0.2)), "front")
    back = MountedLidar(replace(lidar, tf_tracking_sensor=Pose(-0.3, -0.1, 3.1)), "rear")
    world = furnished_room()
    motion = drive(np.vstack([world.route] * 3), 0.8, 1.0)
    recording = simulate_rig(
        world, [front, back], motion=motion, odometry=OdometryModel(time_offset=0.0), seed=3
    )

    def stamped(events):
        for event in events:
            if isinstance(event, LaserScan) and event.geometry.sensor == "rear":
                yield replace(event, time=event.time + OFFSET)
            else:
                yield event

    events = sorted(stamped(recording.events()), key=lambda event: event.time)
    poses, _, slam = run(events)

    known = slam.calibration
    assert known.scanner_offsets["rear"] == pytest.approx(-OFFSET, abs=0.01)
    assert known.odometry.rotation_scale == pytest.approx(1.0 / 0.98, rel=0.02)
    assert known.odometry.yaw == pytest.approx(0.0, abs=np.radians(1.0))
    is_front = [e.geometry.sensor == "front" for e in events if isinstance(e, LaserScan)]
    stamps = [e.stamp for e in events if isinstance(e, LaserScan)]
    truth = dict(zip(recording.stamps, recording.true_poses, strict=True))
    true_poses = np.array([truth[stamp] for stamp in stamps])
    off, _ = errors(poses[is_front], true_poses[is_front])
    assert off.max() < 0.1  # while the clock is not known
    assert off[100:].max() < 0.06
