# SPDX-License-Identifier: Apache-2.0
"""The tables and the runs of the benchmark ``robustness``."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest

from bench.__main__ import run
from bench.command_runs import run_command
from bench.robustness.benchmark import parts_named, rows
from bench.robustness.changes import change_of
from bench.robustness.parts import PARTS, RobustnessOptions, Runner, _calibration
from bench.robustness.runs import Run, RunStore
from bench.robustness.simulated_worlds import handicapped_worlds, simulated_worlds
from cartoloop.errors import ConfigError
from cartoloop.simulation import WORLDS


def test_the_table_of_worlds_names_worlds_and_bars():
    table = simulated_worlds()
    assert {world.options[0] for world in table.values()} == set(WORLDS)
    assert table["yard-sparse"].options == ("yard", "--scan-spacing", "1")
    assert (table["corridor"].bar, table["office"].bar) == (0.24, 0.1)
    assert table["wings"].seeds == 100
    handicapped = handicapped_worlds()["hall, no-closures"]
    assert handicapped.options == table["hall"].options
    assert handicapped.settings == ("global_slam.optimize_every_n_nodes=0",)


def test_names_of_parts_and_changes_are_checked():
    assert parts_named(["killian", "sparse"]) == ["mit-killian", "sparse recordings"]
    assert parts_named([]) == list(PARTS)
    with pytest.raises(ConfigError, match="'bremen'"):
        parts_named(["bremen"])
    with pytest.raises(ConfigError, match="'drop49'"):
        change_of("drop49")


def some_run(seed=0, error=0.2, verdict="-", **fields):
    figures = {"error": error, "bar": 0.1, "cpu": 3.0, "precision": 0.9}
    return Run("worlds", "ring", seed, ("a",), figures, verdict, commit="abc", **fields)


def test_runs_of_the_same_commit_are_found_again(tmp_path):
    path = tmp_path / "runs.jsonl"
    RunStore(path, "abc").add(some_run())
    assert RunStore(path, "abc").find("worlds", "ring", 0) == replace(some_run(), commands=["a"])
    assert RunStore(path, "abd").find("worlds", "ring", 0) is None
    assert RunStore(path, "abc with changes").find("worlds", "ring", 0) is None


def test_both_scanners_are_judged_by_each_alone():
    alone = [
        Run("two scanners", "a", 0, figures={"scale": scale, "yaw": yaw})
        for scale, yaw in ((1.00, 0.5), (1.02, 1.0))
    ]
    assert _calibration({"scale": 1.01, "yaw": 0.7}, alone) == {"calibration": 0.0}
    assert _calibration({"scale": 1.05, "yaw": 0.4}, alone)["calibration"] == pytest.approx(1.5)
    assert _calibration({"scale": 1.05}, alone) == {}
    both = Run("two scanners", "b", 0, figures={"calibration": 1.5})
    assert both.is_right is False
    assert alone[0].is_right is None


def test_a_row_counts_right_runs_and_names_wrong_seeds():
    runs = [
        some_run(0, 0.05, "good"),
        some_run(1, 0.07, "good"),
        some_run(2, 0.5, "wrong"),
        Run("worlds", "ring", 3, failure="ended with status 1"),
    ]
    ring, right, wrong = rows(runs)
    figures = {name: figure.value for name, figure in ring.figures.items()}
    assert (figures["runs"], figures["right"]) == (4, 2)
    assert (figures["error"], figures["largest error"], figures["bar"]) == (0.07, 0.5, 0.1)
    assert figures["precision of found"] == pytest.approx(90.0)
    assert ring.notes == ("verdict good: 2, wrong: 1; wrong seeds 2; seed 3: ended with status 1")
    assert (right.figures["flagged"].value, wrong.figures["flagged"].value) == (0.0, 100.0)


def test_runs_that_are_there_are_not_made_again(tmp_path):
    store = RunStore(tmp_path / "runs.jsonl", "abc")
    known = [
        Run("aces", name, seed, figures={"error": 0.01, "bar": 0.05}, commit="abc")
        for name, seed in (("unchanged", 0), ("mirror", 0), ("missing10", 0), ("missing10", 1))
    ]
    for one in known:
        store.add(one)
    options = RobustnessOptions(
        tmp_path, tmp_path, ["aces"], ["mirror", "missing10"], relations=tmp_path
    )
    (tmp_path / "aces.relations").touch()
    assert list(Runner(options, store, "abc", print).run()) == known


@pytest.mark.slow
def test_a_recording_that_is_not_there_is_a_row_with_the_reason(tmp_path):
    options = RobustnessOptions(tmp_path, tmp_path, ["aces"], ["mirror"])
    store = RunStore(tmp_path / "runs.jsonl", "abc")
    runs = list(Runner(options, store, "abc", print).run())
    assert [one.case for one in runs] == ["unchanged", "mirror"]
    assert all("radish/aces.clf.gz is not in the data folder" in one.failure for one in runs)


@pytest.mark.slow
def test_the_benchmark_writes_runs_and_a_record(tmp_path, capsys, monkeypatch):
    worlds = simulated_worlds()
    short = replace(worlds["ring"], options=("ring", "--duration", "30"))
    monkeypatch.setitem(worlds, "ring", short)
    warmed_up = []

    def run_all_but_the_demo(*words):
        if words[0] == "demo":
            return warmed_up.append(words)
        return run_command(*words)

    monkeypatch.setattr("bench.robustness.parts.run_command", run_all_but_the_demo)
    command = ["robustness", "--only", "worlds", "--worlds", "ring", "--seeds", "1"]
    assert run([*command, "-o", str(tmp_path)]) == 0
    assert len(warmed_up) == 1
    assert "| ring " in capsys.readouterr().out
    lines = (tmp_path / "robustness" / "runs.jsonl").read_text().splitlines()
    assert len(lines) == 1
    kept = json.loads(lines[0])
    assert kept["commands"][0].startswith("cartoloop simulate ring --duration 30 --seed 0 -o ")
    assert kept["commands"][1].startswith("cartoloop map ")
    record = json.loads((tmp_path / "robustness.json").read_text())
    assert record["rows"][0]["figures"]["error"]["value"] == kept["figures"]["error"]
