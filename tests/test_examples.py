# SPDX-License-Identifier: Apache-2.0
"""The examples run and do what they say."""

from __future__ import annotations

import importlib.util
from pathlib import Path

from cartoloop.simulation import corridor, simulate

EXAMPLES = Path(__file__).parents[1] / "examples"


def load(name):
    spec = importlib.util.spec_from_file_location(name, EXAMPLES / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_every_example_is_tested():
    tested = {"map_a_recording", "feed_your_own_scans"}
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
