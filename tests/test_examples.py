# SPDX-License-Identifier: Apache-2.0
"""The examples run and do what they say."""

from __future__ import annotations

import importlib.util
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
    tested = {"map_a_recording", "feed_your_own_scans", "own_reader", "send_scans"}
    assert {path.stem for path in EXAMPLES.glob("*.py")} == tested


def test_map_a_recording(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    load("map_a_recording").main()

    assert "301 scans mapped" in capsys.readouterr().out
    assert (tmp_path / "example-map" / "map.pgm").stat().st_size > 1000
    lines = (tmp_path / "example-map" / "trajectory.tum").read_text().splitlines()
    assert len(lines) == 301 + 1


def test_feed_your_own_scans(capsys):
    error = load("feed_your_own_scans").main()

    assert error < 0.05
    assert "200 scans mapped" in capsys.readouterr().out


def test_own_reader(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    load("own_reader").main()

    assert (tmp_path / "example-map" / "map.png").exists()
    assert "51 scans mapped, skipped: {'damaged line': 1}" in capsys.readouterr().out


def test_send_scans(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    load("send_scans").main()

    lines = (tmp_path / "example-room" / "trajectory.tum").read_text().splitlines()
    end = lines[-1].split()
    assert len(lines) == 100 + 1
    assert np.hypot(float(end[1]) - 2.97, float(end[2]) - 0.99) < 0.05
