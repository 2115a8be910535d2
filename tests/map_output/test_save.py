# SPDX-License-Identifier: Apache-2.0
"""Saving a result: all files, whole, and the same bytes each time."""

from __future__ import annotations

import json
import os
import tomllib
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from cartoloop.config_file import load_config
from cartoloop.errors import OutputError
from cartoloop.global_slam.closures import Closures
from cartoloop.global_slam.graph_adjustment import AdjustmentRun
from cartoloop.global_slam.pose_graph import PoseGraph
from cartoloop.map_output.output_folder import prepare_folder
from cartoloop.map_output.save import save, write_file
from cartoloop.report import (
    AdjustmentSummary,
    ConstraintSummary,
    InputSummary,
    Report,
)
from cartoloop.runtime.process_memory import peak_memory_mb
from cartoloop.runtime.stage_timer import StageTimer
from tests.map_output.small_result import FILES, small_result


def contents(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def test_writes_every_file_and_leaves_nothing_else(tmp_path):
    small_result().save(tmp_path / "new" / "out")

    assert set(contents(tmp_path / "new" / "out")) == FILES


def test_files_do_not_depend_on_times_and_threads(tmp_path):
    threads = load_config(settings=["global_slam.num_threads=4"]).config
    save(small_result(wall_s=1.0), tmp_path / "a")
    save(small_result(threads, wall_s=2.0), tmp_path / "b")

    first, second = contents(tmp_path / "a"), contents(tmp_path / "b")
    reports = [json.loads(files.pop("report.json")) for files in (first, second)]

    assert first == second
    assert reports[0] | {"wall_s": 2.0} == reports[1]


def test_saves_over_what_is_there(tmp_path):
    save(small_result(), tmp_path)
    before = contents(tmp_path)
    (tmp_path / "map.yaml").write_text("old")

    save(small_result(), tmp_path)

    assert contents(tmp_path) == before


def test_the_saved_configuration_is_what_was_used(tmp_path):
    loaded = load_config(settings=["local_slam.submaps.num_range_data=7"])

    save(small_result(loaded.config), tmp_path, origins=loaded.origins)

    assert "(--set)" in (tmp_path / "config.toml").read_text()
    assert load_config(tmp_path / "config.toml").config == loaded.config


def test_layers_change_the_picture_only(tmp_path):
    save(small_result(), tmp_path / "a", layers=())
    save(small_result(), tmp_path / "b", layers=("trajectory", "closures"))

    first, second = contents(tmp_path / "a"), contents(tmp_path / "b")

    assert {name for name in first if first[name] != second[name]} == {"map.png"}
    with Image.open(tmp_path / "b" / "map.png") as picture:
        assert picture.mode == "RGB"


def test_the_report_has_its_keys_and_further_ones(tmp_path):
    timer = StageTimer()
    timer.record("match", 0.002)
    report = Report(
        input=InputSummary("a.log", 3, 0.4, 0.5),
        wall_s=0.1,
        cpu_s=0.1,
        peak_memory_mb=peak_memory_mb(),
        real_time_factor=4.0,
        nodes=2,
        submaps=1,
        constraints=ConstraintSummary(1, 1, 2, 1.0, 0, 4, 0.75),
        adjustment=AdjustmentSummary.of_runs(
            [AdjustmentRun(2, 1, 3, 2, ms=1.0), AdjustmentRun(2, 1, 4, 4, ms=2.0)]
        ),
        stages=timer.summary(),
        skipped={"no returns": 1},
        extra={"findings": ["the odometry is late"]},
    )

    save(replace(small_result(), report=report), tmp_path)
    saved = json.loads((tmp_path / "report.json").read_text())

    assert saved["input"] == {
        "name": "a.log", "scans": 3, "duration_s": 0.4, "path_length_m": 0.5,
    }  # fmt: skip
    assert saved["constraints"] == {
        "intra_submap": 1, "loop_closure": 1, "searched": 2, "precision": 1.0,
        "rejected": 0, "found": 4, "found_precision": 0.75,
        "fates": {}, "fates_of_searched": {}, "fates_of_found": {},
    }  # fmt: skip
    assert saved["adjustment"] == {
        "runs": 2, "mean_iterations": 3.0, "mean_ms": 1.5, "last_ms": 2.0,
        "each": [
            {"nodes": 2, "submaps": 1, "constraints": 3, "iterations": 2, "ms": 1.0},
            {"nodes": 2, "submaps": 1, "constraints": 4, "iterations": 4, "ms": 2.0},
        ],
    }  # fmt: skip
    assert set(saved["stages"]["match"]) == {"calls", "total_s", "median_ms", "p99_ms"}
    assert saved["skipped"] == {"no returns": 1}
    assert saved["findings"] == ["the odometry is late"]
    assert len(saved["config_hash"]) == 16
    assert {
        "wall_s",
        "cpu_s",
        "peak_memory_mb",
        "real_time_factor",
        "nodes",
        "submaps",
        "version",
    } < set(saved)


def test_the_report_is_completed_when_all_else_is_written(tmp_path):
    def complete(report):
        assert not (tmp_path / "report.json").exists()
        return replace(report, wall_s=9.0)

    report = save(small_result(), tmp_path, complete_report=complete)

    assert report.wall_s == 9.0
    assert json.loads((tmp_path / "report.json").read_text())["wall_s"] == 9.0


@pytest.mark.parametrize("name", ["file", "file/out"])
def test_a_folder_that_cannot_be_is_an_output_error(tmp_path, name):
    (tmp_path / "file").write_text("not a folder")

    with pytest.raises(OutputError, match="cannot write there"):
        prepare_folder(tmp_path / name)


@pytest.mark.skipif(
    not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root may write anywhere"
)
def test_a_folder_without_permission_is_an_output_error(tmp_path):
    tmp_path.chmod(0o500)

    with pytest.raises(OutputError, match="Permission denied"):
        prepare_folder(tmp_path)


def test_a_failed_write_keeps_what_was_there_and_leaves_no_rest(tmp_path, monkeypatch):
    path = tmp_path / "map.pgm"
    path.write_bytes(b"old")

    def no_space(self, target):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("pathlib.Path.replace", no_space)
    with pytest.raises(OutputError, match=r"map\.pgm: cannot be written: No space left"):
        write_file(path, b"new")

    assert contents(tmp_path) == {"map.pgm": b"old"}


def test_nothing_mapped_is_saved_all_the_same(tmp_path):
    empty = np.zeros((0, 3))
    result = replace(
        small_result(),
        stamps=np.zeros(0),
        trajectory=empty,
        local_trajectory=empty,
        graph=PoseGraph(),
        node_scan_index=np.zeros(0, np.int64),
        submap_grids=[],
        closures=Closures(),
    )

    save(result, tmp_path, layers=("trajectory", "closures"))

    assert set(contents(tmp_path)) == FILES
    assert tomllib.loads((tmp_path / "config.toml").read_text())
