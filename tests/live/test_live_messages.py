# SPDX-License-Identifier: Apache-2.0
"""Messages become what was sent, and nonsense a reason, never anything else."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cartoloop.live.messages import EndMessage, MessageError, parse_message
from cartoloop.live.notices import Notices
from cartoloop.live.source import LineReceiver
from cartoloop.sensor.events import LaserScan, Odometry, PointCloud
from cartoloop.sensor.pose import Pose

SCAN = {"type": "scan", "stamp": 2.5, "angle_min": -1.0, "angle_increment": 0.5, "ranges": [1, 2.5]}


def parse(**content):
    return parse_message(json.dumps(content))


def test_a_scan():
    scan = parse(**SCAN, sensor="rear", range_min=0.1, range_max=30, pose=[0.1, 0.2, 3.0])

    assert isinstance(scan, LaserScan)
    assert scan.stamp == 2.5
    assert scan.ranges.tolist() == [1.0, 2.5]
    geometry = scan.geometry
    assert (geometry.angle_min, geometry.angle_increment, geometry.num_beams) == (-1.0, 0.5, 2)
    assert (geometry.range_min, geometry.range_max, geometry.sensor) == (0.1, 30.0, "rear")
    assert geometry.tf_tracking_sensor == Pose(0.1, 0.2, 3.0)
    assert not geometry.no_return_is_free


def test_beams_without_a_return():
    line = json.dumps(SCAN | {"ranges": [None, 0]}).replace("0]", "1e999]")

    ranges = parse_message(line).ranges

    assert np.isnan(ranges[0])
    assert ranges[1] == math.inf


def test_a_tilted_scanner():
    geometry = parse(**SCAN, pose=[0.1, 0.2, 0.3, 0.4, 0.5, 0.6]).geometry

    assert geometry.tf_tracking_sensor == Pose(0.1, 0.2, 0.6)
    assert (geometry.height, geometry.roll, geometry.pitch) == (0.3, 0.4, 0.5)


def test_other_messages():
    odometry = parse(type="odometry", x=1, y=2, theta=7.0)
    imu = parse(type="imu", stamp=1, linear_acceleration=[0, 0, 9.8], angular_velocity=[0, 0, 1])
    cloud = parse(type="cloud", points=[[1, 2, 3], [4, 5, 6]], times=[0, 0.1])

    assert isinstance(odometry, Odometry)
    assert math.isnan(odometry.stamp)
    assert odometry.tf_odom_tracking == Pose(1.0, 2.0, pytest.approx(7.0 - 2 * math.pi))
    assert (imu.stamp, imu.linear_acceleration) == (1.0, (0.0, 0.0, 9.8))
    assert imu.angular_velocity == (0.0, 0.0, 1.0)
    assert math.isnan(imu.time)
    assert isinstance(cloud, PointCloud)
    assert cloud.points.shape == (2, 3)
    assert cloud.times.tolist() == [0.0, 0.1]
    assert isinstance(parse(type="end"), EndMessage)


@pytest.mark.parametrize(
    ("line", "reported"),
    [
        (b"GET / HTTP/1.1\r", "is no JSON: 'GET / HTTP/1.1"),
        (b"[1, 2]", "is no JSON object"),
        (b'{"type": "scna"}', "'scna'; known are cloud, end, imu, odometry, scan"),
        (b'{"type": ["scan"]}', "known are"),
        (json.dumps(SCAN | {"ranges": []}), '"ranges" is empty'),
        (json.dumps(SCAN | {"ranges": "1 2"}), '"ranges" is not a list'),
        (json.dumps(SCAN | {"ranges": [1, "a"]}), '"ranges" are not all numbers'),
        (json.dumps(SCAN | {"ranges": [[1], [2]]}), '"ranges" is a list of lists'),
        (json.dumps(SCAN | {"angle_increment": 0}), '"angle_increment" is 0'),
        (json.dumps(SCAN | {"angle_min": True}), '"angle_min" is not a number'),
        (json.dumps(SCAN | {"angle_min": -135}), "angle_min is -135, which is more than two turns"),
        (json.dumps(SCAN | {"angle_increment": 90}), "give radians, not degrees"),
        (json.dumps(SCAN | {"pose": [0, 0, 180]}), "give radians, not degrees"),
        (json.dumps(SCAN | {"range_min": 3, "range_max": 2}), '"range_max" is not more than'),
        (json.dumps(SCAN | {"pose": [1, 2]}), '"pose" is not x, y, yaw'),
        (json.dumps(SCAN | {"sensor": 7}), '"sensor" is not a short text'),
        (b'{"type": "odometry", "x": 1, "y": 2}', '"theta" is missing'),
        (b'{"type": "odometry", "x": 1e400, "y": 2, "theta": 0}', '"x" is inf'),
        (b'{"type": "odometry", "x": ' + b"9" * 400 + b', "y": 2, "theta": 0}', '"x" is'),
        (b'{"type": "imu", "linear_acceleration": [1, 2], "angular_velocity": [1]}', "three"),
        (b'{"type": "cloud", "points": [[1, 2]]}', "three numbers each"),
        (b'{"type": "cloud", "points": [[1, 2, 3]], "times": [1, 2]}', "as many as the points"),
        (b"[" * 100_000, "is no JSON"),
    ],
)
def test_invalid_messages_are_refused_with_the_reason(line, reported):
    with pytest.raises(MessageError) as error:
        parse_message(line)

    assert reported in str(error.value)


@given(
    st.recursive(
        st.none() | st.booleans() | st.floats() | st.text(max_size=5),
        lambda inner: (
            st.lists(inner, max_size=3)
            | st.dictionaries(st.sampled_from([*SCAN, "points", "times", "x"]), inner, max_size=4)
        ),
    ),
    st.sampled_from(["scan", "cloud", "odometry", "imu"]),
)
def test_no_content_breaks_the_parser(content, kind):
    if isinstance(content, dict):
        content = SCAN | content | {"type": kind}
    try:
        parse_message(json.dumps(content))
    except MessageError as error:
        assert error.reason


@given(st.lists(st.integers(0, 60), max_size=20))
def test_lines_come_whole_however_the_bytes_are_cut(cuts):
    text = b'{"type":"odometry","x":1,"y":2,"theta":0}\n\nno\r\n{"type":"end"}\n{"type":"en'
    received, reported = [], []
    lines = LineReceiver(received.append, Notices(reported.append), "there")
    start = 0
    for cut in [*sorted(cuts), len(text)]:
        lines.feed(text[start:cut])
        start = max(start, cut)
    lines.end()

    assert [type(message).__name__ for message in received] == ["Odometry", "EndMessage"]
    assert reported[0] == "there: message 3 skipped: is no JSON: 'no\\r'"


def test_a_line_without_end_does_not_fill_the_memory(monkeypatch):
    monkeypatch.setattr("cartoloop.live.source.MAX_LINE_BYTES", 1000)
    received, reported = [], []
    lines = LineReceiver(received.append, Notices(reported.append), "there")

    for _ in range(100):
        lines.feed(b"x" * 100)
    lines.feed(b'\n{"type": "end"}\n')

    assert len(received) == 1
    assert reported == ["there: message 1 skipped: is longer than 0 MB"]
