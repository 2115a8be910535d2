# SPDX-License-Identifier: Apache-2.0
import math

import numpy as np
import pytest

from cartoloop.errors import InputError
from cartoloop.readers import ReadOptions, open_log
from cartoloop.readers.ros.bag import inspect_recording
from cartoloop.sensor.events import Imu, LaserScan, Odometry
from cartoloop.sensor.pose import Pose
from tests.readers.ros.bag_files import START, BagMaker, ranges_of

LEVEL = (0.0, 0.0, 0.0)


def recording(tmp_path, scanners, mountings=(), *, num=12, extra=lambda bag, t, i: None):
    """Write a bag with scans of {topic: frame} and transforms; return its path."""
    bag = BagMaker("bag")
    if mountings:
        bag.add("/tf_static", bag.make.transforms(START, *mountings), 0.0)
    for i in range(num):
        t = 0.1 * (i + 1)
        for k, (topic, frame) in enumerate(scanners.items()):
            bag.add(topic, bag.make.scan(START + t + 0.01 * k, ranges_of(i), frame), t + 0.01 * k)
        extra(bag, t, i)
    return bag.write(tmp_path)


def scans_of(log):
    return [event for event in log if isinstance(event, LaserScan)]


def reason(log, topic):
    return next(t.reason for t in log.inventory.topics if t.topic == topic)


def codes(log):
    return [finding.code for finding in log.inventory.findings]


TWO = {"/scan": "front", "/back_scan": "back"}
MOUNTINGS = (
    ("base_footprint", "base_link", (0, 0, 0.1), LEVEL),
    ("base_link", "front", (0.4, 0, 0.2), LEVEL),
    ("base_link", "back", (-0.4, 0, 0.2), (0, 0, math.pi)),
)


def test_several_scanners_are_used_if_asked_for(tmp_path):
    path = recording(tmp_path, TWO, MOUNTINGS)
    log = open_log(path, ReadOptions(scan_topics=("/back_scan", "scan")))
    assert log.inventory.base_frame == "base_footprint"
    by_sensor = {scan.geometry.sensor: scan.geometry for scan in scans_of(log)}
    assert by_sensor["/scan"].tf_tracking_sensor == pytest.approx(Pose(0.4, 0, 0))
    assert by_sensor["/scan"].height == pytest.approx(0.3)
    assert abs(by_sensor["/back_scan"].tf_tracking_sensor.theta) == pytest.approx(math.pi)
    assert list(log.profiles) == ["/back_scan", "/scan"]
    assert log.num_scans == len(scans_of(log)) == 24


def test_all_level_scanners_are_used_the_front_one_first(tmp_path):
    log = open_log(recording(tmp_path, TWO, MOUNTINGS))
    assert list(log.profiles) == ["/scan", "/back_scan"]
    assert {scan.geometry.sensor for scan in scans_of(log)} == {"/scan", "/back_scan"}
    assert "at x -0.40, y 0.00, z 0.30 m" in reason(log, "/back_scan")
    (tmp_path / "drive.bag").unlink()
    log = open_log(recording(tmp_path, TWO, MOUNTINGS[:2]))
    assert list(log.profiles) == ["/scan"]
    assert reason(log, "/back_scan") == "no transform from base_footprint to back"


def test_a_topic_that_is_not_there_is_named_with_those_that_are(tmp_path):
    path = recording(tmp_path, TWO, MOUNTINGS)
    with pytest.raises(InputError, match=r"/laser holds no scans; there is .*/scan"):
        open_log(path, ReadOptions(scan_topics=("/laser",)))
    with pytest.raises(InputError, match="no odometry; there is no such topic"):
        open_log(path, ReadOptions(odom_topic="/odom"))


