# SPDX-License-Identifier: Apache-2.0
import math
import shutil
import sqlite3

import numpy as np
import pytest

from cartoloop.errors import InputError
from cartoloop.readers import ReadOptions, open_log, open_logs
from cartoloop.readers.copies import CopyFinder
from cartoloop.readers.ros.index import TopicStream, is_copy
from cartoloop.readers.ros.opening import is_recording
from cartoloop.readers.ros.zstd import zstd
from cartoloop.sensor.events import Imu, LaserScan, Odometry, PointCloud
from cartoloop.sensor.pose import Pose
from tests.readers.ros.bag_files import FORMATS, LASER, NANO, START, BagMaker, drive, ranges_of


def events_of(log, kind):
    return [event for event in log if isinstance(event, kind)]


def check_drive(log, num_scans=30):
    """Check that a log holds what `drive` put into it."""
    events = list(log)
    times = np.array([event.time for event in events])
    assert (np.diff(times) >= 0.0).all()
    scans = [e for e in events if isinstance(e, LaserScan)]
    assert len(scans) == log.num_scans == num_scans
    assert sum(isinstance(e, Odometry) for e in events) == 2 * num_scans
    assert sum(isinstance(e, Imu) for e in events) == 5 * num_scans
    for i, scan in enumerate(scans):
        assert scan.stamp == scan.time == pytest.approx(START + 0.1 + 0.1 * i, abs=1e-6)
        np.testing.assert_array_equal(scan.ranges, ranges_of(i).astype(np.float32))
    geometry = scans[0].geometry
    assert geometry is scans[-1].geometry
    assert geometry.tf_tracking_sensor == pytest.approx(Pose(0.2, 0.0, 0.0))
    assert geometry.height == pytest.approx(0.3)
    assert geometry.time_increment == pytest.approx(1e-4)
    assert geometry.sensor == "/scan"
    assert log.skipped == {}
    assert log.profile.has_odometry
    assert log.profile.has_imu
    assert log.profile.rate == pytest.approx(10.0, rel=1e-3)
    return events


@pytest.mark.parametrize("form", FORMATS)
def test_every_format_yields_the_same_events_in_order_of_time(form, tmp_path):
    log = open_log(drive(form).write(tmp_path))
    check_drive(log)
    check_drive(log)
    assert log.problems == []
    assert log.time_report.is_sound
    assert log.duration == pytest.approx(3.0, abs=0.1)
    poses = [e.tf_odom_tracking for e in events_of(log, Odometry)]
    assert poses[7] == pytest.approx(Pose(0.07, 0.0, 0.0))
    imu = events_of(log, Imu)[0]
    assert imu.linear_acceleration == (0.1, 0.0, 9.8)
    assert imu.angular_velocity == (0.0, 0.0, 0.02)


@pytest.mark.parametrize("form", FORMATS)
def test_messages_that_are_held_twice_are_read_once(form, tmp_path):
    (tmp_path / "twice").mkdir()
    once, twice = drive(form), drive(form)
    twice.messages = [message for message in twice.messages for _ in range(2)]

    log = open_log(twice.write(tmp_path / "twice"))
    events = list(log)

    expected = check_drive(open_log(once.write(tmp_path)))
    assert [(type(event), event.time) for event in events] == [
        (type(event), event.time) for event in expected
    ]
    assert log.num_scans == 30
    assert log.skipped == {"exact copy of a scan before": 30}
    assert log.problems == []


@pytest.mark.parametrize(("seconds", "has_copy"), [(START, True), (0.0, False)])
def test_equal_messages_without_a_stamp_are_no_copies(seconds, has_copy):
    bag, copies = BagMaker(), CopyFinder()
    bag.add("/odom", bag.make.odometry(seconds, (0.0, 0.0, 0.0)), 0.0)
    ((topic, msgtype, _, raw),) = bag.messages
    stream = TopicStream(topic, msgtype, "odometry", is_ros1=True)

    assert not is_copy(raw, stream, copies)
    assert is_copy(raw, stream, copies) is has_copy


@pytest.mark.parametrize("compression", ["BZ2", "LZ4"])
def test_compressed_ros1_bags_are_read(compression, tmp_path):
    check_drive(open_log(drive().write(tmp_path, compression=compression)))


@pytest.mark.parametrize("form", ["db3", "mcap"])
@pytest.mark.parametrize("mode", ["FILE", "MESSAGE", "STORAGE"])
def test_compressed_ros2_recordings_are_read(form, mode, tmp_path):
    if (form, mode) == ("db3", "STORAGE"):
        pytest.skip("databases have no compression of their own")
    check_drive(open_log(drive(form).write(tmp_path, compression=mode)))


@pytest.mark.parametrize("form", ["db3", "mcap"])
def test_file_metadata_and_packed_form_are_recognised(form, tmp_path):
    folder = drive(form).write(tmp_path)
    (file,) = folder.glob(f"*.{form}")
    bare = tmp_path / "bare.recording"
    shutil.copy(file, bare)
    check_drive(open_log(bare))
    check_drive(open_log(folder / "metadata.yaml"))
    packed = tmp_path / f"packed.{form}.zstd"
    packed.write_bytes(zstd.compress(file.read_bytes()))
    check_drive(open_log(packed))


