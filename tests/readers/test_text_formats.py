# SPDX-License-Identifier: Apache-2.0
"""Text recordings besides CARMEN's are known by their content and read with nothing to say."""

import gzip
import math
import os
from pathlib import Path

import numpy as np
import pytest

from cartoloop.errors import InputError
from cartoloop.readers import ReadOptions, open_log
from cartoloop.readers.line_log import LineLog
from cartoloop.readers.tinyslam import wheel_motion
from cartoloop.sensor.events import LaserScan, Odometry
from cartoloop.sensor.pose import Pose

DATA = Path(os.environ.get("CARTOLOOP_DATA", Path(__file__).parents[2] / "../shared/data"))


@pytest.fixture
def opened(tmp_path):
    def write(*lines, options=None):
        path = tmp_path / "given.txt"
        path.write_text("\n".join(lines) + "\n")
        return open_log(path, options)

    return write


def scans_of(log):
    return [event for event in log if isinstance(event, LaserScan)]


def odometry_of(log):
    return [event for event in log if isinstance(event, Odometry)]


def tinyslam_line(micros, left, right, ranges):
    head = [micros, 14710, left, right, 0, 0, 0, 170.1, *[255] * 16]
    return " ".join(map(str, (*head, *ranges)))


WALL = [2000 + k % 7 for k in range(682)]


class TestDpslam:
    lines = ("Odometry 1.0 2.0 0.5", "Laser 5 1.5 2.0 2.5 nan 8.1")

    def test_the_odometry_before_a_scan_is_the_scans(self, opened):
        log = opened(*self.lines, "Odometry 1.1 2.0 0.5", "Laser 5 1 2 3 4 5")
        events = list(log)
        assert [type(event) for event in events] == [Odometry, LaserScan] * 2
        assert events[0].tf_odom_tracking == Pose(1.0, 2.0, 0.5)
        assert events[0].time == events[1].time < events[2].time == events[3].time
        assert events[3].ranges.tolist() == [1, 2, 3, 4, 5]
        assert log.skipped == {}

    def test_any_number_of_beams_spans_half_a_turn(self, opened):
        log = opened(*self.lines, "Laser 181 " + "2.5 " * 181)
        angles = [scan.geometry.angles for scan in scans_of(log)]
        assert angles[0] == pytest.approx(np.radians([-90, -45, 0, 45, 90]))
        assert angles[1] == pytest.approx(np.radians(np.arange(-90.0, 91.0)))

    @pytest.mark.parametrize(
        ("line", "reason"),
        [
            ("Laser 5 1 2 3 4", "range count mismatch or line cut off"),
            ("Laser 5 1 2 3 4 5 6", "range count mismatch or line cut off"),
            ("Laser 5 1 2 3 4 x", "not a number"),
            ("Laser x 1 2 3 4", "no range count"),
            ("Laser 0", "scan without ranges"),
            ("Odometry 1 2", "range count mismatch or line cut off"),
            ("Odometry 1 2 nan", None),
            ("Lasso 1 2 3", "unknown line"),
            ("# a comment", None),
            ("", None),
        ],
    )
    def test_damaged_lines_are_counted(self, opened, line, reason):
        log = opened(*self.lines * 20, line)
        assert len(scans_of(log)) == 20
        assert log.skipped == ({reason: 1} if reason else {})

    def test_odometry_alone_is_no_recording(self, opened):
        with pytest.raises(InputError, match="no Laser line"):
            opened("Odometry 1 2 3")


class TestTinyslam:
    def test_units_and_places(self, opened):
        log = opened(*[tinyslam_line(10**5 * (k + 3), 0, 0, WALL) for k in range(4)])
        scans = scans_of(log)
        assert [scan.stamp for scan in scans] == pytest.approx([0.3, 0.4, 0.5, 0.6])
        assert scans[0].ranges[:7] == pytest.approx([2.0 + 0.001 * k for k in range(7)])
        assert np.degrees(scans[0].geometry.angles[[0, -1]]) == pytest.approx([-119.7, 119.7], 1e-3)
        assert scans[0].geometry.tf_tracking_sensor == Pose(0.145, 0.0, 0.0)
        assert log.profile.has_odometry

    def test_wheel_ticks_become_odometry_poses(self, opened):
        lines = [tinyslam_line(10**5 * k, 500 * k, 1000 * k, WALL) for k in range(9)]
        poses = [event.tf_odom_tracking for event in odometry_of(opened(*lines))]
        assert poses[0] == Pose(0.0, 0.0, 0.0)
        assert poses[1] == pytest.approx(wheel_motion(500, 1000))
        # The right wheel makes 250 mm of arc more on each of 8 steps.
        turn = 8 * 0.25 * math.tau * 0.077 / 0.33
        assert poses[8].theta == pytest.approx(turn)

    def test_a_turn_of_both_wheels_is_the_rims_length(self):
        assert wheel_motion(2000, 2000) == pytest.approx((math.tau * 0.077, 0.0, 0.0))
        assert wheel_motion(-100, 100).x == pytest.approx(0.0)
        assert wheel_motion(-100, 100).theta > 0.0

    def test_a_line_cut_off_is_counted(self, opened):
        good = [tinyslam_line(10**5 * k, 0, 0, WALL) for k in range(4)]
        log = opened(*good, good[0][:1000])
        assert len(scans_of(log)) == 4
        assert log.skipped == {"line cut off or not a number": 1}


