# SPDX-License-Identifier: Apache-2.0
"""Each check finds what it is for, and is silent where all is well."""

import math
from dataclasses import replace

import numpy as np
import pytest

from cartoloop.doctor import clouds, frames, imu, odometry, scans, times
from cartoloop.doctor.contents import Stream, times_of
from cartoloop.doctor.findings import Finding, from_message, worst_first
from cartoloop.local_slam.odometry_parameters import OdometryParameters
from cartoloop.local_slam.odometry_veer import NO_VEER, Veer
from cartoloop.readers.ros.inventory import TopicSummary, TransformSummary
from cartoloop.readers.ros.stream_times import StampStatistics
from cartoloop.sensor.events import (
    CloudGeometry,
    Imu,
    LaserScan,
    Odometry,
    PointCloud,
    ScanGeometry,
)
from cartoloop.sensor.pose import Pose
from cartoloop.sensor.sensor_profile import SensorProfile
from cartoloop.sensor.time_repair import TimeReport, repair_times

BEAMS = 60
GEOMETRY = ScanGeometry(-math.pi / 2, math.pi / BEAMS, BEAMS, 0.1, 30.0, sensor="laser")
PROFILE = SensorProfile(180, 3.1, 0.0175, 0.1, 30.0, 50.0, 0.1, 0.01, 0.01, 10.0, 100)


def wall(number):
    """Ranges that differ from scan to scan."""
    return 3.0 + 0.1 * np.sin(0.3 * number + np.linspace(0.0, 2.0, BEAMS)) + 0.05 * number


def watch_of(ranges, *, geometry=GEOMETRY, period=0.1):
    watch = scans.ScanWatch("laser")
    for number, values in enumerate(ranges):
        own = replace(geometry, num_beams=len(values))
        watch.add(LaserScan(100.0 + period * number, period * number, np.array(values), own))
    return watch


def good_watch(**options):
    return watch_of([wall(k) for k in range(40)], **options)


class TestScans:
    def test_sound_scans_have_no_findings(self):
        assert scans.check_scans(good_watch(), PROFILE, path_m=10.0) == []

    def test_scans_without_returns(self):
        nothing = np.full(BEAMS, 50.0)
        some = scans.check_returns(watch_of([wall(0), nothing, wall(1), nothing]))
        assert (some.severity, some.code, some.count, some.time) == (
            "warning",
            "few_returns",
            2,
            100.1,
        )
        every = scans.check_returns(watch_of([nothing, nothing]))
        assert (every.severity, every.code) == ("error", "no_returns")
        rare = scans.check_returns(watch_of([*[wall(k) for k in range(200)], nothing]))
        assert rare.severity == "info"

    def test_scans_in_millimetres_show_nothing_that_is_mapped(self):
        geometry = replace(GEOMETRY, range_max=30000.0)
        watch = watch_of([1000.0 * wall(k) for k in range(5)], geometry=geometry)
        assert scans.check_returns(watch).code == "no_returns"

    def test_repeated_scans(self):
        finding = scans.check_repeated(watch_of([wall(0), wall(1), wall(1), wall(1), wall(2)]))
        assert (finding.code, finding.count, finding.time) == ("repeated_scans", 2, 100.2)

    def test_scans_that_see_nothing_are_not_repeated(self):
        assert scans.check_repeated(watch_of([np.full(BEAMS, 50.0)] * 4)) is None

    def test_overlapping_scans(self):
        slow = replace(GEOMETRY, time_increment=0.15 / BEAMS)
        finding = scans.check_overlap(good_watch(geometry=slow))
        assert (finding.code, finding.count) == ("overlapping_scans", 39)
        assert finding.time == pytest.approx(100.1)
        fast = replace(GEOMETRY, time_increment=0.09 / BEAMS)
        assert scans.check_overlap(good_watch(geometry=fast)) is None

    def test_stamps_in_bursts_are_no_overlap_without_beam_times(self):
        assert scans.check_overlap(good_watch(period=-0.1)) is None

    def test_changing_beam_counts(self):
        finding = scans.check_beam_count(watch_of([wall(0), wall(1), wall(2)[:-1]]))
        assert (finding.severity, finding.code, finding.count) == ("info", "beam_count_changes", 1)
        assert "from 59 to 60" in finding.message

    def test_blind_beams(self):
        ranges = [wall(k) for k in range(40)]
        for values in ranges:
            values[40:50] = math.nan
        finding = scans.check_blind_beams(watch_of(ranges))
        assert (finding.code, finding.count) == ("blind_beams", 10)
        assert "30 to 57 deg" in finding.message

    def test_a_part_of_the_robot_in_view(self):
        ranges = [wall(k) for k in range(40)]
        for number, values in enumerate(ranges):
            values[:4] = 0.31 + 0.005 * (number % 3)
        watch = watch_of(ranges)
        finding = scans.check_own_body(watch, path_m=5.0)
        assert (finding.code, finding.count) == ("own_body", 4)
        assert "sensor.min_range=0.37" in finding.remedy
        assert scans.check_own_body(watch, path_m=0.5) is None

    def test_scans_far_apart(self):
        finding = scans.check_spacing(good_watch(), path_m=39.0)
        assert finding.code == "sparse_scans"
        assert "1.00 m apart" in finding.message

    def test_a_narrow_view(self):
        narrow = replace(PROFILE, field_of_view=1.0)
        assert scans.check_field_of_view(good_watch(), narrow).code == "narrow_view"

    def test_what_stands_for_no_return(self):
        watch = good_watch()
        unknown = replace(PROFILE, no_return=None, range_max=math.inf)
        assert scans.check_no_return(watch, unknown).code == "no_range_end"
        assert scans.check_no_return(watch, replace(PROFILE, no_return=0.0)).code == (
            "no_return_is_zero"
        )
        assert scans.check_no_return(watch, replace(PROFILE, no_return=math.inf)) is None

    def test_all_values_are_counted(self):
        values = [1.0, 2.0, math.inf, 50.0, math.nan, -math.inf, -1.0, 0.0, 0.05]
        counted = watch_of([values]).values
        assert (counted.measured, counted.no_return, counted.nan) == (2, 2, 1)
        assert (counted.negative, counted.too_near, counted.total) == (2, 2, 9)


