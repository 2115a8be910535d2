# SPDX-License-Identifier: Apache-2.0
import gzip
import math
import zlib

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cartoloop.errors import InputError
from cartoloop.readers import open_log, read
from cartoloop.sensor.events import LaserScan, Odometry

PNG = b"\x89PNG\r\n\x1a\n\x00\x00\x00\rIHDR"


def flaser(value=1.0, stamp=0.0, beams=180, pose="0.5 0.25 0.125"):
    return f"FLASER {beams} {' '.join([str(value)] * beams)} {pose} {pose} {stamp} host 0.0"


GOOD = [flaser(1.0 + 0.1 * i, stamp=0.2 * i) for i in range(10)]
TEXT = ("\n".join(GOOD) + "\n").encode()


def write(path, *lines, newline=True):
    path.write_text("\n".join(lines) + ("\n" if newline else ""))
    return path


def scans_of(log):
    return [event for event in log if isinstance(event, LaserScan)]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "is empty"),
        (gzip.compress(b"", mtime=0), "is empty"),
        (PNG, "PNG picture"),
        (b"<!DOCTYPE html><html>no such page</html>", "web page"),
        (b"\n <html></html>", "web page"),
        (b"#ROSBAG V2.0\n", "holds no messages"),
        (b"PK\x03\x04\x00", "zip archive"),
        (b"BZh91AY", "bzip2"),
        (b"\x00\x01\x02\x03" * 99, "is binary"),
        ("ODOM 0 0 0 0 0 0 1.0 host 0\n".encode("utf-16"), "is text in UTF-16; save it as UTF-8"),
        (b"\xef\xbb\xbf", "is empty"),
        (gzip.compress(b"\x00tar" * 200, mtime=0), "is binary"),
        (gzip.compress(TEXT, mtime=0)[:9], "gzip stream is cut off, nothing can be read"),
        (b"\x1f\x8bnot gzip at all, really", "gzip stream is damaged"),
        (
            b"Dear diary,\ntoday I mapped nothing.\n",
            "is not in a known format; give one",
        ),
        (b"ODOM 0 0 0 0 0 0 1.0 host 0\n", "holds no laser scans"),
        (b"# only comments\n", "is not in a known format; give one"),
    ],
)
def test_a_file_that_is_no_log_is_refused_in_one_line(tmp_path, content, message):
    path = tmp_path / "given.clf"
    path.write_bytes(content)
    with pytest.raises(InputError, match=message) as caught:
        open_log(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("packed", [bytes, gzip.compress])
def test_a_byte_order_mark_is_no_part_of_the_first_line(tmp_path, packed):
    path = tmp_path / "saved by an editor.log"
    path.write_bytes(packed(b"\xef\xbb\xbf" + TEXT))
    log = open_log(path)
    assert len(scans_of(log)) == TEXT.count(b"FLASER")
    assert not log.problems


def test_missing_files_and_folders_have_their_own_messages(tmp_path):
    with pytest.raises(InputError, match="does not exist; check the path"):
        read(tmp_path / "nowhere.clf")
    with pytest.raises(InputError, match="is a folder"):
        read(tmp_path)


def test_a_truncated_gzip_is_used_as_far_as_it_goes(tmp_path):
    path = tmp_path / "cut.clf.gz"
    noise = np.random.default_rng(1).uniform(1.0, 9.0, (200, 60)).round(2)
    lines = [
        f"FLASER 60 {' '.join(map(str, row))} 0 0 0 0 0 0 {0.2 * i:.1f} host 0.0"
        for i, row in enumerate(noise)
    ]
    packed = gzip.compress("\n".join(lines).encode())
    path.write_bytes(packed[: len(packed) // 2])
    log = open_log(path)
    scans = scans_of(log)
    assert 80 < len(scans) < 120
    assert [s.ranges.tolist() for s in scans] == noise[: len(scans)].tolist()
    (problem,) = [p for p in log.problems if p.severity == "error"]
    line = int(problem.message.split(":")[1])
    assert problem.message.startswith("cut.clf.gz:")
    assert "gzip stream is cut off" in problem.message
    assert len(scans) in {line, line - 1}


def test_a_gzip_damaged_in_the_middle_is_used_up_to_there(tmp_path):
    path = tmp_path / "bad.clf.gz"
    stream = zlib.compressobj(9, wbits=31)
    head = stream.compress(TEXT) + stream.flush(zlib.Z_FULL_FLUSH)
    path.write_bytes(head + b"\xff" * 400)
    log = open_log(path)
    assert len(scans_of(log)) == 10
    assert any("gzip stream is damaged" in p.message for p in log.problems)


@settings(deadline=None, max_examples=40)
@given(length=st.integers(1, len(GOOD[5]) - 1))
def test_a_line_cut_anywhere_is_skipped_or_whole(tmp_path_factory, length):
    path = tmp_path_factory.mktemp("log") / "cut.clf"
    write(path, *GOOD[:5], GOOD[5][:length], newline=False)
    log = open_log(path)
    scans = scans_of(log)
    # Only the logger's own stamp, the last token, may be cut without loss.
    if GOOD[5][:length].count(" ") == GOOD[5].count(" ") and GOOD[5][length - 1] != " ":
        assert [scan.stamp for scan in scans] == pytest.approx([0.0, 0.2, 0.4, 0.6, 0.8, 1.0])
    else:
        assert [scan.stamp for scan in scans] == pytest.approx([0.0, 0.2, 0.4, 0.6, 0.8])
        assert sum(log.skipped.values()) == 1
        assert all(p.message.startswith("cut.clf:6: ") for p in log.problems)


def test_a_damaged_line_in_the_middle_costs_that_line_only(tmp_path):
    log = open_log(write(tmp_path / "run.clf", *GOOD[:3], GOOD[3][:300], *GOOD[4:]))
    assert len(scans_of(log)) == 9
    assert log.skipped == {"range count mismatch or line cut off": 1}
    assert log.problems[0].message.startswith("run.clf:4: 180 ranges are announced, the line ends")


@pytest.mark.parametrize("beams", [0, 3, 178, 179, 181, 182, 500])
def test_a_wrong_range_count_is_reported_with_its_line(tmp_path, beams):
    wrong = GOOD[1].replace("FLASER 180", f"FLASER {beams}")
    log = open_log(write(tmp_path / "run.clf", GOOD[0], wrong, GOOD[2]))
    assert [scan.stamp for scan in scans_of(log)] == [0.0, 0.4]
    assert sum(log.skipped.values()) == 1
    assert log.problems[0].message.startswith("run.clf:2: ")


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        (GOOD[1].replace(" 1.1 ", " 1.1x ", 1), "not a number"),
        (GOOD[1].replace(" 0.25 ", " zwei "), "not a number"),
        (GOOD[1].replace(" 0.2 host", " now host"), "not a number"),
        (GOOD[1].replace("FLASER 180", "FLASER -180"), "no range count"),
        ("FLASER", "no range count"),
        ("FLASER 0 0 0 0 0 0 0 1.0 host 0", "scan without ranges"),
        ("ODOM 1 2 3 0", "line cut off"),
        ("ODOM 1 2 drei 0 0 0 1.0 host 0", "not a number"),
        ("ODOM 1 2 inf 0 0 0 1.0 host 0", "pose not finite"),
        ("ROBOTLASER1 0 -1.57", "line cut off"),
        (
            "ROBOTLASER1 0 -90 180 1 30 0 0 3 1 1 1 0 0 0 0 0 0 0 0 0 0 0 1.0 host 0",
            "angles not in radians",
        ),
    ],
)
def test_a_bad_line_is_skipped_with_its_reason(tmp_path, line, reason):
    log = open_log(write(tmp_path / "run.clf", GOOD[0], line, GOOD[2]))
    assert [scan.stamp for scan in scans_of(log)] == [0.0, 0.4]
    assert log.skipped == {reason: 1}
    assert len(log.problems) == 1
    assert log.problems[0].severity == "warning"
    assert log.problems[0].message.startswith("run.clf:2: ")


@pytest.mark.parametrize("number", ["nan", "-inf"])
def test_a_scan_is_kept_without_its_odometry(tmp_path, number):
    line = GOOD[1].replace(" 0.25 ", f" {number} ")
    log = open_log(write(tmp_path / "run.clf", GOOD[0], line, GOOD[2]))
    assert [scan.stamp for scan in scans_of(log)] == [0.0, 0.2, 0.4]
    odometry = [event.stamp for event in log if isinstance(event, Odometry)]
    assert odometry == [0.0, 0.4]
    assert log.skipped == {"odometry not finite, scan kept": 1}
    assert log.problems[0].message == "run.clf:2: the odometry pose is NaN or infinite"
    assert log.num_odometry == 2


def test_unusable_ranges_stay_in_the_scan_for_the_filter(tmp_path):
    tokens = "nan NaN -nan inf -inf Infinity -1.5 0.0 1e3"
    line = f"FLASER 9 {tokens} 0 0 0 0 0 0 1.0 host 0"
    (scan,) = scans_of(open_log(write(tmp_path / "run.clf", line)))
    expected = [math.nan] * 3 + [math.inf, -math.inf, math.inf, -1.5, 0.0, 1e3]
    assert np.array_equal(scan.ranges, expected, equal_nan=True)


def test_frequent_faults_are_counted_and_reported_few_times(tmp_path):
    lines = [line for good in GOOD * 20 for line in (good, good[:200])]
    log = open_log(write(tmp_path / "run.clf", *lines))
    assert len(scans_of(log)) == 200
    assert log.skipped == {"range count mismatch or line cut off": 200}
    assert len(log.problems) < 10
    assert log.num_problems > 200


def test_counts_grow_while_iterating(tmp_path):
    log = open_log(write(tmp_path / "run.clf", GOOD[0], "SYNC a", GOOD[1], "SYNC b"))
    assert log.skipped == {}
    events = iter(log)
    while next(events).stamp == 0.0:
        pass
    assert log.skipped == {"SYNC (not used)": 1}
    list(events)
    assert log.skipped == {"SYNC (not used)": 2}


@pytest.mark.parametrize("bad", [GOOD[0][:200], GOOD[0].replace("1.0", "one"), "FLASER 0"])
def test_a_log_without_a_single_usable_scan_is_refused(tmp_path, bad):
    with pytest.raises(InputError, match=r"run\.clf:2: .*; no scan of this CARMEN log can be used"):
        open_log(write(tmp_path / "run.clf", "ODOM 0 0 0 0 0 0 1.0 host 0", bad, bad))


def test_one_scan_is_enough(tmp_path):
    log = open_log(write(tmp_path / "run.clf", GOOD[3]))
    assert [type(event) for event in log] == [Odometry, LaserScan]
    assert (log.num_scans, log.duration) == (1, 0.0)
    assert "beams      180" in log.profile.describe()


@pytest.mark.parametrize("value", [81.91, "inf", 0.0, "nan", -1.0])
def test_a_log_with_all_beams_missing_is_read(tmp_path, value):
    lines = [flaser(value, stamp=0.2 * i) for i in range(20)]
    log = open_log(write(tmp_path / "run.clf", *lines))
    assert len(scans_of(log)) == 20
    geometry = scans_of(log)[0].geometry
    usable = [
        (geometry.range_min <= scan.ranges) & (scan.ranges < geometry.range_max)
        for scan in scans_of(log)
    ]
    assert not np.any(usable)


def test_a_gap_of_ten_hours_is_kept_and_reported(tmp_path):
    lines = [flaser(stamp=0.2 * i + 36000.0 * (i >= 20)) for i in range(40)]
    log = open_log(write(tmp_path / "run.clf", *lines))
    assert [scan.time for scan in scans_of(log)] == [scan.stamp for scan in scans_of(log)]
    assert log.problems == [
        ("warning", "run.clf:21: nothing was recorded for 36000.2 s before this line", "gap")
    ]


def test_scans_may_pause_while_odometry_goes_on(tmp_path):
    odom = [f"ODOM {0.01 * i} 0 0 0 0 0 {0.1 * i:.1f} host 0" for i in range(1000)]
    log = open_log(write(tmp_path / "run.clf", *GOOD[:1], *odom[1:], flaser(stamp=100.0)))
    assert log.problems == []
    assert log.time_report.gaps == ()


def test_one_wild_stamp_makes_no_gap(tmp_path):
    stamps = [0.2 * i for i in range(40)]
    stamps[17] = 36000.0
    log = open_log(write(tmp_path / "run.clf", *(flaser(stamp=s) for s in stamps)))
    scans = scans_of(log)
    assert scans[17].stamp == 36000.0
    assert scans[17].time == pytest.approx(3.4)
    assert log.duration == pytest.approx(7.8)
    assert log.time_report.num_wild == 1
    assert log.time_report.gaps == ()


def test_backward_stamps_are_kept_and_times_follow_the_file(tmp_path):
    rng = np.random.default_rng(5)
    stamps = [round(0.2 * i + rng.uniform(0.0, 0.8), 3) for i in range(300)]
    lines = []
    for i, stamp in enumerate(stamps):
        lines += [f"ODOM {i} 0 0 0 0 0 {stamp} host 0", flaser(stamp=stamp, pose=f"{i} 0 0")]
    log = open_log(write(tmp_path / "run.clf", *lines))
    events = list(log)
    times = np.array([event.time for event in events])
    assert (np.diff(times) >= 0.0).all()
    assert [scan.stamp for scan in scans_of(log)] == stamps
    assert np.diff([scan.time for scan in scans_of(log)]) == pytest.approx([0.2] * 299, abs=0.01)
    # The pose before each scan is its own, at its own time, once.
    assert len(events) == 600
    assert all(a.time == b.time for a, b in zip(events[::2], events[1::2], strict=True))
    assert any("run backwards" in p.message for p in log.problems)


def test_few_scans_among_bursty_odometry_keep_their_poses(tmp_path):
    random = np.random.default_rng(3)
    lines, own_x = [], []
    for i in range(600):
        # written late, in bursts of up to ten lines
        stamp = round(0.1 * (i + 10 * random.random()), 6)
        lines.append(f"ODOM {0.05 * i} 0 0 0 0 0 {stamp} host 0")
        if i % 10 == 5:
            lines.append(flaser(2.0, stamp=stamp, pose=f"{0.05 * i} 0 0"))
            own_x.append(0.05 * i)
    log = open_log(write(tmp_path / "run.clf", *lines))

    events = list(log)
    times = np.array([e.time for e in events if isinstance(e, LaserScan)])
    readings = [(e.time, e.tf_odom_tracking.x) for e in events if isinstance(e, Odometry)]

    assert np.diff(times) == pytest.approx([1.0] * (len(times) - 1), abs=0.2)
    assert [dict(readings)[time] for time in times.tolist()] == own_x


def test_lines_without_stamps_get_the_usual_rate(tmp_path):
    lines = [line.rsplit(None, 3)[0] for line in GOOD]
    log = open_log(write(tmp_path / "run.clf", *lines, newline=False))
    scans = scans_of(log)
    assert [scan.time for scan in scans] == pytest.approx([0.2 * i for i in range(10)])
    assert [scan.stamp for scan in scans] == [scan.time for scan in scans]
    assert log.time_report.num_missing == 10


def test_a_line_without_stamp_among_others_lies_between_them(tmp_path):
    lines = [*GOOD[:4], GOOD[4].rsplit(None, 3)[0], *GOOD[5:]]
    log = open_log(write(tmp_path / "run.clf", *lines))
    assert scans_of(log)[4].time == pytest.approx(0.8)
    assert log.time_report.num_missing == 1


def test_the_same_stamp_on_all_scans_still_gives_times(tmp_path):
    lines = (flaser(1.0 + 0.1 * i, stamp=7.0) for i in range(9))
    log = open_log(write(tmp_path / "run.clf", *lines))
    assert (np.diff([scan.time for scan in scans_of(log)]) > 0.0).all()
    assert log.time_report.num_repeated == 8
