# SPDX-License-Identifier: Apache-2.0
import gzip
import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import cartoloop
from cartoloop.errors import InputError
from cartoloop.readers import open_log, open_logs, read
from cartoloop.sensor.events import LaserScan, Odometry
from cartoloop.sensor.pose import Pose, compose

finite = st.floats(-1e6, 1e6, allow_nan=False)
any_range = st.floats(width=64)


def flaser(ranges, odom=(0.0, 0.0, 0.0), stamp=0.0, corrected=None, tag="FLASER"):
    words = [tag, str(len(ranges)), *map(repr, ranges)]
    words += [*map(repr, corrected or odom), *map(repr, odom)]
    return " ".join([*words, repr(stamp), "host", "0.0"])


def robotlaser(ranges, laser, robot, stamp=None, *, remissions=None, turn_axis=True, header=None):
    header = header or "0 -1.570796 3.141593 0.017453 81.92 0.01 0"
    words = ["ROBOTLASER1", header, str(len(ranges)), *map(repr, ranges)]
    if remissions is not None:
        words += [str(len(remissions)), *map(repr, remissions)]
    words += [*map(repr, laser), *map(repr, robot), "0.1", "0.2", "0.3", "0.4"]
    words += ["1.5"] if turn_axis else []
    words += [] if stamp is None else [repr(stamp), "nohost", "0.0"]
    return " ".join(words)


@pytest.fixture
def log_of(tmp_path):
    def write(*lines, name="run.clf"):
        path = tmp_path / name
        path.write_text("\n".join(lines) + "\n")
        return open_log(path)

    return write


def scans_of(log):
    return [event for event in log if isinstance(event, LaserScan)]


def odometry_of(log):
    return [event for event in log if isinstance(event, Odometry)]


@settings(deadline=None, max_examples=60)
@given(
    ranges=st.lists(any_range, min_size=1, max_size=12),
    odom=st.tuples(finite, finite, finite),
    corrected=st.tuples(finite, finite, finite),
    stamp=st.floats(0.0, 2e9),
)
def test_a_written_line_is_read_back(tmp_path_factory, ranges, odom, corrected, stamp):
    path = tmp_path_factory.mktemp("log") / "one.clf"
    path.write_text(flaser(ranges, odom, stamp, corrected) + "\n")
    odometry, scan = read(path)
    assert odometry == Odometry(stamp, stamp, Pose(*odom))
    assert np.array_equal(scan.ranges, ranges, equal_nan=True)
    assert (scan.stamp, scan.time) == (stamp, stamp)
    assert scan.geometry.num_beams == len(ranges)


@settings(deadline=None, max_examples=60)
@given(
    ranges=st.lists(st.floats(0.1, 80.0), min_size=1, max_size=8),
    remissions=st.none() | st.lists(st.floats(0.0, 99.0), max_size=6),
    turn_axis=st.booleans(),
    stamp=st.none() | st.floats(0.0, 2e9),
    robot=st.tuples(
        st.floats(-99.0, 99.0).filter(lambda x: abs(x) > 0.5), st.floats(-99.0, 99.0), finite
    ),
)
def test_optional_parts_of_a_robotlaser_line_are_recognised(
    tmp_path_factory, ranges, remissions, turn_axis, stamp, robot
):
    laser = compose(Pose(*robot), Pose(0.25, -0.05, 0.1))
    path = tmp_path_factory.mktemp("log") / "one.clf"
    line = robotlaser(ranges, laser, robot, stamp, remissions=remissions, turn_axis=turn_axis)
    path.write_text(line + "\n")
    odometry, scan = read(path)
    assert odometry.tf_odom_tracking == Pose(*robot)
    assert scan.ranges.tolist() == ranges
    assert scan.stamp == (stamp or 0.0)
    assert scan.geometry.tf_tracking_sensor == pytest.approx((0.25, -0.05, 0.1), abs=1e-6)