@pytest.mark.parametrize("form", ["db3", "mcap"])
def test_a_folder_without_metadata_is_read_with_a_warning(form, tmp_path):
    folder = drive(form).write(tmp_path)
    (folder / "metadata.yaml").unlink()
    log = open_log(folder)
    check_drive(log)
    assert any("no metadata.yaml" in problem.message for problem in log.problems)


def test_a_database_without_type_definitions_is_read(tmp_path):
    (file,) = drive("db3").write(tmp_path).glob("*.db3")
    with sqlite3.connect(file) as connection:
        for table in ("message_definitions", "schema", "metadata"):
            connection.execute(f"DROP TABLE {table}")
        connection.execute("ALTER TABLE topics DROP COLUMN type_description_hash")
    connection.close()
    check_drive(open_log(file))


def test_scans_recorded_late_come_in_the_order_of_their_stamps(tmp_path):
    bag = BagMaker("mcap")
    for i in range(40):
        stamp = START + 0.1 * i
        bag.add("/odom", bag.make.odometry(stamp + 0.05, (0.1 * i, 0, 0)), 0.1 * i + 0.06)
        bag.add("/scan", bag.make.scan(stamp, ranges_of(i)), 0.1 * i + 0.31)
    bag.messages.sort(key=lambda m: m[2])
    events = list(open_log(bag.write(tmp_path)))
    assert [type(e) for e in events] == [LaserScan, Odometry] * 40
    assert (np.diff([e.time for e in events]) > 0.0).all()


def test_beam_counts_may_change_between_scans(tmp_path):
    bag = BagMaker("bag")
    for i in range(20):
        beams = 451 if i % 3 else 456
        bag.add("/scan", bag.make.scan(START + 0.1 * i, ranges_of(i, beams)), 0.1 * i)
    scans = events_of(open_log(bag.write(tmp_path)), LaserScan)
    assert [len(s.ranges) for s in scans] == [451 if i % 3 else 456 for i in range(20)]
    assert len({id(s.geometry) for s in scans}) == 2
    assert all(s.geometry.num_beams == len(s.ranges) for s in scans)


def test_the_meaning_of_ranges_is_kept(tmp_path):
    bag = BagMaker("db3")
    odd = [math.inf, -math.inf, math.nan, 0.0, 31.0]
    for i in range(9):
        values = [*odd, *ranges_of(i, 40)] if i == 0 else ranges_of(i, 45)
        bag.add("/scan", bag.make.scan(START + 0.1 * i, values), 0.1 * i)
    scan = next(iter(open_log(bag.write(tmp_path))))
    np.testing.assert_array_equal(scan.ranges[:5], odd)
    assert scan.geometry.range_max <= 30.0
    assert scan.geometry.range_min >= 0.1
    assert not scan.geometry.no_return_is_free


def test_a_no_return_value_beyond_range_max_clears(tmp_path):
    bag = BagMaker("bag")
    for i in range(60):
        ranges = ranges_of(3 * i, 90)
        ranges[20:60] = 65.533
        bag.add("/scan", bag.make.scan(START + 0.1 * i, ranges, range_max=64.0), 0.1 * i)
    log = open_log(bag.write(tmp_path))
    assert log.profile.no_return == pytest.approx(65.533)
    assert next(iter(log)).geometry.no_return_is_free


def test_clouds_are_read_if_there_are_no_scans(tmp_path):
    dtype = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("t", "<u4")])
    bag = BagMaker("mcap")
    bearing = np.linspace(-3.0, 3.0, 200)
    for i in range(10):
        data = np.zeros(200, dtype)
        data["x"], data["y"], data["z"] = 5 * np.cos(bearing), 5 * np.sin(bearing), 0.5
        data["t"] = np.linspace(0, 90_000_000, 200)
        bag.add("/points", bag.make.cloud(START + 0.1 * i, data, dtype), 0.1 * i)
    mounting = ("base_link", "lidar", (0.0, 0.1, 1.2), (0.0, 0.1, 0.2))
    bag.add("/tf_static", bag.make.transforms(START, mounting), 0.0)
    log = open_log(bag.write(tmp_path))
    clouds = events_of(log, PointCloud)
    assert len(clouds) == log.num_scans == 10
    assert clouds[3].points.shape == (200, 3)
    assert clouds[3].times[-1] == pytest.approx(0.09)
    geometry = clouds[3].geometry
    assert geometry is clouds[0].geometry
    assert geometry.tf_tracking_sensor == pytest.approx(Pose(0.0, 0.1, 0.2))
    assert (geometry.height, geometry.pitch) == pytest.approx((1.2, 0.1))
    assert log.profile.num_beams == 200


