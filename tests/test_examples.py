# SPDX-License-Identifier: Apache-2.0
"""The examples run and do what they say."""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

pytestmark = pytest.mark.slow

EXAMPLES = Path(__file__).parents[1] / "examples"


def load(name):
    spec = importlib.util.spec_from_file_location(name, EXAMPLES / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_every_example_is_tested():
    tested = {
        "map_a_recording",
        "edit_a_map",
        "feed_your_own_scans",
        "own_reader",
        "send_scans",
        "locate_a_robot",
        "report_changes",
    }
    tested |= {"continue_a_map", "merge_maps", "refresh_a_map"}
    assert {path.stem for path in EXAMPLES.glob("*.py")} == tested


def test_map_a_recording(tmp_path, monkeypatch, capsys):
    assert "301 scans mapped" in run("map_a_recording", cwd=tmp_path).stdout
    monkeypatch.chdir(tmp_path)
    load("map_a_recording").main()

    assert "301 scans mapped" in capsys.readouterr().out
    assert (tmp_path / "example-ring" / "map.pgm").stat().st_size > 1000
    lines = (tmp_path / "example-ring" / "trajectory.tum").read_text().splitlines()
    assert len(lines) == 301 + 1


def test_edit_a_map(tmp_path, monkeypatch, capsys):
    assert "4 edits: example-edited/map.png" in run("edit_a_map", cwd=tmp_path).stdout
    monkeypatch.chdir(tmp_path)
    result = load("edit_a_map").main()

    assert [edit.is_undone for edit in result.edits] == [False, False, True, False]
    assert result.graph.num_loop_closures == result.original.graph.num_loop_closures
    assert "residuals: root mean square" in capsys.readouterr().out


def test_locate_a_robot(capsys):
    assert load("locate_a_robot").main() < 0.15
    assert "located" in capsys.readouterr().out


def test_report_changes(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    kinds = load("report_changes").main()

    assert set(kinds) == {"appeared", "disappeared"}
    assert "updated: example-changes/map" in capsys.readouterr().out
    assert (tmp_path / "example-changes" / "changes.png").exists()


def test_feed_your_own_scans(tmp_path, monkeypatch, capsys):
    runs_as_it_stands("feed_your_own_scans", "200 scans mapped", tmp_path)
    monkeypatch.chdir(tmp_path)
    error = load("feed_your_own_scans").main()

    assert error < 0.05
    assert "200 scans mapped" in capsys.readouterr().out


def test_own_reader(tmp_path, monkeypatch, capsys):
    runs_as_it_stands("own_reader", "51 scans mapped", tmp_path)
    monkeypatch.chdir(tmp_path)
    load("own_reader").main()

    assert (tmp_path / "example-corridor" / "map.png").exists()
    assert "51 scans mapped, skipped: {'damaged line': 1}" in capsys.readouterr().out


def test_send_scans(tmp_path, monkeypatch):
    runs_as_it_stands("send_scans", "100 scans", tmp_path)
    monkeypatch.chdir(tmp_path)
    load("send_scans").main()

    lines = (tmp_path / "example-room" / "trajectory.tum").read_text().splitlines()
    end = lines[-1].split()
    assert len(lines) == 100 + 1
    assert np.hypot(float(end[1]) - 2.97, float(end[2]) - 0.99) < 0.05


def run(name, *arguments, cwd):
    """Return what a program of `examples/` did that was started as a user starts it."""
    return subprocess.run(
        [sys.executable, str(EXAMPLES / f"{name}.py"), *arguments],
        cwd=cwd,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
        capture_output=True,
        text=True,
        check=False,
    )


def runs_as_it_stands(name, says, folder):
    """Run a program; what it writes does not stop it from running again."""
    done = run(name, cwd=folder)

    assert done.returncode == 0, done.stderr
    assert says in done.stdout
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("merge_maps", "2 of 2 sessions in one map"),
        ("continue_a_map", "session 2 found its place"),
        ("refresh_a_map", "submaps gave way"),
    ],
)
def test_examples_of_several_drives_run_again(name, says, tmp_path, monkeypatch, capsys):
    runs_as_it_stands(name, says, tmp_path)

    monkeypatch.chdir(tmp_path)
    load(name).main()
    assert says in capsys.readouterr().out


@pytest.mark.parametrize(
    ("name", "argument", "says"),
    [
        ("map_a_recording", "none.log", "none.log: does not exist; check the path"),
        ("own_reader", "none.log", "none.log: does not exist; check the path"),
        ("edit_a_map", "none", "none: has no map.cartoloop"),
        ("send_scans", "1", "first start `cartoloop live tcp://127.0.0.1:1 -o room`"),
        ("send_scans", "70000", "port 70000: "),
    ],
)
def test_what_examples_cannot_use_is_one_line(name, argument, says, tmp_path):
    done = run(name, argument, cwd=tmp_path)

    assert done.returncode == 1
    assert says in done.stderr
    assert done.stderr.count("\n") == 1
    assert list(tmp_path.iterdir()) == []