def test_an_empty_remission_block_is_no_coordinate(
    tmp_path,
):
    robot = Pose(1.0, 0.0, 0.0)
    laser = compose(robot, Pose(0.25, -0.05, 0.1))
    path = tmp_path / "one.clf"
    path.write_text(robotlaser([1.0], laser, robot, None, remissions=[], turn_axis=False) + "\n")
    odometry, _ = read(path)
    assert odometry.tf_odom_tracking == robot


def test_simple_door_is_public():
    assert cartoloop.read is read


@pytest.mark.parametrize(
    ("beams", "step_deg", "last_deg"),
    [(180, 1.0, 89.0), (181, 1.0, 90.0), (360, 0.5, 89.5), (361, 0.5, 90.0)],
)
def test_flaser_angles_follow_the_custom(log_of, beams, step_deg, last_deg):
    (scan,) = scans_of(log_of(flaser([1.0] * beams)))
    assert scan.geometry.angle_increment == pytest.approx(math.radians(step_deg))
    assert np.degrees(scan.geometry.angles[[0, -1]]) == pytest.approx([-90.0, last_deg])


def test_an_unusual_number_of_flaser_beams_is_pointed_out(log_of):
    log = log_of(flaser([1.0] * 90))
    assert [p.severity for p in log.problems] == ["note"]
    assert "90 beams are taken to span 180 degrees" in log.problems[0].message


def test_the_odometry_pose_is_used_and_the_corrected_one_never(log_of):
    log = log_of(flaser([1.0] * 180, odom=(1.0, 2.0, 0.5), corrected=(7.0, 8.0, -0.5)))
    assert [event.tf_odom_tracking for event in odometry_of(log)] == [Pose(1.0, 2.0, 0.5)]


def test_file_order_is_kept_and_each_scan_follows_its_odometry(log_of):
    log = log_of(
        "# a comment",
        "ODOM 0 0 0 0 0 0 1.0 host 0",
        flaser([1.0] * 180, (0.1, 0.0, 0.0), 1.1),
        "ODOM 0.2 0 0 0 0 0 1.2 host 0",
        flaser([2.0] * 180, (0.3, 0.0, 0.0), 1.3),
    )
    assert [(type(e).__name__, e.time) for e in log] == [
        ("Odometry", 1.0),
        ("Odometry", 1.1),
        ("LaserScan", 1.1),
        ("Odometry", 1.2),
        ("Odometry", 1.3),
        ("LaserScan", 1.3),
    ]
    assert log.duration == pytest.approx(0.3)
    assert log.num_scans == 2
    assert log.skipped == {}


def test_a_scan_line_that_repeats_odometry_adds_no_event(log_of):
    log = log_of(
        "ODOM 0.1 0 0 0 0 0 1.0 host 0",
        flaser([1.0] * 180, (0.1, 0.0, 0.0), 1.0),
        "ODOM 0.1 0 0 0 0 0 1.5 host 0",
        flaser([1.0] * 180, (0.1, 0.0, 0.1), 1.5),
    )
    assert [event.stamp for event in odometry_of(log)] == [1.0, 1.5, 1.5]


def test_copies_of_lines_are_skipped_and_counted(log_of):
    lines = []
    for i in range(6):
        stamp, x = 0.5 * i, 0.1 * i
        odom = f"ODOM {x} 0.0 0.0 0.0 0.0 0.0 {stamp} host {stamp}"
        lines += [odom, flaser([1.0 + x] * 181, (x, 0.0, 0.0), stamp)]
    once, twice = (
        log_of(*lines, name="once.clf"),
        log_of(*(line for i in range(0, 12, 2) for line in lines[i : i + 2] * 2), name="twice.clf"),
    )

    events, copied = list(once), list(twice)

    assert [type(event) for event in copied] == [type(event) for event in events]
    assert [event.time for event in copied] == [event.time for event in events]
    assert twice.num_scans == once.num_scans == 6
    assert twice.num_odometry == once.num_odometry
    assert twice.skipped == {"exact copy of a scan before": 6}
    assert once.skipped == {}


def test_a_second_pass_yields_and_counts_the_same(log_of):
    log = log_of(flaser([1.0] * 180, stamp=1.0), "SYNC tag 1.0 host 0", "FLASER 3 1 1")
    first, counted = [e.stamp for e in log], dict(log.skipped)
    assert [e.stamp for e in log] == first
    assert log.skipped == counted
    assert sum(counted.values()) == 2