def test_a_tilted_scanner_is_left_out_with_a_reason(tmp_path):
    mountings = (*MOUNTINGS[:2], ("base_link", "back", (0, 0, 1), (0, math.radians(40), 0)))
    log = open_log(recording(tmp_path, TWO, mountings))
    assert {scan.geometry.sensor for scan in scans_of(log)} == {"/scan"}
    assert "tilted by 40 deg" in reason(log, "/back_scan")


def test_a_lone_tilted_scanner_is_mapped_with_a_warning(tmp_path):
    mounting = ("base_link", "front", (0, 0, 1), (0, math.radians(90), 0))
    log = open_log(recording(tmp_path, {"/scan": "front"}, [mounting]))
    geometry = scans_of(log)[0].geometry
    assert (geometry.roll, geometry.pitch) == (0.0, 0.0)
    assert codes(log) == ["tilted_scanner"]


@pytest.mark.parametrize("tilt", [(0.0, 0.0), (0.05, -0.08)])
def test_beams_of_a_scanner_upside_down_are_mirrored(tmp_path, tilt):
    roll, pitch, yaw = math.pi + tilt[0], tilt[1], 0.7
    mounting = ("base_link", "front", (0.1, 0.2, 0.3), (roll, pitch, yaw))
    log = open_log(recording(tmp_path, {"/scan": "front"}, [mounting]))
    geometry = scans_of(log)[0].geometry
    assert geometry.angle_increment < 0.0
    assert (geometry.roll, geometry.pitch) == pytest.approx(tilt)
    sent = -1.5 + 3.0 / 60 * np.arange(61)
    points = np.stack([np.cos(sent), np.sin(sent), np.zeros(61)])
    seen = rotation(roll, pitch, yaw) @ points
    ours = np.stack([np.cos(geometry.angles), np.sin(geometry.angles), np.zeros(61)])
    turned = rotation(geometry.roll, geometry.pitch, geometry.tf_tracking_sensor.theta) @ ours
    np.testing.assert_allclose(turned, seen, atol=1e-6)
    assert "upside down" in reason(log, "/scan")


def rotation(roll, pitch, yaw):
    def turn(axis, angle):
        c, s = math.cos(angle), math.sin(angle)
        i, j = [(1, 2), (2, 0), (0, 1)][axis]
        matrix = np.eye(3)
        matrix[i, i] = matrix[j, j] = c
        matrix[i, j], matrix[j, i] = -s, s
        return matrix

    return turn(2, yaw) @ turn(1, pitch) @ turn(0, roll)


def test_without_transforms_the_scanner_frame_is_tracked(tmp_path):
    log = open_log(recording(tmp_path, {"/vertical": "v", "/horizontal": "h"}))
    assert log.inventory.base_frame == "h"
    assert {scan.geometry.sensor for scan in scans_of(log)} == {"/horizontal"}
    assert "missing_transform" in codes(log)
    reported = " ".join(problem.message for problem in log.problems)
    assert "no transform from base_link to h (/horizontal)" in reported
    assert "--laser-pose X,Y,YAW" in reported
    assert "no transform from h to v" in reason(log, "/vertical")


def test_a_urdf_file_says_where_the_scanner_sits(tmp_path):
    urdf = tmp_path / "robot.urdf"
    urdf.write_text(
        '<robot name="r"><joint name="j" type="fixed"><parent link="base_link"/>'
        '<child link="front"/><origin xyz="0.3 0 0.2"/></joint></robot>'
    )
    log = open_log(recording(tmp_path, {"/scan": "front"}), ReadOptions(urdf=urdf))
    assert scans_of(log)[0].geometry.tf_tracking_sensor == pytest.approx(Pose(0.3, 0, 0))
    assert [t.origin for t in log.inventory.transforms] == ["urdf"]
    assert log.problems == []


