# SPDX-License-Identifier: Apache-2.0
"""What a recorder that died, a full disk or a bad cable leaves is read as far as it goes."""

import contextlib
import sqlite3
import struct

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from rosbags.rosbag1 import Reader as Reader1

from cartoloop.errors import InputError
from cartoloop.readers import open_log
from cartoloop.readers.ros.salvage_bag import BagSalvage
from cartoloop.readers.ros.salvage_ros2 import DatabaseSalvage, McapSalvage
from cartoloop.sensor.events import LaserScan
from tests.readers.ros.bag_files import FORMATS, BagMaker, drive

KINDS = [("bag", None), ("bag", "LZ4"), ("bag", "BZ2"), ("db3", None), ("mcap", None)]
KINDS += [("mcap", "STORAGE")]


class Contents(dict):
    """Whole recordings, which nobody wants to see in a message."""

    def __repr__(self):
        return f"the bytes of {len(self)} recordings"


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """The bytes of a drive in each format."""
    made = Contents()
    for form, compression in KINDS:
        folder = tmp_path_factory.mktemp(form)
        path = drive(form).write(folder, compression=compression)
        file = path if form == "bag" else next(path.glob(f"*.{form}"))
        made[form, compression] = file.read_bytes()
    return made


def num_scans(log):
    return sum(isinstance(event, LaserScan) for event in log)


def open_log_of(files, folder):
    path = folder / "whole.db3"
    path.write_bytes(files["db3", None])
    return open_log(path)


def severities(log):
    return {problem.severity for problem in log.problems}


def unindexed(bag):
    """Return a ROS 1 bag as its recorder leaves it when killed: without index."""
    place = bag.index(b"index_pos=") + len(b"index_pos=")
    (index,) = struct.unpack_from("<Q", bag, place)
    return bag[:place] + bytes(8) + bag[place + 8 : index]


@pytest.mark.parametrize("compression", [None, "LZ4", "BZ2"])
def test_a_bag_without_index_is_read_whole(files, compression, tmp_path):
    path = tmp_path / "drive.bag.active"
    path.write_bytes(unindexed(files["bag", compression]))
    log = open_log(path)
    assert num_scans(log) == 30
    assert "rosbag reindex" in log.problems[0].message
    assert severities(log) == {"warning"}


# Of bzip2 only whole blocks of 900 kB can be unpacked.
@pytest.mark.parametrize(("form", "compression"), [k for k in KINDS if k[1] != "BZ2"])
def test_a_recording_cut_off_is_used_as_far_as_it_goes(files, form, compression, tmp_path):
    data = files[form, compression]
    path = tmp_path / f"drive.{form}"
    path.write_bytes(data[: int(0.6 * len(data))])
    log = open_log(path)
    assert 3 < num_scans(log) <= 30
    assert "error" in severities(log)
    assert "the part before is used" in log.problems[0].message