def test_gzip_is_known_by_its_content_not_its_name(tmp_path):
    text = (flaser([1.0] * 180, stamp=1.0) + "\n").encode()
    packed, plain = tmp_path / "packed.log", tmp_path / "plain.log.gz"
    packed.write_bytes(gzip.compress(text))
    plain.write_bytes(text)
    assert [e.stamp for e in read(packed)] == [e.stamp for e in read(plain)] == [1.0, 1.0]


def test_several_gzip_members_and_padding_are_read_as_one(tmp_path):
    path = tmp_path / "joined.clf.gz"
    members = [gzip.compress((flaser([1.0] * 9, stamp=s) + "\n").encode()) for s in (1.0, 2.0)]
    path.write_bytes(b"".join(members) + b"\x00" * 32)
    log = open_log(path)
    assert [scan.stamp for scan in scans_of(log)] == [1.0, 2.0]
    assert not [p for p in log.problems if p.severity == "error"]


def test_dos_line_ends_are_no_trouble(tmp_path):
    path = tmp_path / "dos.clf"
    lines = [flaser([1.0] * 180, stamp=stamp) + "\r\n" for stamp in (1.0, 2.0)]
    path.write_bytes("".join(lines).encode())
    assert len(scans_of(open_log(path))) == 2


def test_param_lines_place_the_front_laser_wherever_they_stand(log_of):
    log = log_of(
        "PARAM robot_frontlaser_side_offset -0.05 nohost 0",
        "PARAM robot_frontlaser_use on nohost 0",
        flaser([1.0] * 180),
        "PARAM robot_frontlaser_offset 0.31 nohost 0",
    )
    assert scans_of(log)[0].geometry.tf_tracking_sensor == Pose(0.31, -0.05, 0.0)


def test_the_rear_laser_is_a_second_scanner_facing_back(log_of):
    log = log_of(
        "PARAM robot_rearlaser_offset -0.2",
        flaser([1.0] * 180, stamp=1.0),
        flaser([2.0] * 180, stamp=1.01, tag="RLASER"),
    )
    front, rear = scans_of(log)
    assert front.geometry.tf_tracking_sensor == Pose(0.0, 0.0, 0.0)
    assert rear.geometry.tf_tracking_sensor == Pose(-0.2, 0.0, math.pi)
    assert list(log.profiles) == ["FLASER", "RLASER"]
    assert log.num_scans == 2


def test_robotlaser_header_gives_angles_and_maximum_range(log_of):
    header = "0 -2.0 4.0 0.04 8.0 0.01 0"
    (scan,) = scans_of(log_of(robotlaser([1.0] * 101, (0, 0, 0), (0, 0, 0), 1.0, header=header)))
    assert scan.geometry.angles[[0, -1]] == pytest.approx([-2.0, 2.0])
    assert scan.geometry.range_max == 8.0


def test_robotlaser_without_a_step_fills_the_field_of_view(log_of):
    header = "0 -2.0 4.0 0.0 0 0.01 0"
    (scan,) = scans_of(log_of(robotlaser([1.0] * 101, (0, 0, 0), (0, 0, 0), 1.0, header=header)))
    assert scan.geometry.angle_increment == pytest.approx(0.04)
    assert scan.geometry.range_max == math.inf


def test_a_corrected_laser_pose_is_no_offset(log_of):
    offset = Pose(0.3, 0.0, 0.0)
    lines = []
    for k in range(20):
        robot = Pose(0.2 * k, 0.0, 0.0)
        corrected = compose(Pose(0.01 * k, 0.02 * k, 0.01 * k), compose(robot, offset))
        lines.append(robotlaser([1.0] * 180, corrected, robot, float(k)))
    log = log_of("PARAM robot_frontlaser_offset 0.3", *lines)
    assert scans_of(log)[0].geometry.tf_tracking_sensor == offset
    assert any("moves against the robot" in p.message for p in log.problems)


