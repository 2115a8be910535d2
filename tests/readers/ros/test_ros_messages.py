# SPDX-License-Identifier: Apache-2.0
"""The quick decoders agree with those of rosbags, on ROS 1 and on CDR of both byte orders."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cartoloop.readers.ros import raw_messages as ros
from cartoloop.readers.ros.wire import DecodeError, frame_name, read_header
from tests.readers.ros.bag_files import START, Messages

WIRES = [("ros1", True, False), ("cdr", False, False), ("cdr of a big-endian robot", False, True)]
wires = pytest.mark.parametrize(("ros1", "big"), [w[1:] for w in WIRES], ids=[w[0] for w in WIRES])


def read_by_library(make, raw, msgtype):
    store = make.store
    return (store.deserialize_ros1 if make.ros1 else store.deserialize_cdr)(raw, msgtype)


@wires
@given(
    frame=st.text("abc/_", max_size=9),
    ranges=st.lists(st.floats(width=32, allow_nan=True), max_size=40),
    time=st.integers(0, 10**9),
)
def test_scans_equal_those_of_the_library(ros1, big, frame, ranges, time):
    make = Messages(ros1)
    raw = make.encode(make.scan(START + time * 1e-9, ranges, frame, range_max=12.5), big)
    truth = read_by_library(make, raw, ros.LASER_SCAN)
    scan = ros.decode_scan(raw, ros1)
    np.testing.assert_array_equal(scan.ranges, truth.ranges.astype(np.float64))
    assert scan.ranges.dtype == np.float64
    assert scan.header.stamp == truth.header.stamp.sec * 10**9 + truth.header.stamp.nanosec
    assert scan.header.frame.decode() == frame
    assert scan.beam_numbers == (
        truth.angle_min,
        truth.angle_max,
        truth.angle_increment,
        truth.time_increment,
        truth.scan_time,
        truth.range_min,
        truth.range_max,
    )


@wires
@given(frame=st.text("abc", max_size=9), child=st.text("de/", max_size=9))
def test_other_messages_equal_those_of_the_library(ros1, big, frame, child):
    make = Messages(ros1)
    raw = make.encode(make.imu(START + 0.25, (1.0, 2.0, 3.0), (4.0, 5.0, 6.0), frame), big)
    imu = ros.decode_imu(raw, ros1)
    assert imu.header.frame.decode() == frame
    assert imu.linear_acceleration == (1.0, 2.0, 3.0)
    assert imu.angular_velocity == (4.0, 5.0, 6.0)

    raw = make.encode(make.odometry(START + 0.5, (1.0, 2.0, 0.3), child, frame), big)
    truth = read_by_library(make, raw, ros.ODOMETRY).pose.pose
    odometry = ros.decode_odometry(raw, ros1)
    assert odometry.child == child.lstrip("/")
    q = truth.orientation
    assert odometry.values == (1.0, 2.0, 0.0, q.x, q.y, q.z, q.w)

    poses = [(frame, child, (1.0, 2.0, 3.0), (0.1, 0.2, 0.3)), (child, "x", (0, 0, 0), (0, 0, 1))]
    raw = make.encode(make.transforms(START + 0.75, *poses), big)
    truths = read_by_library(make, raw, ros.TF_TYPES[0]).transforms
    sent = ros.decode_transforms(raw, ros1)
    assert [(t.parent, t.child) for t in sent] == [
        (t.header.frame_id.lstrip("/"), t.child_frame_id.lstrip("/")) for t in truths
    ]
    assert [t.values[6] for t in sent] == [t.transform.rotation.w for t in truths]
    assert {t.stamp for t in sent} == {(START * 4 + 3) * 10**9 // 4}


@wires
@given(
    rows=st.lists(
        st.lists(st.tuples(st.floats(0, 30, width=32), st.floats(0, 9, width=32)), max_size=3),
        min_size=2,
        max_size=12,
    )
)
def test_the_echo_wanted_is_taken_of_each_beam(ros1, big, rows):
    make = Messages(ros1)
    echoes = [[r for r, _ in row] for row in rows]
    strengths = [[s for _, s in row] for row in rows]
    raw = make.encode(make.multi_echo(START, echoes, strengths), big)
    first = [row[0] if row else np.inf for row in echoes]
    strongest = [
        e[int(np.argmax(s))] if e else np.inf for e, s in zip(echoes, strengths, strict=True)
    ]
    np.testing.assert_array_equal(ros.decode_multi_echo(raw, ros1).ranges, first)
    found = ros.decode_multi_echo(raw, ros1, "strongest").ranges
    np.testing.assert_array_equal(found, strongest)


def test_without_intensities_the_first_echo_is_the_strongest():
    make = Messages(False)
    raw = make.encode(make.multi_echo(START, [[1.0, 2.0], [3.0]], []))
    np.testing.assert_array_equal(ros.decode_multi_echo(raw, False, "strongest").ranges, [1.0, 3.0])


def test_a_quantity_that_an_imu_does_not_measure_is_none():
    make = Messages(True)
    raw = make.encode(make.imu(START, (0, 0, 9.8), (0, 0, 1), covariances=(-1.0, 0.0)))
    assert ros.decode_imu(raw, True).angular_velocity is None
    assert ros.decode_imu(raw, True).linear_acceleration == (0, 0, 9.8)


@wires
@given(data=st.data())
def test_messages_cut_off_anywhere_are_refused(ros1, big, data):
    make = Messages(ros1)
    cases = [
        (ros.decode_scan, make.scan(START, [1.0, 2.0, 3.0], intensities=np.zeros(0, np.float32))),
        (ros.decode_multi_echo, make.multi_echo(START, [[1.0], [2.0, 3.0]], [])),
        (ros.decode_imu, make.imu(START, (0, 0, 9), (0, 0, 1))),
        (ros.decode_transforms, make.transforms(START, ("a", "b", (0, 0, 0), (0, 0, 0)))),
    ]
    decode, message = data.draw(st.sampled_from(cases))
    raw = make.encode(message, big)
    end = data.draw(st.integers(0, len(raw) - 13))  # an empty list of intensities is 4 to 8 bytes
    with pytest.raises(DecodeError):
        decode(raw[:end], ros1)


@given(raw=st.binary(max_size=200), ros1=st.booleans())
def test_any_bytes_are_decoded_or_refused(raw, ros1):
    for decode in (
        ros.decode_scan,
        ros.decode_multi_echo,
        ros.decode_imu,
        ros.decode_odometry,
        ros.decode_transforms,
        ros.decode_string,
    ):
        try:
            decode(raw, ros1)
        except DecodeError as error:
            assert str(error)


def test_an_encoding_that_is_not_cdr_is_refused():
    with pytest.raises(DecodeError, match="CDR"):
        read_header(b"\x00\x03" + bytes(60), False)


def test_frames_lose_the_slash_of_old():
    assert frame_name(b"/base_link") == "base_link"
