# SPDX-License-Identifier: Apache-2.0
"""Real recordings; skipped where they are absent, for none of them goes into the repository."""

import math
import os
from pathlib import Path

import numpy as np
import pytest

from cartoloop.readers import ReadOptions, open_log
from cartoloop.sensor.events import Imu, LaserScan, Odometry
from cartoloop.sensor.pose import Pose

pytestmark = pytest.mark.data

DATA = Path(os.environ.get("CARTOLOOP_DATA", Path(__file__).parents[3] / "../shared/data"))


def bag(name, **options):
    path = DATA / "bags" / f"{name}.bag"
    if not path.exists():
        pytest.skip(f"{path} is absent: set CARTOLOOP_DATA to the folder of the recordings")
    return open_log(path, ReadOptions(**options))


def count(events, kind):
    return sum(isinstance(event, kind) for event in events)


@pytest.mark.parametrize(
    ("name", "num_scans", "num_readings"),
    [
        ("b0-2014-07-21-12-42-53-short", 345, 1974),
        ("b0-2014-07-21-12-42-53-tiny", 222, 1243),
    ],
)
def test_the_backpack_is_read_by_its_level_scanner_and_imu(name, num_scans, num_readings):
    log = bag(name)
    events = list(log)
    assert count(events, LaserScan) == log.num_scans == num_scans
    assert count(events, Imu) == num_readings
    assert (np.diff([event.time for event in events]) >= 0.0).all()
    assert log.skipped == {}
    geometry = next(e.geometry for e in events if isinstance(e, LaserScan))
    assert geometry.sensor == "horizontal_laser_2d"
    assert geometry.num_beams == 1079
    assert geometry.angle_increment == pytest.approx(math.radians(0.25), rel=1e-5)
    assert geometry.time_increment == pytest.approx(1.736e-5, rel=1e-3)
    assert log.profile.no_return == pytest.approx(60.0)
    assert log.inventory.base_frame == "horizontal_laser_link"
    assert {f.code for f in log.inventory.findings} == {"missing_transform"}
    acceleration = np.mean([e.linear_acceleration for e in events if isinstance(e, Imu)], axis=0)
    assert acceleration[2] == pytest.approx(9.8, abs=0.3)


def test_the_strongest_echo_differs_from_the_first_now_and_then():
    name = "b0-2014-07-21-12-42-53-tiny"
    first = next(e for e in bag(name) if isinstance(e, LaserScan))
    strongest = next(e for e in bag(name, echo="strongest") if isinstance(e, LaserScan))
    differ = first.ranges != strongest.ranges
    assert 0 < differ.sum() < 0.2 * len(differ)
    assert (strongest.ranges[differ] > first.ranges[differ]).all()


@pytest.mark.parametrize(
    ("name", "front", "back", "num_poses", "duration"),
    [
        ("guardian_3", 1036, 1038, 2079, 104.0),
        ("guardian_controller_2", 1028, 1031, 2060, 103.1),
    ],
)
def test_the_guardian_is_read_with_both_scanners_and_odometry(
    name, front, back, num_poses, duration
):
    log = bag(name)
    events = list(log)
    scans = [event for event in events if isinstance(event, LaserScan)]
    sensors = {scan.geometry.sensor: scan.geometry for scan in scans}
    assert sum(scan.geometry.sensor == "/scan" for scan in scans) == front
    assert len(scans) == log.num_scans == front + back
    assert count(events, Odometry) == num_poses
    assert log.duration == pytest.approx(duration, abs=0.5)
    assert log.problems == []
    assert log.skipped == {}
    assert log.profile.num_beams == 681
    assert log.profile.no_return == math.inf
    assert log.inventory.base_frame == "base_footprint"
    assert sensors["/scan"].tf_tracking_sensor == pytest.approx(Pose(0.4858, 0, 0), abs=1e-3)
    tf_tracking_back = sensors["/hokuyo_back_scan"].tf_tracking_sensor
    assert tf_tracking_back.x == pytest.approx(-0.4317, abs=1e-3)
    assert abs(tf_tracking_back.theta) == pytest.approx(math.pi)
    assert sensors["/scan"].height == pytest.approx(0.372, abs=1e-3)
    assert (np.diff([event.time for event in events]) >= 0.0).all()


def test_the_inventory_of_the_guardian_names_its_odometry():
    log = bag("guardian_3")
    topics = {topic.topic: topic for topic in log.inventory.topics}
    assert topics["/guardian_node/odom"].reason == "the only odometry"
    assert topics["/tf"].stamps is not None
    assert {(t.parent, t.child) for t in log.inventory.transforms} >= {
        ("odom", "base_footprint"),
        ("base_link", "hokuyo_back_laser_link"),
        ("laser_tilt_link", "hokuyo_frontal_laser_link"),
    }
    odom = next(t for t in log.inventory.transforms if t.parent == "odom")
    assert odom.moved_m > 5.0