class TestCsv:
    angles = "# angle_min=-1.0 angle_increment=0.5"

    def test_time_pose_and_ranges(self, opened):
        log = opened(
            self.angles,
            "time,x,y,theta,r0,r1,r2",
            "1.0,0.1,0.2,0.3,2.5,inf,4",
            "2.0,0.4,0.5,0.6,,nan,4e0",
        )
        events = list(log)
        assert [type(event) for event in events] == [Odometry, LaserScan] * 2
        assert events[2].tf_odom_tracking == Pose(0.4, 0.5, 0.6)
        assert events[3].stamp == events[3].time == 2.0
        assert events[1].ranges.tolist() == [2.5, math.inf, 4.0]
        assert events[3].ranges[2] == 4.0
        assert np.isnan(events[3].ranges[:2]).all()
        assert events[1].geometry.angles == pytest.approx([-1.0, -0.5, 0.0])

    def test_all_but_ranges_and_angles_may_be_missing(self, opened):
        log = opened(self.angles, "r0,r1", "1,2", "3,4")
        scans = list(log)
        assert [scan.ranges.tolist() for scan in scans] == [[1, 2], [3, 4]]
        assert scans[0].time < scans[1].time
        assert not log.profile.has_odometry

    def test_angles_may_stand_in_columns_and_change(self, opened):
        log = opened("time,angle_min,angle_increment,ranges", "0,-1,0.1,5,5,5", "1,-2,0.2,5,5,5,5")
        geometries = [scan.geometry for scan in scans_of(log)]
        assert [(g.angle_min, g.angle_increment, g.num_beams) for g in geometries] == [
            (-1.0, 0.1, 3),
            (-2.0, 0.2, 4),
        ]

    def test_settings_in_the_comment_are_used(self, opened):
        log = opened(
            "# my robot, angle_min: -1, angle_max: 1",
            "# laser_x=0.2 laser_yaw=3.14 range_max=9",
            "r0,r1,r2",
            "1,2,3",
        )
        geometry = scans_of(log)[0].geometry
        assert geometry.angles == pytest.approx([-1, 0, 1])
        assert geometry.tf_tracking_sensor == Pose(0.2, 0.0, 3.14)
        assert geometry.range_max == 9.0

    def test_the_place_given_comes_before_that_recorded(self, opened):
        given = ReadOptions(laser_pose=Pose(1.0, 2.0, 0.5))
        log = opened(self.angles + " laser_x=7", "r0,r1", "1,2", options=given)
        assert scans_of(log)[0].geometry.tf_tracking_sensor == Pose(1.0, 2.0, 0.5)

    def test_odometry_may_come_more_often_than_scans(self, opened):
        log = opened(
            self.angles,
            "t,x,y,yaw,r0,r1",
            "0.0,0,0,0,2,2",
            "0.1,1,0,0,,",
            "0.2,2,0,0",
            "0.3,,,,2,2",
        )
        assert [type(event) for event in log] == [
            Odometry,
            LaserScan,
            Odometry,
            Odometry,
            LaserScan,
        ]
        assert [event.time for event in log] == pytest.approx([0.0, 0.0, 0.1, 0.2, 0.3])

    def test_output_of_rostopic_is_read(self, opened):
        names = "header.seq,header.stamp,header.frame_id,angle_min,angle_max,angle_increment"
        header = ",".join(f"field.{name}" for name in names.split(","))
        log = opened(
            f"%time,{header},field.ranges0,field.ranges1,field.intensities0,field.intensities1",
            "1400000000900000000,1,1400000000500000000,laser,-1.5,1.5,3.0,4.5,inf,10,11",
            "1400000001900000000,2,1400000001500000000,laser,-1.5,1.5,3.0,4.25,5.5,10,11",
        )
        scans = scans_of(log)
        assert [scan.stamp for scan in scans] == pytest.approx([1.4e9 + 0.5, 1.4e9 + 1.5], abs=1e-5)
        assert [scan.ranges.tolist() for scan in scans] == [[4.5, math.inf], [4.25, 5.5]]
        assert scans[0].geometry.angles == pytest.approx([-1.5, 1.5])

    @pytest.mark.parametrize(
        ("line", "reason"),
        [
            ("1.0,0,0,0,2,2", "range count mismatch or line cut off"),
            ("1.0,0,0,0,2,2,2,2", "range count mismatch or line cut off"),
            ("1.0,0,0,0,2,x,2", "not a number"),
            ("now,0,0,0,2,2,2", "not a number"),
            ("1.0,0", "line cut off"),
            ("time,x,y,theta,r0,r1,r2", None),
            ("# more", None),
        ],
    )
    def test_damaged_lines_are_counted(self, opened, line, reason):
        header = (self.angles, "time,x,y,theta,r0,r1,r2")
        log = opened(*header, *[f"{0.1 * k},0,0,0,2,2,2" for k in range(9)], line)
        assert len(scans_of(log)) == 9
        assert log.skipped == ({reason: 1} if reason else {})

    def test_a_scan_is_kept_without_its_odometry(self, opened):
        header = (self.angles, "time,x,y,theta,r0,r1,r2")
        log = opened(*header, *[f"{0.1 * k},0,0,{'inf' if k == 4 else 0},2,2,2" for k in range(9)])
        assert len(scans_of(log)) == 9
        assert log.skipped == {"odometry not finite, scan kept": 1}

    @pytest.mark.parametrize(
        ("lines", "message"),
        [
            (("time,r0,r1", "0,1,2"), "angle_min is missing"),
            (("# angle_min=0 angle_increment=0", "r0,r1", "1,2"), "angle_increment is 0"),
            (("# angle_min=-90 angle_increment=1", "r0,r1", "1,2"), "give radians, not degrees"),
            ((angles, "r0,time,r1", "1,0,2"), "do not stand side by side"),
            ((angles, "r0,r1", "a,b"), "'a' is not a number; no scan of this CSV file"),
            ((angles, "r0,r1"), "holds no laser scans"),
        ],
    )
    def test_unreadable_files_are_refused_in_one_line(self, opened, lines, message):
        with pytest.raises(InputError, match=message) as caught:
            opened(*lines)
        assert "given.txt" in str(caught.value)
        assert "\n" not in str(caught.value)

    def test_gzip_that_breaks_off_is_read_as_far_as_it_goes(self, tmp_path):
        noise = np.random.default_rng(1).uniform(1.0, 9.0, (300, 40)).round(3)
        rows = [f"{0.1 * k:.1f}," + ",".join(map(str, row)) for k, row in enumerate(noise)]
        angles = "# angle_min=-1.0 angle_increment=0.05"
        text = "\n".join([angles, "time," + ",".join(f"r{k}" for k in range(40)), *rows])
        packed = gzip.compress(text.encode(), mtime=0)
        path = tmp_path / "cut.csv.gz"
        path.write_bytes(packed[: len(packed) // 2])
        log = open_log(path)
        assert 100 < len(scans_of(log)) < 200
        assert any("cut off" in p.message and p.severity == "error" for p in log.problems)


# name: scans, rate [Hz], duration [s], path by the odometry [m], range_max [m]
FILES = {
    "exp1.dat": (756, 10.12, 74.6, 46.0, 5.6),
    "exp2.dat": (641, 10.13, 63.2, 44.5, 5.6),
    "loop5.log": (551, 5.0, 110.0, 56.1, 8.14),
}


@pytest.mark.data
@pytest.mark.parametrize("name", FILES)
def test_real_recordings_are_read_whole(name):
    path = DATA / f"other/{name}.gz"
    if not path.exists():
        pytest.skip(f"{path} is absent: set CARTOLOOP_DATA to the folder of the recordings")
    num_scans, rate, duration, length, range_max = FILES[name]
    log = open_log(path)
    assert isinstance(log, LineLog)
    path = np.array([event.tf_odom_tracking[:2] for event in odometry_of(log)])
    assert len(scans_of(log)) == log.num_scans == log.num_odometry == num_scans
    assert log.skipped == {}
    assert log.profile.rate == pytest.approx(rate, rel=0.01)
    assert log.duration == pytest.approx(duration, abs=0.1)
    assert log.profile.range_max == pytest.approx(range_max, abs=0.02)
    assert np.hypot(*np.diff(path, axis=0).T).sum() == pytest.approx(length, rel=0.005)