def odometry_of(poses, period=0.1):
    watch = odometry.OdometryWatch("/odom")
    for number, pose in enumerate(poses):
        watch.add(Odometry(50.0 + period * number, period * number, Pose(*pose)))
    return watch


MODEL = OdometryParameters(rotation_error=0.001, translation_error=0.001)
MOVING = [(0.1 * k, 0.0, 0.01 * k) for k in range(50)]


class TestOdometry:
    def test_sound_odometry_has_no_findings(self):
        assert odometry.check_odometry(odometry_of(MOVING), MODEL) == []

    def test_path_length_and_speed(self):
        watch = odometry_of(MOVING)
        assert watch.path_length == pytest.approx(4.9)
        assert watch.fastest == pytest.approx(1.0)
        assert watch.turned == pytest.approx(0.49)
        assert watch.fastest_turn == pytest.approx(0.1)

    def test_none_at_all(self):
        assert [f.code for f in odometry.check_odometry(odometry_of([]), None)] == ["no_odometry"]

    def test_poses_that_are_no_numbers(self):
        finding = odometry.check_finite(odometry_of([*MOVING, (math.nan, 0.0, 0.0)]))
        assert (finding.code, finding.count) == ("odometry_not_finite", 1)

    def test_jumps_are_counted_but_not_in_the_path_length(self):
        watch = odometry_of([*MOVING, (0.0, 0.0, 0.0), (0.1, 0.0, 0.0)])
        finding = odometry.check_jumps(watch)
        assert (finding.code, finding.count, finding.time) == ("odometry_jumps", 1, 55.0)
        assert watch.path_length == pytest.approx(5.0)

    @pytest.mark.parametrize(
        ("factors", "text"),
        [((1000.0, 1.0), "in millimetres?"), ((1.0, 57.3 * 5.0), "in degrees?")],
    )
    def test_units_by_the_jumps(self, factors, text):
        by, turn = factors
        watch = odometry_of([(x * by, y * by, theta * turn) for x, y, theta in MOVING])
        finding = odometry.check_jumps(watch)
        assert finding.message == "the odometry jumps at 49 of 49 steps"
        assert text in finding.remedy

    def test_odometry_that_never_moves(self):
        finding = odometry.check_moves(odometry_of([(1.0, 2.0, 0.5)] * 20))
        assert finding.code == "odometry_still"
        assert odometry.check_moves(odometry_of(MOVING)) is None

    def test_readings_that_are_sent_again(self):
        assert odometry.check_period(odometry_of(MOVING)) is None
        held = odometry_of([MOVING[k - k % 5] for k in range(len(MOVING))])
        finding = odometry.check_period(held)
        assert finding.code == "odometry_held"
        assert finding.severity == "info"
        assert f"each {held.period.usual_s:.2g} s" in finding.message

    def test_disagreement(self):
        unknown = OdometryParameters()
        assert odometry.check_agreement(odometry_of(MOVING), unknown).code == "odometry_disagrees"
        assert odometry.check_agreement(odometry_of(MOVING[:10]), unknown) is None

    @pytest.mark.parametrize(
        ("offset", "severity"),
        [(0.0, None), (0.02, None), (0.05, "info"), (0.64, "warning"), (-0.2, "warning")],
    )
    def test_offset(self, offset, severity):
        found = odometry.check_offset(odometry_of(MOVING), replace(MODEL, time_offset=offset))
        assert (found.severity if found else None) == severity
        assert found is None or ("newer" in found.message) == (offset > 0)

    def test_scale(self):
        watch = odometry_of(MOVING)
        assert odometry.check_scale(watch, replace(MODEL, rotation_scale=0.96)) is None
        finding = odometry.check_scale(watch, replace(MODEL, rotation_scale=1.13))
        assert finding.severity == "info"
        assert finding.message == "the odometry reports turns 13% too short"
        both = replace(MODEL, rotation_scale=0.8, translation_scale=1.1)
        finding = odometry.check_scale(watch, both)
        assert finding.severity == "warning"
        assert "turns 20% too long, distances 10% too short" in finding.message

    def test_a_scale_at_its_limit(self):
        watch = odometry_of(MOVING)
        [finding] = odometry.check_odometry(watch, replace(MODEL, translation_scale=2.5))
        assert (finding.severity, finding.code) == ("warning", "odometry_units")
        assert "distances of the odometry" in finding.message
        assert "units are probably wrong" in finding.remedy

    def test_a_wrong_yaw(self):
        watch, mounting = odometry_of(MOVING), Pose(0.1, 0.0, 0.35)
        known = replace(MODEL, metre_noise=0.02, num_metres=100, yaw=0.33)
        [finding] = odometry.check_odometry(watch, known, mounting=mounting)
        assert (finding.severity, finding.code) == ("warning", "odometry_yaw")
        assert "19 deg to the left of the x axis" in finding.message
        assert "--laser-pose=0.1,0,0.02," in finding.remedy
        for other in ({"yaw": 0.05}, {"num_metres": 2}):
            assert odometry.check_yaw(watch, replace(known, **other), mounting) is None

    @pytest.mark.parametrize(
        ("veer", "severity", "text"),
        [
            (NO_VEER, None, ""),
            (Veer(0.004, 0.003, -0.003), None, ""),
            (Veer(0.02), "info", "1.1 deg to the left"),
            (Veer(-0.06, 0.003), "warning", "3.4 deg to the right"),
            (Veer(0.0, 0.03, 0.04), "info", "up to 2.9 deg to a side that depends"),
            (Veer(-0.02, 0.03, 0.04), "info", "1.1 deg to the right and up to 2.9 deg"),
        ],
    )
    def test_veer(self, veer, severity, text):
        found = odometry.check_veer(odometry_of(MOVING), replace(MODEL, veer=veer))
        assert (found.severity if found else None) == severity
        assert found is None or text in found.message

    def test_a_turn_adds_up_over_the_seam(self):
        watch = odometry_of([(0.0, 0.0, math.remainder(0.5 * k, math.tau)) for k in range(30)])
        assert watch.turned == pytest.approx(14.5)
        assert watch.turned_until(np.array([0.0, 1.45])) == pytest.approx([0.0, 7.25])


