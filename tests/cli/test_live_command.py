# SPDX-License-Identifier: Apache-2.0
"""``cartoloop live`` in a process of its own, as a robot and its operator use it."""

from __future__ import annotations

import json
import os
import re
import signal
import socket
import subprocess
import sys

import numpy as np
import pytest

from cartoloop.cli.main import run
from cartoloop.evaluation.trajectories import read_tum
from cartoloop.result import load_map
from tests.limits import LIMIT_S, wait_until
from tests.live.live_room import drive, lines

pytestmark = pytest.mark.slow

NUM_SCANS = 51


class Live:
    """The command while it runs."""

    def __init__(self, *arguments, **options):
        self.process = subprocess.Popen(
            [sys.executable, "-m", "cartoloop", "live", *map(str, arguments)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            env=os.environ | {"PYTHONUNBUFFERED": "1"},
            **options,
        )
        self.lines = []

    def wait_for(self, pattern):
        """Return the first match in a line that is shown from now on."""
        for raw in self.process.stderr:
            self.lines.append(raw.decode())
            if match := re.search(pattern, self.lines[-1]):
                return match
        raise AssertionError(f"never shown {pattern}: {self.lines}")

    def end(self):
        """Return output and exit status of the command, which ends by itself."""
        out, err = self.process.communicate(timeout=LIMIT_S)
        self.lines += err.decode().splitlines(keepends=True)
        return out.decode(), self.process.returncode

    @property
    def text(self):
        return "".join(self.lines)

    def address(self):
        match = self.wait_for(r"listening on \w+://(127.0.0.1):(\d+)")
        return match[1], int(match[2])


@pytest.fixture
def live():
    """Start the command; end it if a test does not."""
    started = []

    def start(*arguments, **options):
        started.append(Live(*arguments, **options))
        return started[-1]

    yield start
    for command in started:
        command.process.kill()
        command.process.communicate()


def error_of(path):
    """Return how far the furthest pose is off the truth [m]."""
    found, truth = read_tum(path), drive(10.0)
    offset = truth.true_poses[:, :2] - truth.true_poses[0, :2]
    turn = -truth.true_poses[0, 2]
    rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    return np.hypot(*(found.poses[:, :2] - offset @ rotation.T).T).max()


def test_a_recording_is_piped_in(live, tmp_path):
    command = live("-", "-o", tmp_path, "--no-drop", "--poses", "-")
    command.process.stdin.write(b"".join(lines()) + b"rubbish\n")
    out, status = command.end()

    assert status == 0, command.text
    poses = [json.loads(line) for line in out.splitlines()]
    stamps = read_tum(tmp_path / "trajectory.tum").stamps
    assert len(poses) == NUM_SCANS
    assert [pose["stamp"] for pose in poses] == pytest.approx(stamps.tolist(), abs=1e-6)
    assert set(poses[0]) == {"type", "stamp", "local", "map", "latency_ms"}
    assert error_of(tmp_path / "trajectory.tum") < 0.1
    report = json.loads((tmp_path / "report.json").read_text())
    assert report["input"]["name"] == "standard input"
    assert report["skipped"] == {"message skipped: no JSON": 1}
    assert "no return: 81.91 m" in command.text
    assert "receiving odometry" in command.text
    assert "Traceback" not in command.text


def test_a_robot_connects_leaves_comes_back_and_is_stopped(live, tmp_path):
    command = live("tcp://127.0.0.1:0", "-o", tmp_path, "--no-drop", "--poses", tmp_path / "poses")
    address = command.address()
    sent = lines()
    half = len(sent) // 2
    for part in (sent[:half], sent[half:]):
        with socket.create_connection(address) as robot:
            robot.sendall(b"".join(part))
        command.wait_for("disconnected, after")
    wait_until(lambda: (tmp_path / "poses").read_bytes().count(b"\n") == NUM_SCANS)
    command.process.send_signal(signal.SIGINT)
    out, status = command.end()

    assert status == 0, command.text
    assert f"{NUM_SCANS} scans" in out
    assert error_of(tmp_path / "trajectory.tum") < 0.1
    assert (tmp_path / "map.png").exists()


def test_a_killed_process_leaves_the_map(live, tmp_path):
    command = live("-", "-o", tmp_path)
    to_send = iter(lines(120.0))
    command.wait_for("reading messages")

    def has_saved_some():
        command.process.stdin.write(next(to_send, b""))
        command.process.stdin.flush()
        journal = tmp_path / "journal.cartoloop"
        is_begun = journal.exists() and journal.stat().st_size > 10_000
        return is_begun and load_map(tmp_path).graph.num_nodes > 5

    wait_until(has_saved_some, period_s=0.05)
    command.process.kill()
    command.end()

    result = load_map(tmp_path)
    assert len(result.stamps) > 10
    assert result.graph.num_nodes == len(result.node_scan_index) > 5
    assert not list(tmp_path.glob("report.json"))


def test_a_flood_is_survived_and_lost_scans_are_reported(live, tmp_path):
    command = live("-", "-o", tmp_path)
    command.wait_for("reading messages")
    for _ in range(3):
        command.process.stdin.write(b"".join(lines(40.0)))
    out, status = command.end()

    assert status == 0, command.text
    report = json.loads((tmp_path / "report.json").read_text())
    dropped = report["skipped"]["scans dropped: too many came"]
    assert dropped > 0
    assert re.search(r"scans dropped: too many came", command.text)
    assert f"{dropped} scans dropped" in out


def test_all_that_a_file_holds_already_is_mapped(live, tmp_path):
    path = tmp_path / "a.ndjson"
    path.write_bytes(b"".join(lines(120.0)) + b'{"type": "end"}\n')
    command = live(path, "-o", tmp_path / "map")
    _, status = command.end()

    assert status == 0, command.text
    report = json.loads((tmp_path / "map" / "report.json").read_text())
    assert report["skipped"] == {}
    assert len(load_map(tmp_path / "map").stamps) == 601


def test_a_silent_source_is_reported_and_ends_after_end_after(live, tmp_path):
    command = live("tcp://127.0.0.1:0", "-o", tmp_path, "--end-after", "5")
    with socket.create_connection(command.address()) as robot:
        robot.sendall(b"".join(lines()))
        command.wait_for("nothing has come for 2 s; waiting")
        command.wait_for("nothing has come for 5 s: the source has ended")
        _, status = command.end()

    assert status == 0


def test_a_source_that_sends_no_scan_is_an_error(live, tmp_path):
    command = live("-", "-o", tmp_path)
    command.process.stdin.write(b'{"type": "odometry", "x": 0, "y": 0, "theta": 0}\n' * 3)
    _, status = command.end()

    assert status == 1
    assert (
        "cartoloop: standard input: no scan with enough returns to be mapped has arrived"
        in command.text
    )
    assert (tmp_path / "report.json").exists()


def test_the_view_shows_a_live_map(live, tmp_path):
    from urllib.request import urlopen

    command = live(
        "tcp://127.0.0.1:0", "-o", tmp_path, "--view", "--view-port", "8950", "--poses", "-"
    )
    url = command.wait_for(r"view +(http://127.0.0.1:\d+)/")[1]
    with socket.create_connection(command.address()) as robot:
        robot.sendall(b"".join(lines()) + b'{"type": "end"}\n')
        command.wait_for("writing")
        assert urlopen(url, timeout=LIMIT_S).status == 200
    assert any(b"Ctrl-C ends" in line for line in command.process.stdout)
    assert (tmp_path / "report.json").exists()
    command.process.send_signal(signal.SIGINT)
    _, status = command.end()

    assert status == 0, command.text


@pytest.mark.parametrize(
    ("arguments", "status", "shown"),
    [
        (["tcp://0.0.0.0:7000"], 1, "allow it with --source-host 0.0.0.0"),
        (["nothing.log"], 1, "nothing.log: cannot be read"),
        (["-", "--view-port", "8000"], 2, "has no effect without --view"),
        (["-", "--poses", "no/such/folder"], 1, "--poses no/such/folder: cannot be written"),
    ],
)
def test_wrong_usage_is_reported_in_a_line(arguments, status, shown, tmp_path, capsys):
    assert run(["live", *arguments, "-o", str(tmp_path / "out")]) == status

    said = capsys.readouterr().err
    assert shown in said
    assert "Traceback" not in said


def test_what_is_no_map_to_be_added_to_is_named(tmp_path, capsys):
    log = tmp_path / "drive.log"
    log.write_text("FLASER 1 2.0\n")

    assert run(["live", "tcp://127.0.0.1:0", "--onto", str(log), "--end-after", "0.1"]) == 1
    assert f"{log}: is no map database" in " ".join(capsys.readouterr().err.split())