def test_a_recorded_robot_description_gives_the_mounting(tmp_path):
    urdf = (
        '<robot name="r"><joint name="j" type="fixed"><parent link="base_link"/>'
        '<child link="front"/><origin xyz="0.3 0 0.2"/></joint></robot>'
    )

    def describe(bag, t, i):
        if i == 5:
            bag.add("/robot_description", bag.make.make("std_msgs/msg/String", data=urdf), t)

    log = open_log(recording(tmp_path, {"/scan": "front"}, extra=describe))
    assert scans_of(log)[0].geometry.tf_tracking_sensor == pytest.approx(Pose(0.3, 0, 0))


def test_a_moving_mounting_is_reported_and_its_first_pose_used(tmp_path):
    def nod(bag, t, i):
        pose = ("base_link", "front", (0.2, 0.0, 0.01 * i), LEVEL)
        bag.add("/tf", bag.make.transforms(START + t, pose), t)

    log = open_log(recording(tmp_path, {"/scan": "front"}, extra=nod))
    assert scans_of(log)[0].geometry.height == 0.0
    (finding,) = log.inventory.findings
    assert finding.code == "moving_mounting"
    assert "base_link to front moves (by up to 0.110 m" in finding.message


def test_a_filtered_copy_of_a_scanner_is_not_a_second_scanner(tmp_path):
    bag = BagMaker("bag")
    for i in range(12):
        for topic in ("/scan_filtered", "/scan"):
            bag.add(topic, bag.make.scan(START + 0.1 * i, ranges_of(i), "base_link"), 0.1 * i)
    log = open_log(bag.write(tmp_path))
    assert {scan.geometry.sensor for scan in scans_of(log)} == {"/scan"}
    assert reason(log, "/scan_filtered") == "the same sweeps as /scan"


def test_wheel_odometry_is_preferred_to_derived_odometry(tmp_path):
    def odometry(bag, t, i):
        for topic in ("/odometry/filtered", "/ground_truth", "/odom", "/slam_odom"):
            bag.add(topic, bag.make.odometry(START + t, (0.1 * i, 0, 0)), t)

    path = recording(tmp_path, {"/scan": "base_link"}, extra=odometry)
    log = open_log(path)
    assert [t.topic for t in log.inventory.chosen] == ["/odom", "/scan"]
    assert "--odom-topic for this one" in reason(log, "/ground_truth")
    log = open_log(path, ReadOptions(odom_topic="/ground_truth"))
    assert [t.topic for t in log.inventory.chosen] == ["/ground_truth", "/scan"]
    log = open_log(path, ReadOptions(odom_topic="none"))
    assert not log.profile.has_odometry
    assert not any(isinstance(event, Odometry) for event in log)


def test_odometry_that_never_moves_is_left_out(tmp_path):
    def odometry(bag, t, i):
        bag.add("/odom", bag.make.odometry(START + t, (0, 0, 0)), t)

    log = open_log(recording(tmp_path, {"/scan": "base_link"}, extra=odometry))
    assert reason(log, "/odom") == "its pose never changes"
    assert not log.profile.has_odometry


def test_odometry_of_another_frame_is_turned_into_the_base(tmp_path):
    def odometry(bag, t, i):
        bag.add("/odom", bag.make.odometry(START + t, (1.0 + 0.1 * i, 0, 1.0), child="wheels"), t)

    mountings = [
        ("base_link", "wheels", (0.5, 0.0, 0.0), (0, 0, math.pi / 2)),
        ("base_link", "front", (0, 0, 0), LEVEL),
    ]
    log = open_log(recording(tmp_path, {"/scan": "front"}, mountings, extra=odometry))
    pose = next(e.tf_odom_tracking for e in log if isinstance(e, Odometry))
    yaw = 1.0 - math.pi / 2
    assert pose == pytest.approx(Pose(1.0 - 0.5 * math.cos(yaw), -0.5 * math.sin(yaw), yaw))


