# SPDX-License-Identifier: Apache-2.0
"""The examples run and do what they say."""

from __future__ import annotations

import importlib.util
import math
import re
import subprocess
import sys
from pathlib import Path

import numpy as np

from cartoloop.sensor.events import LaserScan
from cartoloop.simulation import corridor, simulate
from cartoloop.simulation.lidar import Lidar

EXAMPLES = Path(__file__).parents[1] / "examples"


def load(name):
    spec = importlib.util.spec_from_file_location(name, EXAMPLES / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_every_example_is_tested():
    tested = {"map_a_recording", "feed_your_own_scans", "own_reader", "send_scans"}
    assert {path.stem for path in EXAMPLES.glob("*.py")} == tested


def test_map_a_recording(tmp_path):
    simulate(corridor(), seed=1, duration=10.0).write_carmen(tmp_path / "a.log")

    load("map_a_recording").main(str(tmp_path / "a.log"), str(tmp_path / "out"))

    assert (tmp_path / "out" / "map.pgm").stat().st_size > 1000
    assert len((tmp_path / "out" / "trajectory.tum").read_text().splitlines()) == 51 + 1


def test_feed_your_own_scans(capsys):
    error = load("feed_your_own_scans").main()

    assert error < 0.05
    assert "200 scans mapped" in capsys.readouterr().out


def test_own_reader(tmp_path, capsys):
    lidar = Lidar(num_beams=120, angle_min=0.0, angle_increment=math.radians(3.0), no_return=30.0)
    drive = simulate(corridor(), lidar, seed=1, duration=10.0)
    with (tmp_path / "my.log").open("w") as file:
        for k, scan in enumerate(e for e in drive.events() if isinstance(e, LaserScan)):
            ranges = np.where(scan.ranges < 30.0, scan.ranges, 0.0)
            x, y, theta = drive.true_poses[k]
            pose = f"{1e3 * x:.0f} {1e3 * y:.0f} {math.degrees(theta):.1f}"
            numbers = " ".join(f"{100 * r:.0f}" for r in ranges)
            print(f"SCAN {1e3 * scan.stamp:.0f} | {pose} | {numbers}", file=file)
        print("SCAN 99999 | here", file=file)

    load("own_reader").main(str(tmp_path / "my.log"), str(tmp_path / "out"))

    assert (tmp_path / "out" / "map.png").exists()
    assert "skipped: {'damaged line': 1}" in capsys.readouterr().out


def test_send_scans(tmp_path):
    command = subprocess.Popen(
        [
            sys.executable,
            "-m",
            "cartoloop",
            "live",
            "tcp://127.0.0.1:0",
            "--no-drop",
            "-o",
            str(tmp_path),
        ],
        stderr=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        messages = iter(command.stderr.readline, "")
        port = next(m[1] for line in messages if (m := re.search(r"127\.0\.0\.1:(\d+) ", line)))
        load("send_scans").main(int(port))
        out, _ = command.communicate(timeout=60.0)
    finally:
        command.kill()
        command.communicate()

    assert "100 scans" in out
    end = (tmp_path / "trajectory.tum").read_text().splitlines()[-1].split()
    assert np.hypot(float(end[1]) - 2.97, float(end[2]) - 0.99) < 0.05
