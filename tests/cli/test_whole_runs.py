# SPDX-License-Identifier: Apache-2.0
"""Whole runs of the command line: the same bytes for any number of threads, the demo, Ctrl-C."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys

import numpy as np
import pytest

from cartoloop.cli.main import run
from cartoloop.simulation import office, simulate
from tests.limits import LIMIT_S

pytestmark = pytest.mark.slow

REPORT_KEYS = {
    "input": {"name", "scans", "duration_s", "path_length_m"},
    "wall_s": None,
    "cpu_s": None,
    "peak_memory_mb": None,
    "real_time_factor": None,
    "nodes": None,
    "submaps": None,
    "constraints": {"intra_submap", "loop_closure", "searched", "precision"},
    "adjustment": {"runs", "mean_iterations", "mean_ms", "last_ms"},
    "stages": None,
    "skipped": None,
    "quality": {"verdict", "places", "figures"},
    "version": None,
    "config_hash": None,
    "finished": None,
}
"""The stable keys of ``report.json``, and those below them."""

FREQUENT_PROGRESS = """
from cartoloop.cli import main, progress

progress._LINE_PERIOD_S = 0.1
main.main()
"""
"""The command line, with a line of progress every tenth of a second."""

MEASURED = {"wall_s", "cpu_s", "peak_memory_mb", "real_time_factor"}
MEASURED_BELOW = {"ms", "mean_ms", "last_ms", "total_s", "median_ms", "p99_ms"}
"""Times and memory: what may differ between two runs."""


@pytest.fixture(scope="module")
def ring_map(ring_log, tmp_path_factory):
    out = tmp_path_factory.mktemp("one-thread")
    assert run(["map", str(ring_log), "-o", str(out), "--threads", "1"]) == 0
    return out


def without_times(report):
    """What of a report has to be the same in each run."""

    def strip(value):
        if isinstance(value, list):
            return [strip(below) for below in value]
        if not isinstance(value, dict):
            return value
        return {key: strip(below) for key, below in value.items() if key not in MEASURED_BELOW}

    return {key: strip(value) for key, value in report.items() if key not in MEASURED}


def files_of(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def test_one_and_four_threads_give_the_same_bytes(ring_log, ring_map):
    out = ring_log.parent / "four-threads"
    command = [sys.executable, "-m", "cartoloop", "map", str(ring_log), "-o", str(out)]
    subprocess.run(
        [*command, "--threads", "4"],
        env=os.environ | {"PYTHONHASHSEED": "11"},
        capture_output=True,
        check=True,
    )

    first, second = files_of(ring_map), files_of(out)
    reports = [json.loads(files.pop("report.json")) for files in (first, second)]
    assert [name for name in first if first[name] != second.get(name)] == []
    assert first.keys() == second.keys()
    assert without_times(reports[0]) == without_times(reports[1])
    assert reports[0]["constraints"]["loop_closure"] > 10


def test_the_report_has_its_keys_and_they_make_sense(ring_map):
    report = json.loads((ring_map / "report.json").read_text())

    assert report.keys() >= REPORT_KEYS.keys()
    for key, below in REPORT_KEYS.items():
        assert below is None or report[key].keys() >= below
    assert report["input"]["name"] == "ring.log.gz"
    assert report["input"]["scans"] == 626
    assert report["input"]["duration_s"] == pytest.approx(125.0)
    assert 110.0 < report["input"]["path_length_m"] < 125.0
    assert report["real_time_factor"] == pytest.approx(125.0 / report["wall_s"])
    assert 0.0 < report["wall_s"] < 300.0
    assert 30.0 < report["peak_memory_mb"] < 4000.0
    assert 0 < report["submaps"] < report["nodes"] <= 626
    assert report["nodes"] <= report["constraints"]["intra_submap"] <= 2 * report["nodes"]
    assert 0 < report["constraints"]["found"] <= report["constraints"]["searched"]
    assert report["constraints"]["precision"] > 0.9
    assert report["adjustment"]["runs"] >= 2
    assert report["adjustment"]["mean_iterations"] >= 1.0
    assert {"filter", "match", "insert", "search", "adjust"} <= report["stages"].keys()
    for stage in report["stages"].values():
        assert stage["calls"] >= 1
        assert 0.0 <= stage["median_ms"] <= stage["p99_ms"] <= 1e3 * stage["total_s"] + 1e-6
    assert report["skipped"] == {}
    assert report["finished"] is True
    assert len(report["config_hash"]) >= 8


def test_maps_can_be_drawn_with_all_layers_and_evaluated(ring_log, ring_drive, tmp_path, capsys):
    relations = tmp_path / "ring.relations"
    ring_drive.write_relations(relations)

    assert run(["map", str(ring_log), "-o", str(tmp_path), "--draw", "trajectory,closures"]) == 0
    trajectory = str(tmp_path / "trajectory.tum")
    assert run(["evaluate", "relations", trajectory, str(relations), "--json"]) == 0

    output = capsys.readouterr().out
    error = json.loads(output[output.index("{") :])
    assert error["num_missing"] == 0
    assert error["absolute_translational"]["mean"] < 0.1
    assert error["absolute_rotational_deg"]["mean"] < 0.3


def test_the_demo_maps_an_office_and_names_the_picture(tmp_path, capsys, monkeypatch):
    def short(world, seed):
        return simulate(world, seed=seed, duration=40.0)

    monkeypatch.setattr("cartoloop.simulation.simulate", short)

    assert run(["demo", "-o", str(tmp_path / "demo")]) == 0

    output = capsys.readouterr().out
    error_m = float(output.rpartition("error")[2].split()[0])
    assert error_m < 0.05
    assert str(tmp_path / "demo" / "map.png") in output
    assert (tmp_path / "demo" / "map.png").stat().st_size > 10_000


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no such signal")
def test_ctrl_c_in_the_middle_keeps_what_was_mapped(tmp_path):
    log, out = tmp_path / "office.log.gz", tmp_path / "out"
    simulate(office(), seed=1).write_carmen(log)

    command = [sys.executable, "-c", FREQUENT_PROGRESS, "map", str(log), "-o", str(out)]
    process = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, bufsize=1
    )
    while not re.match(r"[1-9]\d* of \d+ scans", process.stderr.readline()):
        assert process.poll() is None
    process.send_signal(signal.SIGINT)
    output, error = process.communicate(timeout=LIMIT_S)

    assert process.returncode == 130
    assert "Traceback" not in error
    assert error.splitlines()[-1].startswith("cartoloop: stopped after")
    assert str(out / "map.png") in output
    assert (out / "map.png").stat().st_size > 1000
    num_poses = len(np.loadtxt(out / "trajectory.tum", ndmin=2))
    report = json.loads((out / "report.json").read_text())
    assert 0 < num_poses == report["input"]["scans"] < 2062