def test_raw_lines_are_used_only_without_lines_with_poses(log_of):
    raw = "RAWLASER1 0 -1.570796 3.141593 0.017453 81.9 0.01 0 3 1 2 3 2 9 9 1.0 host 0"
    (scan,) = scans_of(log_of("ODOM 1 0 0 0 0 0 1.0 host 0", raw, name="raw.clf"))
    assert scan.ranges.tolist() == [1.0, 2.0, 3.0]
    later = raw.replace("1.0 host", "2.0 host")
    both = log_of(raw, flaser([4.0] * 3, stamp=1.0), later)
    assert [s.ranges.tolist() for s in scans_of(both)] == [[4.0] * 3]
    assert both.skipped == {"RAWLASER1 (the same scanner as FLASER)": 2}


def test_unused_lines_are_counted_unknown_ones_reported(log_of):
    log = log_of(
        flaser([1.0] * 180, stamp=1.0),
        "SYNC a 1.0 host 0",
        "TRUEPOS 0 0 0 0 0 0 1.0 host 0",
        "TRUEPOS 0 0 0 0 0 0 1.0 host 0",
        "WARP 9",
    )
    list(log)
    assert log.skipped == {"SYNC (not used)": 1, "TRUEPOS (not used)": 2, "unknown line": 1}
    assert log.problems == [("warning", "run.clf:5: unknown line 'WARP'", "unknown line")]


def test_scans_with_equal_beams_share_one_geometry(log_of):
    log = log_of(*(flaser([1.0] * n, stamp=float(i)) for i, n in enumerate((180, 90, 180, 90))))
    a, b, c, d = (scan.geometry for scan in scans_of(log))
    assert (a is c, b is d) == (True, True)
    assert (a.num_beams, b.num_beams) == (180, 90)


def test_scans_carry_the_profile(log_of):
    still = [[2.0] * 90 + [81.91] * 90, [2.5] * 90 + [81.91] * 90, [3.0] * 90 + [81.91] * 90]
    log = log_of(*(flaser(ranges, stamp=float(i)) for i, ranges in enumerate(still)))
    assert log.profile.no_return == 81.91
    assert scans_of(log)[0].geometry.range_max == log.profile.range_max < 81.91
    assert log.profile.has_odometry
    assert log.profile.rate == pytest.approx(1.0)


def test_large_files_are_streamed_with_the_same_result(tmp_path, monkeypatch):
    path = tmp_path / "large.clf.gz"
    lines = [flaser([1.0 + i] * 20, (0.1 * i, 0, 0), float(i)) for i in range(50)]
    path.write_bytes(gzip.compress("\n".join(lines).encode()))
    kept = [(s.stamp, s.ranges[0]) for s in scans_of(open_log(path))]
    monkeypatch.setattr("cartoloop.readers.text_file._KEEP_BYTES", 100)
    monkeypatch.setattr("cartoloop.readers.text_file._CHUNK_BYTES", 64)
    log = open_log(path)
    assert [(s.stamp, s.ranges[0]) for s in scans_of(log)] == kept
    assert [(s.stamp, s.ranges[0]) for s in scans_of(log)] == kept


def test_logs_in_a_row_go_on_in_time_with_their_own_stamps(tmp_path):
    for name in ("a", "b"):
        lines = [flaser([1.0] * 180, stamp=0.2 * i) for i in range(5)]
        (tmp_path / name).write_text("\n".join([*lines, "SYNC x"]) + "\n")
    chain = open_logs([tmp_path / "a", tmp_path / "b"])
    scans = scans_of(chain)
    assert chain.num_scans == len(scans) == 10
    assert np.diff([scan.time for scan in scans]) == pytest.approx([0.2] * 9)
    assert scans[5].stamp == 0.0
    assert chain.skipped == {"SYNC (not used)": 2}
    assert chain.name == "a + b"
    assert scans[0].geometry == replace(scans[5].geometry)
    assert open_logs([tmp_path / "a"]).name == "a"
    (tmp_path / "link").symlink_to(tmp_path / "a")
    with pytest.raises(InputError, match="link: is given twice"):
        open_logs([tmp_path / "a", tmp_path / "b", tmp_path / "link"])
