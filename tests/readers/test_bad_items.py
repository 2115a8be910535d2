# SPDX-License-Identifier: Apache-2.0
"""One bad line, row or message costs itself alone, and is counted."""

from __future__ import annotations

import sqlite3
from contextlib import closing

import numpy as np
import pytest

import cartoloop
from cartoloop.readers import LineLog, ReadOptions
from cartoloop.readers.carmen import CARMEN
from cartoloop.readers.log import ProblemLog
from cartoloop.readers.ros.container import Channel
from cartoloop.readers.ros.index import index_recording
from cartoloop.readers.ros.merging import MergedMessages
from cartoloop.readers.ros.stream_times import StreamTimes
from cartoloop.sensor.events import LaserScan
from cartoloop.sensor.time_repair import TimeReport
from tests.readers.ros.bag_files import drive

NUM_SCANS = 30


def flaser(stamp, count="3", tail=""):
    return f"FLASER {count} 1.0 2.0 3.0 0 0 0 0 0 0 {stamp} host {stamp}{tail}"


def log_of(tmp_path, *bad):
    """A log of good lines with bad ones in the middle."""
    lines = [flaser(f"{100 + 0.2 * i:.1f}") for i in range(NUM_SCANS)]
    lines[NUM_SCANS // 2 : NUM_SCANS // 2] = bad
    path = tmp_path / "some.log"
    path.write_text("\n".join(lines) + "\n")
    return cartoloop.open_log(path)


def num_scans(log):
    return sum(isinstance(event, LaserScan) for event in log)


@pytest.mark.parametrize(
    "line",
    [
        flaser("103.0", count="9" * 5000),
        f"ROBOTLASER1 0 0 1 1 9 0 0 3 1 2 3 {'9' * 5000} 1 2 0 0 0 0 0 0 0 0 0 0 1 host 1",
        f"RAWLASER1 0 0 1 1 9 0 0 {'1' * 5000} 1 2 3 1.0 host 1.0",
    ],
)
def test_a_count_of_thousands_of_digits_costs_one_line(tmp_path, line):
    log = log_of(tmp_path, line)

    assert num_scans(log) == NUM_SCANS
    assert sum(log.skipped.values()) == log.num_lost_scans == 1
    assert all(len(problem.message) < 300 for problem in log.problems)


def test_a_dpslam_count_of_thousands_of_digits_costs_one_line(tmp_path):
    path = tmp_path / "some.log"
    good = "Odometry 0 0 0\nLaser 3 1 2 3\n"
    path.write_text(f"{good}Laser {'9' * 5000} 1 2 3\n{good}")

    log = cartoloop.open_log(path)

    assert num_scans(log) == 2
    assert log.num_lost_scans == 1


def test_a_line_that_the_reader_fails_at_costs_itself(tmp_path):
    path = tmp_path / "some.log"
    path.write_text("\n".join(flaser(f"{i}.0") for i in range(9)))

    def parser(head):
        parse = CARMEN.parser(head)

        def parse_or_fail(line):
            if b" 4.0 " in line:
                raise KeyError("four")
            return parse(line)

        return parse_or_fail

    log = LineLog(path, CARMEN.__class__("own log", CARMEN.recognise, None, parser))

    assert num_scans(log) == 8
    assert log.skipped == {"line that the reader fails at": 1}
    assert log.problems[-1].message.startswith("some.log:5: the reader fails at this line (KeyErr")


@pytest.mark.parametrize("stamp", ["1e300", "-1e300", "1.7e308", "1e12"])
def test_stamps_out_of_all_bounds_are_repaired(tmp_path, stamp):
    log = log_of(tmp_path, flaser(stamp), f"ODOM 0 0 0 0 0 0 {stamp} host {stamp}")

    scans = [event for event in log if isinstance(event, LaserScan)]

    assert len(scans) == NUM_SCANS + 1
    assert max(abs(scan.stamp) for scan in scans) < 110.0
    assert np.diff([scan.time for scan in scans]).min() > 0.0
    assert 5.0 < log.duration < 7.0


def test_a_bad_odometry_line_is_no_lost_scan(tmp_path):
    log = log_of(tmp_path, "ODOM x 0 0 0 0 0 1.0 host 1.0", flaser("103.0", count="4"))
    num_scans(log)

    assert sum(log.skipped.values()) == 2
    assert log.num_lost_scans == 1


@pytest.fixture
def database(tmp_path):
    """A function that changes a row of a recording of ROS 2 and returns the file."""

    def changed(column, value, *, row):
        file = next(drive("db3").write(tmp_path).glob("*.db3"))
        with closing(sqlite3.connect(file)) as connection:
            connection.executescript(
                "CREATE TABLE loose AS SELECT * FROM messages; DROP TABLE messages;"
                "ALTER TABLE loose RENAME TO messages;"
            )
            rows = connection.execute(
                "SELECT messages.rowid FROM messages JOIN topics ON topics.id = topic_id "
                "WHERE name = '/scan'"
            ).fetchall()
            connection.execute(
                f"UPDATE messages SET {column} = ? WHERE rowid = ?", (value, rows[row][0])
            )
            connection.commit()
        return file

    return changed


@pytest.mark.parametrize("value", [None, "text", 5, 1.5, b""])
def test_a_row_without_a_message_costs_one_scan(database, value):
    log = cartoloop.open_log(database("data", value, row=7))

    assert num_scans(log) == NUM_SCANS - 1
    assert sum(log.skipped.values()) == log.num_lost_scans == 1


@pytest.mark.parametrize("value", [None, "text", 2**62, -(2**63)])
def test_a_row_without_a_time_costs_at_most_one_scan(database, value):
    log = cartoloop.open_log(database("timestamp", value, row=7))

    assert num_scans(log) >= NUM_SCANS - 1


class Container:
    """A recording of one topic; a damaged file makes the library yield messages of others, too."""

    kind, damage, needs = "bag", "", None
    channels = (Channel(0, "/scan", "sensor_msgs/msg/LaserScan", True, 2),)

    def __init__(self, *keys):
        self.notes, self.keys = [], keys

    def messages(self, keys):
        return ((key, time, b"") for time, key in enumerate(self.keys))


def test_messages_of_a_topic_that_is_not_used_are_left_out():
    streams = index_recording(Container(0, 0), ReadOptions()).streams
    times = [StreamTimes(np.array([1.0, 3.0]), np.array([1.0, 3.0]), TimeReport(2))]

    merged = MergedMessages(Container(0, 1, 0, 0), streams, times).in_order(ProblemLog())

    assert [time for _, (_, _, time) in merged] == [1.0, 3.0]


def test_a_recording_whose_messages_have_no_time_lasts_nothing(tmp_path, monkeypatch):
    log = cartoloop.open_log(drive().write(tmp_path))
    monkeypatch.setattr(log, "_times", [StreamTimes(np.zeros(0), np.zeros(0), TimeReport(0))])
    assert log.duration == 0.0

    text = log_of(tmp_path)
    monkeypatch.setattr(text, "_times", np.full(9, np.nan))
    assert text.duration == 0.0
