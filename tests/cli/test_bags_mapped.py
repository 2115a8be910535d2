# SPDX-License-Identifier: Apache-2.0
"""ROS recordings from end to end: a command without options, and the options that overrule."""

from __future__ import annotations

import json

import numpy as np
import pytest

from cartoloop.cli.main import run
from cartoloop.sensor.events import LaserScan
from cartoloop.simulation import ring, simulate
from tests.readers.ros.bag_files import FORMATS, START, BagMaker

pytestmark = pytest.mark.slow

DURATION = 12.0


@pytest.fixture(scope="module")
def recordings(tmp_path_factory):
    """A drive round a ring in each format, and the true path length [m]."""
    drive = simulate(ring(), seed=2, duration=DURATION)
    made = {}
    for form in FORMATS:
        bag = BagMaker(form)
        sent = bag.make.transforms(START, ("base_link", "laser", (0, 0, 0.2), (0, 0, 0)))
        bag.add("/tf_static", sent, 0.0)
        first = None
        for event in drive.events():
            first = event.time if first is None else first
            t = event.time - first
            if isinstance(event, LaserScan):
                geometry = event.geometry
                scan = bag.make.scan(
                    START + t,
                    event.ranges,
                    angle_min=geometry.angle_min,
                    angle_increment=geometry.angle_increment,
                    angle_max=float(geometry.angles[-1]),
                    range_max=100.0,
                )
                bag.add("/scan", scan, t + 0.01)
            else:
                pose = tuple(float(value) for value in event.tf_odom_tracking)
                bag.add("/odom", bag.make.odometry(START + t, pose), t + 0.01)
        made[form] = bag.write(tmp_path_factory.mktemp(form))
    return made


def mapped(capsys, *arguments):
    status = run(["map", *map(str, arguments)])
    captured = capsys.readouterr()
    assert "Traceback" not in captured.err
    return status, captured


@pytest.mark.parametrize("form", FORMATS)
def test_a_recording_is_mapped_without_a_question(recordings, form, tmp_path, capsys):
    status, captured = mapped(capsys, recordings[form], "-o", tmp_path / "out")
    assert status == 0
    assert "/scan  LaserScan" in captured.out
    assert "used (at x 0.00, y 0.00, z 0.20 m" in captured.out
    report = json.loads((tmp_path / "out/report.json").read_text())
    assert report["input"]["scans"] > 50
    assert report["skipped"] == {}
    poses = np.loadtxt(tmp_path / "out/trajectory.tum")
    assert len(poses) == report["input"]["scans"]
    assert poses[0, 0] == pytest.approx(START, abs=1.0)


def test_all_formats_give_one_map(recordings, tmp_path, capsys):
    for form in FORMATS:
        assert mapped(capsys, recordings[form], "-o", tmp_path / form)[0] == 0
    maps = {(tmp_path / form / "map.pgm").read_bytes() for form in FORMATS}
    paths = {(tmp_path / form / "trajectory.tum").read_bytes() for form in FORMATS}
    assert len(maps) == len(paths) == 1


def test_the_choice_of_topics_may_be_overruled(recordings, tmp_path, capsys):
    status, captured = mapped(
        capsys, recordings["bag"], "-o", tmp_path / "out",
        "--scan-topic", "/scan", "--odom-topic", "none", "--laser-pose", "0.5,0,1.5",
    )  # fmt: skip
    assert status == 0
    assert "used (asked for, pose as given)" in captured.out
    assert "not used (no odometry is asked for)" in captured.out


@pytest.mark.parametrize(
    ("options", "status", "message"),
    [
        (["--scan-topic", "/laser"], 1, "topic /laser holds no scans; there is /scan"),
        (["--odom-topic", "/wheels"], 1, "topic /wheels holds no odometry; there is /odom"),
        (["--imu-topic", "/imu"], 1, "no IMU readings; there is no such topic"),
        (["--urdf", "nowhere.urdf"], 1, "nowhere.urdf: cannot be read"),
        (["--laser-pose", "1,2"], 2, "is not X,Y,YAW"),
        (["--laser-pose", "1,2,nan"], 2, "is not X,Y,YAW"),
        (["--laser-pose", "0.2,0,180"], 2, "a yaw of 180 rad is more than a turn"),
        (["--echo", "last"], 2, "choose first or strongest"),
    ],
)
def test_impossible_requests_are_refused_in_one_line(
    recordings, options, status, message, tmp_path, capsys
):
    found, captured = mapped(capsys, recordings["bag"], "-o", tmp_path / "out", *options)
    assert found == status
    assert message in captured.err


def test_options_of_bags_are_refused_for_carmen_logs(tmp_path, capsys):
    log = tmp_path / "a.log"
    simulate(ring(), seed=2, duration=1.0).write_carmen(log)
    status, captured = mapped(capsys, log, "-o", tmp_path / "out", "--imu-topic", "/imu")
    assert status == 1
    assert "is no ROS recording, so --imu-topic means nothing here" in captured.err


def test_a_laser_pose_holds_for_carmen_logs_as_well(tmp_path, capsys):
    log = tmp_path / "a.log"
    simulate(ring(), seed=2, duration=4.0).write_carmen(log)
    for name, options in (("plain", []), ("moved", ["--laser-pose", "0.5,0,0"])):
        assert mapped(capsys, log, "-o", tmp_path / name, *options)[0] == 0
    paths = [(tmp_path / n / "trajectory.tum").read_bytes() for n in ("plain", "moved")]
    assert paths[0] != paths[1]


def test_a_truncated_recording_gives_a_map_and_an_error(recordings, tmp_path, capsys):
    data = recordings["bag"].read_bytes()
    path = tmp_path / "cut.bag"
    path.write_bytes(data[: len(data) // 2])
    status, captured = mapped(capsys, path, "-o", tmp_path / "out")
    assert status == 1
    assert "covers a part of the recording" in captured.err
    assert (tmp_path / "out/map.png").exists()