@pytest.mark.parametrize(("form", "compression"), KINDS)
@settings(
    deadline=None, max_examples=25, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(
    cut=st.one_of(st.just(1.0), st.floats(0.0, 1.0)),
    flips=st.lists(st.tuples(st.floats(0.0, 1.0), st.integers(1, 255)), max_size=4),
)
def test_no_damage_gives_more_than_a_line(files, form, compression, tmp_path, cut, flips):
    raw = bytearray(files[form, compression])
    raw = raw[: int(cut * len(raw))]
    for place, bits in flips if raw else ():
        raw[int(place * (len(raw) - 1))] ^= bits
    path = tmp_path / f"damaged.{form}"
    path.write_bytes(raw)
    try:
        log = open_log(path)
        with contextlib.suppress(InputError):
            list(log)
        assert all("\n" not in problem.message for problem in log.problems)
    except InputError as error:
        assert "\n" not in str(error)


@pytest.mark.parametrize("form", FORMATS)
def test_readers_from_the_front_agree_with_the_library(files, form, tmp_path):
    path = tmp_path / f"drive.{form}"
    path.write_bytes(files[form, None])
    salvage = {"bag": BagSalvage, "mcap": McapSalvage, "db3": DatabaseSalvage}[form](path)
    assert salvage.damage == ""
    topics = {c.topic: c.num_messages for c in salvage.channels}
    assert topics == {"/tf_static": 1, "/scan": 30, "/odom": 60, "/imu": 150}
    if form == "bag":
        topic = {c.key: c.topic for c in salvage.channels}
        ours = [(topic[k], t, raw) for k, t, raw in salvage.messages(topic)]
        with Reader1(path) as reader:
            theirs = [(c.topic, t, bytes(raw)) for c, t, raw in reader.messages()]
        assert sorted(ours) == sorted(theirs)
        assert [t for _, t, _ in ours] == [t for _, t, _ in theirs]


def test_an_mcap_file_of_another_program_is_read(files, tmp_path):
    data = files["mcap", None]
    profile = struct.pack("<I", 4) + b"ros2"
    assert data.count(profile) == 1
    path = tmp_path / "drive.mcap"
    path.write_bytes(data.replace(profile, struct.pack("<I", 4) + b"none"))
    log = open_log(path)
    assert num_scans(log) == 30
    assert log.problems == []


def test_messages_beside_a_database_are_reported(files, tmp_path):
    path = tmp_path / "drive.db3"
    path.write_bytes(files["db3", None])
    (tmp_path / "drive.db3-wal").write_bytes(b"something")
    log = open_log(path)
    assert num_scans(log) == 30
    assert "drive.db3-wal, which is not read" in log.problems[0].message


def test_a_folder_that_lacks_a_file_says_so(tmp_path):
    folder = drive("mcap").write(tmp_path)
    next(folder.glob("*.mcap")).unlink()
    with pytest.raises(InputError, match=r"are missing.*copy the whole folder again"):
        open_log(folder)


def test_folders_and_files_without_a_recording_are_refused(tmp_path):
    with pytest.raises(InputError, match="is a folder without a recording"):
        open_log(tmp_path)
    drive("bag").write(tmp_path)
    with pytest.raises(InputError, match="is a folder of bags"):
        open_log(tmp_path)
    for name, content, what in [
        ("empty.bag", b"", "is empty"),
        ("text.mcap", b"hello", "is no .mcap recording by its content"),
        ("old.bag", b"#ROSBAG V1.2\n", "rosbag migrate"),
        ("broken.db3.zstd", b"\x28\xb5\x2f\xfdrubbish", "cannot be unpacked"),
    ]:
        (tmp_path / name).write_bytes(content)
        with pytest.raises(InputError, match=what):
            open_log(tmp_path / name)


@pytest.mark.parametrize("name", [None, b"\xff", 7])
def test_a_topic_whose_name_is_no_text_costs_nothing_else(files, tmp_path, name):
    path = tmp_path / "drive.db3"
    path.write_bytes(files["db3", None])
    with contextlib.closing(sqlite3.connect(path)) as database, database:
        database.execute("CREATE TABLE old AS SELECT * FROM topics")
        database.execute("DROP TABLE topics")
        database.execute("CREATE TABLE topics AS SELECT * FROM old")  # whatever it may hold
        columns = [row[1] for row in database.execute("PRAGMA table_info(topics)")]
        values = {
            "id": 99,
            "name": name,
            "type": "std_msgs/msg/Bool",
            "serialization_format": "cdr",
        }
        database.execute(
            f"INSERT INTO topics VALUES ({','.join('?' * len(columns))})",
            [values.get(column, "") for column in columns],
        )
    log = open_log(path)
    assert log.inventory.topics
    assert num_scans(log) == num_scans(open_log_of(files, tmp_path))


def test_a_database_that_is_no_recording_is_refused(tmp_path):
    path = tmp_path / "other.db3"
    with sqlite3.connect(path) as connection:
        connection.execute("CREATE TABLE t (a INTEGER)")
    connection.close()
    with pytest.raises(InputError, match="holds no messages"):
        open_log(path)


def test_a_bag_whose_scans_all_are_broken_says_why(tmp_path):
    bag = BagMaker("bag")
    for i in range(4):
        bag.add_raw("/scan", "sensor_msgs/msg/LaserScan", bytes(20), 0.1 * i)
    with pytest.raises(InputError, match=r"no scan of /scan can be used \(cut off\)"):
        open_log(bag.write(tmp_path))