def test_a_moving_transform_replaces_missing_odometry(tmp_path):
    def odometry(bag, t, i):
        pose = ("odom", "base_link", (0.1 * i, 0.0, 0.0), LEVEL)
        old = ("odom", "base_link", (0.1 * (i - 1), 0.0, 0.0), LEVEL)
        bag.add("/tf", bag.make.transforms(START + t, pose), t)
        if i:
            bag.add("/tf", bag.make.transforms(START + t, pose), t + 0.001)
            bag.add("/tf", bag.make.transforms(START + t + 0.05, old, pose), t + 0.05)

    mounting = [("base_link", "front", (0.2, 0, 0), LEVEL)]
    log = open_log(recording(tmp_path, {"/scan": "front"}, mounting, extra=odometry))
    events = list(log)
    odometry_events = [e for e in events if isinstance(e, Odometry)]
    assert len(odometry_events) == 23  # one a stamp: repeated ones are left out
    assert (np.diff([e.time for e in events]) >= 0.0).all()
    assert "odom -> base_link serves as odometry" in reason(log, "/tf")
    assert odometry_events[-1].tf_odom_tracking.x == pytest.approx(1.0)


def imu_recording(tmp_path, acceleration, mounting=None, **values):
    def imu(bag, t, i):
        bag.add("/imu", bag.make.imu(START + t, acceleration, (0.1, 0.2, 0.3), **values), t)

    mountings = [mounting] if mounting else []
    return recording(tmp_path, {"/scan": "base_link"}, mountings, extra=imu)


def first_imu(log):
    return next(event for event in log if isinstance(event, Imu))


def test_readings_are_turned_into_the_tracking_frame(tmp_path):
    mounting = ("base_link", "imu", (0, 0, 0.1), (math.pi, 0.0, math.pi / 2))
    imu = first_imu(open_log(imu_recording(tmp_path, (1.0, 0.0, -9.8), mounting)))
    assert imu.linear_acceleration == pytest.approx((0.0, 1.0, 9.8))
    assert imu.angular_velocity == pytest.approx((0.2, 0.1, -0.3))


def test_an_unmounted_imu_is_used_if_its_z_axis_points_up(tmp_path):
    log = open_log(imu_recording(tmp_path, (0.5, 0.0, 9.8)))
    assert first_imu(log).linear_acceleration == (0.5, 0.0, 9.8)
    assert "missing_transform" in codes(log)


def test_an_unmounted_imu_on_its_side_is_left_out(tmp_path):
    log = open_log(imu_recording(tmp_path, (9.8, 0.0, 0.5)))
    assert not log.profile.has_imu
    assert "does not point up" in reason(log, "/imu")


def test_accelerations_in_g_become_metres_per_second_squared(tmp_path):
    mounting = ("base_link", "imu", (0, 0, 0.1), LEVEL)
    log = open_log(imu_recording(tmp_path, (0.0, 0.0, 1.0), mounting))
    assert first_imu(log).linear_acceleration[2] == pytest.approx(9.80665)
    assert codes(log) == ["acceleration_in_g"]


def imu_with(tmp_path, acceleration, velocity):
    def imu(bag, t, i):
        bag.add("/imu", bag.make.imu(START + t, acceleration, velocity), t)

    mounting = ("base_link", "imu", (0, 0, 0.1), LEVEL)
    return open_log(recording(tmp_path, {"/scan": "base_link"}, [mounting], extra=imu))


def test_angular_velocities_in_degrees_become_radians(tmp_path):
    log = imu_with(tmp_path, (0.0, 0.0, 9.8), (0.0, 0.0, 45.0))
    assert first_imu(log).angular_velocity[2] == pytest.approx(math.radians(45.0))
    assert codes(log) == ["velocity_in_degrees"]


def test_glitches_of_the_gyroscope_are_no_degrees(tmp_path):
    def imu(bag, t, i):
        glitch = i % 10 == 0
        velocity, up = (900.0, 0.1) if glitch else (0.5, 9.8)
        bag.add("/imu", bag.make.imu(START + t, (0.0, 0.0, up), (0.0, 0.0, velocity)), t)

    mounting = ("base_link", "imu", (0, 0, 0.1), LEVEL)
    log = open_log(recording(tmp_path, {"/scan": "base_link"}, [mounting], extra=imu))
    assert "velocity_in_degrees" not in codes(log)


