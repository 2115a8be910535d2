# SPDX-License-Identifier: Apache-2.0
import json

from cartoloop.cli.main import run
from cartoloop.result import load_map
from cartoloop.simulation import make_world, simulate


def test_lifelong_without_a_map_is_refused(tmp_path, capsys):
    assert run(["map", str(tmp_path / "a.log"), "--lifelong"]) == 2
    assert "--onto" in capsys.readouterr().err


def test_a_drive_that_is_seen_again_gives_way(tmp_path, capsys):
    log, again = tmp_path / "office.log", tmp_path / "again.log"
    first, both = tmp_path / "first", tmp_path / "both"
    for seed, path in enumerate((log, again)):
        simulate(make_world("ring"), seed=seed, duration=60.0).write_log(path)
    assert run(["map", str(log), "-o", str(first)]) == 0
    assert run(["map", str(again), "--onto", str(first), "--lifelong", "-o", str(both)]) == 0
    captured = capsys.readouterr()
    assert "submaps and" in captured.out.partition("seen again")[2]
    assert "in it twice" not in captured.err
    report = json.loads((both / "report.json").read_text())
    assert report["lifelong"]["removed_submaps"] > 0
    result = load_map(both)
    assert result.config.lifelong.enabled
    assert result.graph.num_submaps < 1.5 * load_map(first).graph.num_submaps


def test_the_same_recording_again_is_noted(tmp_path, capsys):
    log, first = tmp_path / "office.log", tmp_path / "first"
    simulate(make_world("office"), seed=1, duration=20.0).write_log(log)
    assert run(["map", str(log), "-o", str(first)]) == 0
    run(["map", str(log), "--onto", str(first), "-o", str(tmp_path / "both")])
    assert "office.log is in the map already" in capsys.readouterr().err
    run(["merge", str(first), str(tmp_path / "both"), "-o", str(tmp_path / "merged")])
    captured = capsys.readouterr()
    assert "office.log is in" in captured.out + captured.err