def imu_of(acceleration=(0.0, 0.0, 9.81), velocity=(0.0, 0.0, 0.1), stamps=None):
    watch = imu.ImuWatch("/imu")
    for stamp in np.arange(100) * 0.01 if stamps is None else stamps:
        watch.add(Imu(100.0 + stamp, stamp, acceleration, velocity))
    return watch


class TestImu:
    def test_a_sound_imu_has_no_findings(self):
        assert imu.check_imu(imu_of()) == []
        assert imu.check_imu(imu.ImuWatch()) == []

    def test_readings_that_are_no_numbers(self):
        codes = [f.code for f in imu.check_imu(imu_of((math.nan, 0.0, 9.8)))]
        assert codes == ["imu_not_finite"]

    def test_acceleration_without_gravity(self):
        found = {f.code: f for f in imu.check_imu(imu_of((0.0, 0.1, 0.1)))}
        assert found["imu_acceleration"].count == 100
        assert found["imu_acceleration"].time == 100.0
        assert found["imu_gravity"].severity == "warning"

    def test_a_mean_that_is_off(self):
        assert [f.code for f in imu.check_imu(imu_of((0.0, 0.0, 9.2)))] == ["imu_gravity"]

    def test_tilt(self):
        acceleration = (9.81 * math.sin(0.5), 0.0, 9.81 * math.cos(0.5))
        found = imu.check_imu(imu_of(acceleration))
        assert [f.code for f in found] == ["imu_tilted"]
        assert "29 degrees" in found[0].message

    def test_degrees_for_radians(self):
        assert [f.code for f in imu.check_imu(imu_of(velocity=(0.0, 0.0, 90.0)))] == ["imu_rate"]

    def test_gaps(self):
        stamps = [*(0.01 * np.arange(50)), *(0.7 + 0.01 * np.arange(50))]
        found = imu.check_imu(imu_of(stamps=stamps))
        assert [(f.code, f.count) for f in found] == [("imu_gaps", 1)]
        assert found[0].time == pytest.approx(100.49)

    def test_a_slow_imu_has_no_gaps(self):
        assert imu.check_imu(imu_of(stamps=0.1 * np.arange(50))) == []


