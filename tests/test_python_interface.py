# SPDX-License-Identifier: Apache-2.0
"""The Python interface: what it converts, what it refuses in a line, and the order of calls."""

from __future__ import annotations

import math

import numpy as np
import pytest

import cartoloop
from cartoloop import (
    CartoloopError,
    CloudGeometry,
    Config,
    ConfigError,
    Imu,
    LaserScan,
    Mapper,
    Odometry,
    PointCloud,
    Pose,
    ScanGeometry,
    UsageError,
)
from cartoloop.config import SubmapConfig

GEOMETRY = ScanGeometry(-1.5, 0.01, 301, 0.1, 30.0)
RANGES = np.full(301, 2.0)


def scan(time=0.0, ranges=RANGES, geometry=GEOMETRY):
    return LaserScan(time, time, ranges, geometry)


def mapped(*events):
    mapper = Mapper()
    for event in events:
        mapper.add(event)
    return mapper, mapper.finish()


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda: ScanGeometry(-135.0, 0.5, 541, 0.1, 30.0), "angle_min is -135"),
        (lambda: ScanGeometry(0.0, 1.0, 360, 0.1, 30.0), "angle_increment is 1"),
        (lambda: ScanGeometry(-2.35, -0.25, 1081, 0.1, 30.0), "angle_increment is -0.25"),
        (
            lambda: ScanGeometry(-1.5, 0.01, 9, 0.1, 9.0, tf_tracking_sensor=Pose(0, 0, 90)),
            "tf_tracking_sensor.theta is 90",
        ),
        (lambda: ScanGeometry(-1.5, 0.01, 9, 0.1, 9.0, roll=180.0), "roll is 180"),
        (lambda: CloudGeometry(pitch=-90.0), "pitch is -90"),
    ],
)
def test_degrees_are_refused(make, says):
    with pytest.raises(UsageError) as refusal:
        make()

    assert says in str(refusal.value)
    assert str(refusal.value).endswith("more than two turns: give radians, not degrees")


def test_scanners_may_turn_once_and_a_bit_more():
    whole = ScanGeometry(0.0, math.tau / 359, 362, 0.1, 30.0)
    clockwise = ScanGeometry(math.tau, -math.tau / 359, 360, 0.1, 30.0)

    assert len(whole.angles) == 362
    assert clockwise.angles[-1] == pytest.approx(0.0)


@pytest.mark.parametrize("like", [list, tuple, np.float32, np.int64])
def test_lists_and_other_numbers_become_float64(like):
    ranges = like(RANGES.astype(int)) if like in (list, tuple) else RANGES.astype(like)

    made = scan(np.float32(1.5), ranges)

    assert made.ranges.dtype == np.float64
    assert np.array_equal(made.ranges, RANGES)
    assert (type(made.stamp), made.stamp) == (float, 1.5)


def test_poses_and_vectors_may_be_lists_and_arrays():
    odometry = Odometry(0, 0, np.array([1.0, 2.0, 0.5]))
    imu = Imu(0, 0, [0, 0, 9.8], np.zeros(3))
    cloud = PointCloud(0, 0, [[1, 2, 3]], [0], CloudGeometry(tf_tracking_sensor=(0, 0, 1)))

    assert odometry.tf_odom_tracking == Pose(1.0, 2.0, 0.5)
    assert (imu.linear_acceleration, imu.angular_velocity) == ((0.0, 0.0, 9.8), (0.0, 0.0, 0.0))
    assert cloud.points.shape == (1, 3)
    assert cloud.times.tolist() == [0.0]
    assert cloud.geometry.tf_tracking_sensor == Pose(0.0, 0.0, 1.0)
    assert Mapper().add(odometry) is None


