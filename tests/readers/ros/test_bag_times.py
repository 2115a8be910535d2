# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

import cartoloop.readers.ros.merging as merging
from cartoloop.readers import open_log
from cartoloop.sensor.events import LaserScan, Odometry
from tests.readers.ros.bag_files import START, BagMaker, ranges_of


def recorded(tmp_path, scan_stamp, odometry_stamp, num=40):
    """Write scans at 10 Hz and odometry between them, with stamps as the functions say."""
    bag = BagMaker("mcap")
    for i in range(num):
        t = 0.1 * (i + 1)
        bag.add("/scan", bag.make.scan(scan_stamp(t), ranges_of(i), "base_link"), t)
        bag.add("/odom", bag.make.odometry(odometry_stamp(t + 0.05), (0.1 * i, 0, 0)), t + 0.05)
    return open_log(bag.write(tmp_path))


def test_messages_without_stamps_get_the_time_of_recording(tmp_path):
    log = recorded(tmp_path, lambda t: 0.0, lambda t: START + t)
    events = list(log)
    assert [type(e) for e in events] == [LaserScan, Odometry] * 40
    assert events[0].time == events[0].stamp == pytest.approx(START + 0.1)
    (finding,) = log.inventory.findings
    assert (finding.code, finding.count) == ("zero_stamps", 40)
    assert "all messages have no stamp" in log.problems[0].message


def test_one_message_without_a_stamp_fits_in(tmp_path):
    log = recorded(tmp_path, lambda t: 0.0 if 1.05 < t < 1.15 else START + t, lambda t: START + t)
    times = [e.time for e in log if isinstance(e, LaserScan)]
    np.testing.assert_allclose(np.diff(times), 0.1, atol=1e-4)


def test_sensors_on_different_clocks_are_brought_together(tmp_path):
    log = recorded(tmp_path, lambda t: START + t, lambda t: 500.0 + t)
    events = list(log)
    assert [type(e) for e in events] == [LaserScan, Odometry] * 40
    assert events[1].time == pytest.approx(START + 0.15, abs=1e-3)
    assert events[1].stamp == pytest.approx(500.15)
    assert [f.code for f in log.inventory.findings] == ["other_clock"]


def test_a_restarted_clock_shifts_all_sensors(tmp_path):
    def stamp(t):
        return START + t if t < 2.03 else 1000.0 + t

    log = recorded(tmp_path, stamp, stamp)
    events = list(log)
    assert [type(e) for e in events] == [LaserScan, Odometry] * 40
    np.testing.assert_allclose(np.diff([e.time for e in events]), 0.05, atol=0.051)
    assert "clock_reset" in {f.code for f in log.inventory.findings}


def test_repeated_and_backward_stamps_are_reported(tmp_path):
    def stamp(t):
        i = round(10 * t)
        return START + 0.1 * {7: 6, 20: 12}.get(i, i)

    log = recorded(tmp_path, stamp, lambda t: START + t)
    scans = [e for e in log if isinstance(e, LaserScan)]
    assert len(scans) == 40
    assert (np.diff([s.time for s in scans]) > 0.0).all()
    assert scans[19].stamp == pytest.approx(START + 1.2)
    assert log.time_report.num_repeated == 1
    assert "stamps_out_of_order" in {f.code for f in log.inventory.findings}


def test_a_long_pause_is_reported_with_its_place(tmp_path):
    bag = BagMaker("bag")
    for i in range(40):
        t = 0.1 * i + (60.0 if i >= 25 else 0.0)
        bag.add("/scan", bag.make.scan(START + t, ranges_of(i)), t)
    log = open_log(bag.write(tmp_path))
    gap = next(f for f in log.inventory.findings if f.code == "gap")
    assert gap.stamp == pytest.approx(START + 62.5)
    assert "nothing for 60.1 s" in gap.message
    topic = log.inventory.topics[0]
    assert topic.stamps.gaps == (pytest.approx((START + 2.4, 60.1)),)


def test_the_number_of_waiting_messages_is_bounded(tmp_path, monkeypatch):
    monkeypatch.setattr(merging, "MAX_WAITING", 6)
    bag = BagMaker("mcap")
    for i in range(60):
        t = 0.1 * i
        bag.add("/scan", bag.make.scan(START + t, ranges_of(i), "base_link"), t)
        bag.add("/odom", bag.make.odometry(START + t + 0.05, (0.1 * i, 0, 0)), t + 0.95)
    log = open_log(bag.write(tmp_path))
    events = list(log)
    assert (np.diff([e.time for e in events]) >= 0.0).all()
    assert sum(isinstance(e, LaserScan) for e in events) == 60
    late = log.skipped["recorded too late to be put in order"]
    assert late > 0
    assert sum(isinstance(e, Odometry) for e in events) == 60 - late
