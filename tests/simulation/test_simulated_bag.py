# SPDX-License-Identifier: Apache-2.0
"""Simulated bags, read back."""

from __future__ import annotations

import math

import numpy as np
import pytest

from cartoloop.errors import OutputError
from cartoloop.readers import open_log
from cartoloop.sensor.events import Imu, LaserScan, Odometry, PointCloud
from cartoloop.sensor.pose import Pose
from cartoloop.sensor.sweep_motion import rotation
from cartoloop.simulation import Lidar, OdometryModel, World
from cartoloop.simulation.bag_log import quaternion
from cartoloop.simulation.difficulties import Difficulties
from cartoloop.simulation.drives import simulate_rig
from cartoloop.simulation.gait import Gait
from cartoloop.simulation.imu import ImuModel
from cartoloop.simulation.rig import MountedLidar

WALLS = np.array([(5.0, -5.0, 5.0, 5.0), (-5.0, -5.0, -5.0, 5.0), (-5.0, 5.0, 5.0, 5.0)])
YARD = World("yard", WALLS, np.array([(0.0, 0.0), (3.0, 0.0)]))
FLAT = MountedLidar(
    Lidar(tf_tracking_sensor=Pose(0.2, 0.1, 0.3)), "flat", 0.4, 0.05, -0.1, sweep=0.1
)
RINGS = MountedLidar(
    Lidar(num_beams=60, angle_min=-1.0, angle_increment=0.03), "rings", sweep=0.05,
    elevations=(-0.1, 0.1),
)  # fmt: skip


def by_kind(events):
    kinds = {LaserScan: [], PointCloud: [], Imu: [], Odometry: []}
    for event in events:
        kinds[type(event)].append(event)
    return kinds


@pytest.fixture(scope="module")
def walk():
    return simulate_rig(
        YARD,
        [FLAT],
        gait=Gait(0.1),
        imu=ImuModel(rate=50.0),
        odometry=OdometryModel(),
        duration=3.0,
    )


@pytest.fixture(scope="module")
def read_back(walk, tmp_path_factory):
    path = tmp_path_factory.mktemp("bags") / "walk.bag"
    walk.write_bag(path)
    return by_kind(open_log(path))


def test_scans_come_back_with_their_times_and_mounting(walk, read_back):
    written = by_kind(walk.events())[LaserScan]
    assert len(read_back[LaserScan]) == len(written)
    for there, back in zip(written, read_back[LaserScan], strict=True):
        assert back.stamp == pytest.approx(there.stamp, abs=1e-6)
        seen = there.ranges < there.geometry.range_max
        assert back.ranges[seen] == pytest.approx(there.ranges[seen], abs=1e-5)
        assert np.isposinf(back.ranges[~seen]).all()
    geometry = read_back[LaserScan][0].geometry
    assert geometry.tf_tracking_sensor == pytest.approx((0.2, 0.1, 0.3))
    assert (geometry.height, geometry.roll, geometry.pitch) == pytest.approx((0.4, 0.05, -0.1))
    assert geometry.time_increment == pytest.approx(FLAT.time_increment)


def test_imu_and_odometry_come_back(walk, read_back):
    written = by_kind(walk.events())
    for kind in (Imu, Odometry):
        assert len(read_back[kind]) == len(written[kind])
    there, back = written[Imu][7], read_back[Imu][7]
    assert back.linear_acceleration == pytest.approx(there.linear_acceleration)
    assert back.angular_velocity == pytest.approx(there.angular_velocity)
    there, back = written[Odometry][-1], read_back[Odometry][-1]
    assert back.tf_odom_tracking == pytest.approx(there.tf_odom_tracking)


def test_an_imu_measures_the_motion_after_a_pause():
    route = np.array([(0.0, 0.0), (3.0, 0.0), (3.0, 3.0), (0.0, 3.0), (0.0, 0.0)])
    perfect = ImuModel(100.0, 0.0, (0.0, 0.0, 0.0), 0.0, (0.0, 0.0, 0.0))
    rooms = World("rooms", WALLS, np.vstack([route] * 4))
    whole, paused = (
        {
            reading.time: reading.angular_velocity
            for reading in by_kind(
                simulate_rig(
                    rooms, [FLAT], imu=perfect, duration=60.0, difficulties=difficulties
                ).events()
            )[Imu]
        }
        for difficulties in (Difficulties(), Difficulties(pause=8.0))
    )
    assert 700 < len(whole) - len(paused) < 900
    for time, turned in paused.items():
        assert turned == pytest.approx(whole[time], abs=1e-9)


def test_clouds_come_back(tmp_path):
    recording = simulate_rig(YARD, [RINGS], duration=1.0)
    recording.write_bag(tmp_path / "rings.bag")
    back = by_kind(open_log(tmp_path / "rings.bag"))[PointCloud]
    there = by_kind(recording.events())[PointCloud]
    assert len(back) == len(there) > 3
    assert back[0].points == pytest.approx(there[0].points, abs=1e-5)
    assert back[0].times == pytest.approx(there[0].times, abs=1e-6)


@pytest.mark.parametrize("angles", [(0.1, -0.2, 2.0), (math.pi, 0.0, 0.0), (0.0, 0.5, -3.0)])
def test_quaternions_turn_as_the_angles_do(angles):
    x, y, z, w = quaternion(*angles)
    cross = np.array(((0.0, -z, y), (z, 0.0, -x), (-y, x, 0.0)))
    assert np.eye(3) + 2.0 * w * cross + 2.0 * cross @ cross == pytest.approx(rotation(*angles))


def test_an_unwritable_path_is_reported(walk, tmp_path):
    with pytest.raises(OutputError, match="cannot be written"):
        walk.write_bag(tmp_path / "nowhere" / "walk.bag")
    assert list(tmp_path.iterdir()) == []