def cloud(number, points=100, first=0.0, last=0.1):
    sent = np.linspace(first, last, points) if points else None
    return PointCloud(100.0 + number, float(number), np.ones((points, 3)), sent, CloudGeometry("l"))


class TestClouds:
    @staticmethod
    def found(*sent):
        watch = clouds.CloudWatch("lidar")
        for one in sent:
            watch.add(one)
        return [(f.severity, f.code, f.count) for f in clouds.check_clouds(watch)]

    def test_sound_clouds_have_no_findings(self):
        assert self.found(cloud(0), cloud(1)) == []

    def test_clouds_with_next_to_nothing(self):
        assert self.found(cloud(0, 5), cloud(1)) == [("warning", "few_returns", 1)]
        assert self.found(cloud(0, 5)) == [("error", "no_returns", 1)]

    def test_points_measured_before_the_stamp_or_long_after(self):
        assert self.found(cloud(0, first=-0.1)) == [("warning", "point_times", 1)]
        assert self.found(cloud(0, last=0.9)) == [("warning", "point_times", 1)]

    def test_points_without_times(self):
        assert self.found(replace(cloud(0), times=None)) == [("info", "no_point_times", 1)]


def stamps(**values):
    sound = {
        "first": 0.0,
        "last": 9.0,
        "rate": 10.0,
        "gaps": (),
        "gap_limit": 0.3,
        "num_zero": 0,
        "num_backwards": 0,
        "num_repeated": 0,
        "delay": 0.0,
        "largest_delay": 0.01,
    }
    return StampStatistics(**(sound | values))


def topic(name="/scan", role="scan", *, frames=("laser",), chosen=True, **values):
    return TopicSummary(name, "Type", role, 90, frames, stamps=stamps(**values), chosen=chosen)