def test_several_bags_are_one_log_in_a_row(tmp_path):
    (tmp_path / "a").mkdir()
    (tmp_path / "b").mkdir()
    logs = open_logs([drive("bag").write(tmp_path / "a"), drive("mcap").write(tmp_path / "b")])
    times = [scan.time for scan in events_of(logs, LaserScan)]
    assert len(times) == 60
    assert (np.diff(times) > 0.0).all()


def test_messages_that_make_no_sense_are_skipped_and_counted(tmp_path):
    bag = drive("bag", imu=False)
    make = bag.make
    broken = make.encode(make.scan(START + 3.2, ranges_of(0)))
    bag.add_raw("/scan", LASER, broken[: len(broken) // 2], 3.2)
    bag.add_raw("/scan", LASER, b"\x01", 3.3)
    bag.add("/scan", make.scan(START + 3.4, ranges_of(0), angle_increment=math.nan), 3.4)
    bag.add("/scan", make.scan(START + 3.5, [], angle_increment=math.nan), 3.5)
    bag.add("/scan", make.scan(START + 3.55, ranges_of(0), angle_min=-135.0), 3.55)
    bag.add("/odom", make.odometry(START + 3.6, (math.nan, 0.0, 0.0)), 3.6)
    log = open_log(bag.write(tmp_path))
    assert (
        len(events_of(log, LaserScan)) == 31
    )  # a broken increment is replaced by the other angles
    assert log.skipped == {
        "cut off": 2,
        "scan without ranges": 1,
        "angle of the first beam is not in radians": 1,
        "odometry pose is not valid": 1,
    }
    assert all("\n" not in problem.message for problem in log.problems)
    assert any("/scan: stamp 17000000" in problem.message for problem in log.problems)


def test_the_recording_may_be_said_to_sit_elsewhere(tmp_path):
    path = drive("bag").write(tmp_path)
    log = open_log(path, ReadOptions(laser_pose=Pose(0.5, 0.1, 1.0)))
    geometry = events_of(log, LaserScan)[0].geometry
    assert geometry.tf_tracking_sensor == pytest.approx(Pose(0.5, 0.1, 1.0))
    assert geometry.height == 0.0


def test_the_topics_in_use_are_listed_with_reasons(tmp_path):
    log = open_log(drive("bag").write(tmp_path))
    text = log.description
    assert "/scan  LaserScan, 30 messages, 10 Hz: used (at x 0.20, y 0.00, z 0.30 m" in text
    assert "/odom  Odometry, 60 messages, 20 Hz: used (the only odometry)" in text
    assert "/imu  Imu, 150 messages, 50 Hz: used" in text
    assert "tracking frame  base_link" in text
    assert log.profile.describe() in text


def test_the_inventory_holds_topics_transforms_and_choices(tmp_path):
    bag = drive("mcap")
    bag.add("/chatter", bag.make.make("std_msgs/msg/String", data="hello"), 0.5)
    inventory = open_log(bag.write(tmp_path)).inventory
    topics = {topic.topic: topic for topic in inventory.topics}
    assert set(topics) == {"/scan", "/odom", "/imu", "/tf_static", "/chatter"}
    assert {topic.topic for topic in inventory.chosen} == {"/scan", "/odom", "/imu"}
    scan = topics["/scan"]
    assert (scan.role, scan.count, scan.frames) == ("scan", 30, ("laser",))
    assert scan.stamps.rate == pytest.approx(10.0, rel=1e-3)
    assert scan.stamps.gaps == ()
    assert scan.stamps.delay == pytest.approx(0.001, abs=1e-5)
    assert topics["/odom"].child_frames == ("base_link",)
    assert (topics["/chatter"].role, topics["/chatter"].count) == ("other", 1)
    laser = next(t for t in inventory.transforms if t.child == "laser")
    assert (laser.parent, laser.origin, laser.count) == ("base_link", "tf_static", 1)
    assert (laser.x, laser.z) == pytest.approx((0.2, 0.3))
    assert inventory.base_frame == "base_link"
    assert inventory.findings == ()


def test_other_files_are_left_to_other_readers(tmp_path):
    (tmp_path / "a.log").write_text("FLASER 1 2\n")
    assert not is_recording(tmp_path / "a.log")
    assert not is_recording(tmp_path / "missing.bag")
    with pytest.raises(InputError, match="does not exist"):
        open_log(tmp_path / "missing.bag")


def test_options_of_bags_are_refused_for_other_logs(tmp_path):
    (tmp_path / "a.log").write_text("FLASER 1 2\n")
    with pytest.raises(InputError, match="--scan-topic means nothing here"):
        open_log(tmp_path / "a.log", ReadOptions(scan_topics=("/scan",)))


def test_stamps_are_those_sent(tmp_path):
    bag = BagMaker("bag")
    for i in range(3):
        bag.add("/scan", bag.make.scan(START + 0.123456 + i, ranges_of(i)), i)
    scan = next(iter(open_log(bag.write(tmp_path))))
    assert scan.stamp == (START * NANO + 123_456_000) / NANO
