# SPDX-License-Identifier: Apache-2.0
import gzip
import json

import numpy as np
import pytest

from cartoloop.cli.main import run
from cartoloop.simulation import LIDARS, WORLDS
from cartoloop.simulation.odometry_faults import OdometryFault


def tags_of(log):
    """The first words of the lines that are neither comments nor parameters."""
    words = [line.split(maxsplit=1)[0] for line in log.read_text().splitlines()]
    return {word for word in words if word not in ("#", "PARAM")}


@pytest.mark.parametrize(
    ("arguments", "tag"),
    [
        (["ring"], "FLASER"),
        (["ring", "--no-odometry"], "RAWLASER1"),
        (["ring", "--lidar", "backpack"], "ROBOTLASER1"),
        (["flat"], "RAWLASER1"),
        (["flat", "--odometry"], "ROBOTLASER1"),
        (["museum"], "RAWLASER1"),
        (["yard", "--people", "2", "--glass", "0.1"], "FLASER"),
    ],
)
def test_logs_hold_what_the_world_or_the_user_says(tmp_path, arguments, tag):
    log = tmp_path / "a.log"
    assert run(["simulate", *arguments, "--duration", "1", "-o", str(log)]) == 0
    assert tags_of(log) == {tag}


def test_range_noise_replaces_that_of_the_scanner(tmp_path):
    ranges = []
    for noise in ("0", "0.05"):
        log = tmp_path / f"{noise}.log"
        options = ["--range-noise", noise, "--duration", "2", "-o", str(log)]
        assert run(["simulate", "ring", *options]) == 0
        scans = [line.split() for line in log.read_text().splitlines() if line[0] == "F"]
        ranges.append(np.array([scan[2 : 2 + int(scan[1])] for scan in scans], dtype=float))
    assert np.std(ranges[1] - ranges[0]) == pytest.approx(0.05, rel=0.1)


def test_truth_relations_and_lines_lie_beside_the_log(tmp_path, capsys):
    files = {name: tmp_path / name for name in ("log", "truth", "relations", "lines")}
    beside = [f"--{name}={files[name]}" for name in ("truth", "relations", "lines")]
    assert run(["simulate", "flat", "-o", f"{files['log']}.clf", *beside, "--duration", "30"]) == 0
    assert capsys.readouterr().out.startswith("61 scans, 30 s: ")
    assert len(np.loadtxt(files["truth"])) == 61
    assert np.loadtxt(files["lines"]).shape == (7, 5)
    assert files["relations"].exists()


def test_a_recording_without_odometry_is_mapped(tmp_path):
    log, out = tmp_path / "office.log", tmp_path / "out"
    arguments = ["--no-odometry", "--lidar", "wide", "--duration", "8", "-o", str(log)]
    truth = tmp_path / "truth.tum"
    assert run(["simulate", "office", *arguments, "--truth", str(truth)]) == 0
    assert run(["map", str(log), "-o", str(out)]) == 0
    assert json.loads((out / "report.json").read_text())["skipped"] == {}
    mapped, true = np.loadtxt(out / "trajectory.tum"), np.loadtxt(truth)
    travelled = np.hypot(*(true[-1, 1:3] - true[0, 1:3]))
    assert np.hypot(*mapped[-1, 1:3]) == pytest.approx(travelled, abs=0.1)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["ring", "--lidar", "sik"], "nearest: sick"),
        (["ring", "--range-noise", "nan"], "must be 0 or more"),
        (["ring", "--range-noise=-0.1"], "must be 0 or more"),
        (["ring", "--lines", "x.lines"], "has no tape lines"),
        (["ring", "--duration=-1"], "not negative"),
        (["ring", "--glass", "2"], "give 0 to 1"),
        (["ring", "--drive", "2"], "later drives are through office"),
        (["ring", "--pause", "500"], "too short"),
        (["ring", "--odometry-fault", "froze"], "nearest: frozen"),
        (["ring", "--two-scanners"], "needs a bag"),
        (["ring", "--clock-offset", "0.1"], "add --two-scanners"),
        (["ring", "-o", "a.bag", "--people", "1", "--tilt-deg", "5"], "level scanners"),
        (["ring", "--duration", "nan"], "must be finite"),
        (["ring", "--truth", "./a.log"], "a.log: cannot hold two outputs"),
        (["ring", "-o", "a.mcap"], "a.mcap: no simulated recording has this format"),
    ],
)
def test_impossible_options_are_refused_before_writing(
    tmp_path, monkeypatch, capsys, arguments, message
):
    monkeypatch.chdir(tmp_path)
    assert run(["simulate", "-o", "a.log", *arguments]) == 2
    assert message in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_a_later_drive_is_a_day_later(tmp_path):
    truths = [tmp_path / f"{drive}.tum" for drive in (1, 2)]
    for drive, truth in enumerate(truths, 1):
        options = ["--drive", str(drive), "--duration", "1", "--truth", str(truth)]
        assert run(["simulate", "office", *options, "-o", str(tmp_path / f"{drive}.log")]) == 0
    first, second = map(np.loadtxt, truths)
    assert second[0, 0] - first[0, 0] == 86_400.0
    assert not np.allclose(second[0, 1:3], first[0, 1:3], atol=1.0)


def test_a_slow_robot_drives_at_the_speed_given(tmp_path):
    log, truth = tmp_path / "a.log", tmp_path / "a.tum"
    options = ["--speed", "0.2", "--duration", "10", "--truth", str(truth), "-o", str(log)]
    assert run(["simulate", "office", *options]) == 0
    poses = np.loadtxt(truth)
    steps = np.hypot(*np.diff(poses[:, 1:3], axis=0).T) / np.diff(poses[:, 0])
    assert steps.max() == pytest.approx(0.2, abs=1e-3)


def test_sparse_scans_leave_odometry_between_them(tmp_path):
    log = tmp_path / "a.log"
    options = ["--scan-spacing", "1", "--odometry-fault", "frozen", "--duration", "20"]
    assert run(["simulate", "ring", *options, "-o", str(log)]) == 0
    assert tags_of(log) == {"FLASER", "ODOM"}
    lines = log.read_text().splitlines()
    assert sum(line.startswith(("FLASER", "ODOM")) for line in lines) == 101
    readings = {tuple(line.split()[1:4]) for line in lines if line.startswith("ODOM")}
    assert readings == {("0.000000", "0.000000", "0.000000")}


def test_the_help_names_all_worlds_and_scanners(capsys):
    assert run(["simulate", "--help"]) == 0
    words = {word.strip(".,;") for word in capsys.readouterr().out.split()}
    assert set(WORLDS) | set(LIDARS) | set(OdometryFault) <= words


@pytest.mark.parametrize("name", ["a.log.gz", "A.CLF.GZ"])
def test_an_ending_of_gz_means_compressed(tmp_path, name):
    assert run(["simulate", "ring", "-o", str(tmp_path / name), "--duration", "1"]) == 0
    assert gzip.decompress((tmp_path / name).read_bytes()).startswith(b"#")