class TestTimes:
    def test_sound_stamps_have_no_findings(self):
        sent = 0.1 * np.arange(50)
        assert times.check_report(repair_times(sent)[1], sent, "FLASER") == []
        assert times.check_delays([topic()]) == []
        assert times.check_unused_order([topic(chosen=False)]) == []

    def test_missing_stamps(self):
        _, report = repair_times(np.full(9, np.nan))
        finding = times.check_missing(report, "Laser")
        assert (finding.code, finding.count) == ("stamps_missing", 9)
        assert finding.remedy == "scans are taken to be 0.2 s apart"

    def test_stamps_out_of_order_name_the_first(self):
        sent = np.array([1.0, 1.1, 1.05, 1.2, 1.2, 1.3])
        finding = times.check_order(repair_times(sent)[1], sent, "FLASER")
        assert (finding.code, finding.count, finding.time) == ("stamps_out_of_order", 2, 1.05)
        assert "1 run backwards (by up to 0.05 s), 1 repeat" in finding.message

    def test_resets(self):
        finding = times.check_resets(TimeReport(9, resets=(3, 5)), "FLASER")[0]
        assert (finding.code, finding.count) == ("clock_reset", 2)
        assert "first in line 4" in finding.message

    def test_gaps_bridged_by_odometry_are_only_info(self):
        halting = np.array([*(0.1 * np.arange(20)), *(9.0 + 0.1 * np.arange(20))])
        scan = Stream("S", "", "scan", 40, True, times=times_of(halting))
        steady = Stream("O", "", "odometry", 99, True, times=times_of(0.1 * np.arange(99)))
        alike = replace(scan, name="O", role="odometry")
        alone = times.check_gaps([scan], 0.1)
        assert [(f.severity, f.code, f.where) for f in alone] == [("warning", "gap", "S")]
        assert alone[0].time == pytest.approx(1.9)
        assert "7.1 s" in alone[0].message
        assert [f.severity for f in times.check_gaps([scan, steady], 0.1)] == ["info"]
        assert [f.where for f in times.check_gaps([scan, alike], 0.1)] == ["S"]
        assert times.check_gaps([replace(scan, used=False)], 0.1) == []

    @pytest.mark.parametrize(
        ("delay", "largest", "severity", "remedy"),
        [
            (0.0, 0.2, "info", "faster machine"),
            (0.0, -0.8, "warning", "faster machine"),
            (7.0, 7.1, "warning", "NTP"),
        ],
    )
    def test_stamps_far_from_the_time_of_recording(self, delay, largest, severity, remedy):
        found = times.check_delays([topic(delay=delay, largest_delay=largest)])
        assert [(f.code, f.severity) for f in found] == [("recorded_late", severity)]
        assert remedy in found[0].remedy

    def test_stamps_out_of_order_in_topics_that_are_not_used(self):
        unused = topic("/back", chosen=False, num_backwards=2, num_repeated=1)
        found = times.check_unused_order([unused, topic(num_backwards=2)])
        assert [(f.code, f.where, f.count) for f in found] == [("stamps_out_of_order", "/back", 3)]


class TestFrames:
    def test_sound_frames_have_no_findings(self):
        topics = [topic(), topic("/imu", "imu", frames=("imu",)), topic("/back", frames=("back",))]
        assert frames.check_frames(topics, []) == []

    def test_two_topics_in_one_frame(self):
        found = frames.check_frames([topic(), topic("/scan_filtered")], [])
        assert [(f.code, f.count) for f in found] == [("shared_frame", 2)]
        assert "/scan, /scan_filtered have the same frame, laser" in found[0].message

    def test_no_frame(self):
        assert [f.code for f in frames.check_frames([topic(frames=("",))], [])] == [
            "nameless_frame"
        ]

    def test_the_result_of_another_slam(self):
        def transform(parent, child, origin="tf"):
            zeros = [0.0] * 6
            return TransformSummary(parent, child, origin, *zeros, 9, 0.0, 0.0)

        found = frames.check_other_slam(
            [
                transform("map", "odom"),
                transform("odom", "base_link"),
                transform("map", "building", "tf_static"),
            ]
        )
        assert [(f.severity, f.code, f.count) for f in found] == [("info", "other_slam", 9)]
        assert "map -> odom" in found[0].message


def test_findings_stand_worst_first_else_as_found():
    found = [Finding(s, c, "") for s, c in [("info", "a"), ("error", "b"), ("info", "c")]]
    assert [f.code for f in worst_first(found)] == ["b", "a", "c"]


def test_a_message_is_cut_into_what_is_wrong_and_what_to_do():
    finding = from_message("error", "x", "a.log: is empty; record again; or not")
    assert (finding.message, finding.remedy) == ("a.log: is empty", "record again; or not")