@pytest.mark.parametrize(
    ("call", "says"),
    [
        (lambda: ScanGeometry("-1.5", 0.01, 9, 0.1, 9.0), "angle_min is '-1.5' (str)"),
        (lambda: ScanGeometry(-1.5, 0.01, 9.0, 0.1, 9.0), "num_beams is 9.0"),
        (lambda: ScanGeometry(-1.5, 0.01, -9, 0.1, 9.0), "num_beams is -9"),
        (lambda: scan(ranges="2.0 2.0"), "ranges is '2.0 2.0' (str): give an array"),
        (lambda: scan(ranges=None), "ranges is None"),
        (lambda: scan(ranges=[[1.0], [1.0, 2.0]]), "ranges is [[1.0], [1.0, 2.0]]"),
        (lambda: scan(ranges={"a": 1.0}), "ranges is {'a': 1.0} (dict)"),
        (lambda: scan(geometry={"angle_min": 0.0}), "give a ScanGeometry"),
        (lambda: scan("0.0"), "stamp [s] is '0.0' (str): give a number"),
        (lambda: scan(np.zeros(2)), "stamp [s] is an array of shape (2,)"),
        (lambda: scan(10**400), "stamp [s] is 1000000"),
        (lambda: Odometry(0, 0, {"x": 0}), "a Pose(x, y, theta), is {'x': 0} (dict)"),
        (lambda: Odometry(0, 0, (0, 0, 0, 1)), "give 3 numbers"),
        (lambda: Odometry(0, 0, Pose("0", 0, 0)), "is '0' (str): give a number"),
        (lambda: Imu(0, 0, 9.8, (0, 0, 0)), "linear_acceleration is 9.8 (float): give 3 numbers"),
        (lambda: PointCloud(0, 0, np.ones((1, 3)), None, GEOMETRY), "give a CloudGeometry"),
        (lambda: Mapper().add([1.0, 2.0]), "give a LaserScan, PointCloud, Odometry or Imu"),
        (lambda: Mapper().add(None), "event is None"),
        (lambda: Mapper({"sensor": {"max_range": 5}}), "give a cartoloop.Config"),
        (lambda: Mapper("my.toml"), "config is 'my.toml' (str)"),
        (lambda: Mapper(onto_pose=(1, 2, 3)), "give that too"),
        (
            lambda: Mapper(onto="map", onto_pose=(1, 2)),
            "onto_pose is (1, 2) (tuple)",
        ),
        (lambda: Mapper(onto="map", onto_pose=(1, 2, math.nan)), "give finite numbers"),
        (lambda: cartoloop.map_recording("a.log", onto_pose=(1, 2, 3)), "give that too"),
        (lambda: cartoloop.map_recording({"a": 1}), "recording is {'a': 1} (dict)"),
        (lambda: cartoloop.map_recording(None), "recording is None"),
        (lambda: cartoloop.map_recording([]), "an empty list"),
        (lambda: cartoloop.map_recording([3]), "recording is 3 (int): give a path"),
        (lambda: cartoloop.map_recording("a.log", {"a": 1}), "config is {'a': 1} (dict)"),
        (lambda: cartoloop.map_recording("a.log", out=3), "out is 3 (int): give a path"),
        (lambda: cartoloop.map_recording("a.log", layers="quality"), "give a list"),
        (lambda: cartoloop.map_recording("a.log", layers=["walls"]), "no layer 'walls'"),
        (lambda: cartoloop.map_recording("a.log", options={}), "options is {} (dict)"),
        (lambda: cartoloop.read(3), "recording is 3 (int): give a path"),
        (lambda: cartoloop.open_log(None), "recording is None"),
        (lambda: cartoloop.load_map(3), "map is 3 (int): give a path"),
    ],
)
def test_impossible_arguments_are_refused_in_a_line(call, says):
    with pytest.raises(UsageError) as refusal:
        call()

    assert says in str(refusal.value)
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda: Config(local_slm={}), "unknown parameter local_slm; did you mean local_slam?"),
        (
            lambda: Config(local_slam={"submaps": {"resolutoin": 0.1}}),
            "local_slam.submaps.resolutoin; did you mean resolution?",
        ),
        (lambda: Config(sensor={"zzz": 1}), "'cartoloop config show' lists all"),
        (lambda: Config(local_slam={"submaps": {"resolution": -1}}), "resolution is -1: "),
        (lambda: SubmapConfig(resolution="fine"), "SubmapConfig: resolution is 'fine': "),
        (lambda: Config({"sensor": {}}), "name each parameter"),
        (lambda: setattr(Config(), "sensor", None), "does not change once it is made"),
    ],
)
def test_faults_of_a_configuration_are_one_line(make, says):
    with pytest.raises(ConfigError) as fault:
        make()

    assert says in str(fault.value)
    assert "\n" not in str(fault.value)


def test_no_event_follows_the_end():
    mapper, result = mapped(scan(0.0), scan(0.1))

    with pytest.raises(UsageError, match="the map is finished"):
        mapper.add(scan(0.2))
    assert mapper.num_scans == len(result.stamps) == 2


def test_finishing_again_returns_the_same_map():
    mapper, result = mapped(scan(0.0), scan(0.1))

    assert mapper.finish() is result


def test_a_mapper_that_was_closed_cannot_be_finished():
    mapper = Mapper()
    mapper.add(scan())
    mapper.close()

    with pytest.raises(UsageError, match=r"result\(\) returns what was mapped"):
        mapper.finish()
    assert len(mapper.result().stamps) == 1


def test_a_failure_to_finish_is_not_hidden_by_another(monkeypatch):
    mapper = Mapper()
    mapper.add(scan())

    def fail(_):
        raise RuntimeError("the unforeseen")

    with pytest.raises(RuntimeError, match="the unforeseen"):
        mapper.finish(fail)
    with pytest.raises(UsageError, match="finishing failed"):
        mapper.finish()


def test_results_have_the_time_that_mapping_took():
    mapper = Mapper()
    for k in range(5):
        mapper.add(scan(0.1 * k))
    before = mapper.result().report
    report = mapper.finish().report

    assert 0.0 < before.wall_s < report.wall_s
    assert report.cpu_s > 0.0
    assert report.peak_memory_mb > 10.0
    assert report.real_time_factor == pytest.approx(0.4 / report.wall_s)


def test_reports_describe_the_sensors():
    cloud = PointCloud(0.3, 0.3, np.ones((9, 3)), None, CloudGeometry(sensor="top"))
    _, result = mapped(scan(0.0), scan(0.1), cloud)

    scanner, top = result.report.extra["sensors"]
    assert (scanner["beams"], scanner["range_max_m"]) == (301, 30.0)
    assert scanner["field_of_view_deg"] == pytest.approx(math.degrees(3.0))
    assert (top["name"], top["beams"], top["range_max_m"]) == ("top", None, None)


def test_refusals_are_errors_of_the_project():
    assert issubclass(UsageError, CartoloopError)
    assert "UsageError" in dir(cartoloop)