def test_an_imu_without_gravity_still_gives_the_heading(tmp_path):
    log = imu_with(tmp_path, (0.1, 0.0, 0.2), (0.0, 0.0, 0.5))
    assert first_imu(log).angular_velocity[2] == 0.5
    assert codes(log) == ["no_gravity"]


def test_an_imu_without_gyroscope_is_left_out(tmp_path):
    log = open_log(imu_recording(tmp_path, (0.0, 0.0, 9.8), covariances=(-1.0, 0.0)))
    assert not log.profile.has_imu
    assert "no angular velocity" in reason(log, "/imu")


def test_a_recording_without_scans_names_its_topics(tmp_path):
    bag = BagMaker("db3")
    for i in range(3):
        bag.add("/odom", bag.make.odometry(START + i, (0, 0, 0)), i)
    with pytest.raises(InputError, match="no laser scans and no point clouds, only /odom"):
        open_log(bag.write(tmp_path))


def test_a_recording_that_cannot_be_mapped_has_an_inventory(tmp_path):
    bag = BagMaker("db3")
    for i in range(3):
        bag.add("/odom", bag.make.odometry(START + i, (0, 0, 0)), i)
    inventory, log = inspect_recording(bag.write(tmp_path))
    assert log is None
    assert inventory.findings[0].code == "unusable"
    assert "no laser scans" in inventory.findings[0].message
    assert [(t.topic, t.count, t.chosen) for t in inventory.topics] == [("/odom", 3, False)]


def test_a_recording_has_an_inventory_and_a_log(tmp_path):
    inventory, log = inspect_recording(recording(tmp_path, {"/scan": "base_link"}))
    assert inventory is log.inventory
    assert [t.topic for t in inventory.chosen] == ["/scan"]


@pytest.mark.parametrize(
    ("values", "code"),
    [
        ({"angle_max": 3.0}, "angle_max"),
        ({"angle_increment": 0.0}, "angle_max"),
        ({"time_increment": 0.1}, "time_increment"),
        ({"range_min": 5.0, "range_max": 5.0}, "range_limits"),
        ({"range_max": math.nan}, "range_limits"),
    ],
)
def test_beams_that_do_not_fit_are_noted_and_mapped(tmp_path, values, code):
    bag = BagMaker("bag")
    for i in range(12):
        scan = bag.make.scan(START + 0.1 * i, ranges_of(i), "base_link", **values)
        bag.add("/scan", scan, 0.1 * i)
    log = open_log(bag.write(tmp_path))
    (finding,) = log.inventory.findings
    assert (finding.severity, finding.code) == ("note", code)
    geometry = scans_of(log)[0].geometry
    assert geometry.angle_increment == pytest.approx(0.05, rel=1e-5)
    assert geometry.time_increment == 0.0
    assert geometry.range_min < 1.0
    assert geometry.range_max > 4.0


def test_a_topic_with_several_frames_is_reported(tmp_path):
    bag = BagMaker("bag")
    for i in range(12):
        frame = "base_link" if i % 3 else "other"
        bag.add("/scan", bag.make.scan(START + 0.1 * i, ranges_of(i), frame), 0.1 * i)
    log = open_log(bag.write(tmp_path))
    assert codes(log) == ["several_frames"]
    assert "(base_link, other)" in log.problems[0].message


def test_invalid_transforms_are_reported(tmp_path):
    def rubbish(bag, t, i):
        if i == 3:
            bag.add_raw("/tf", "tf2_msgs/msg/TFMessage", bytes([255] * 20), t)

    log = open_log(recording(tmp_path, {"/scan": "base_link"}, extra=rubbish))
    assert codes(log) == ["undecodable"]
