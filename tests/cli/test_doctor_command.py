# SPDX-License-Identifier: Apache-2.0
"""The command doctor: text for people, JSON for programs, an exit status for scripts."""

import json

import pytest

from cartoloop.cli.main import run
from cartoloop.simulation import ring, simulate


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    path = tmp_path_factory.mktemp("doctor") / "drive.log"
    simulate(ring(), seed=2, duration=20.0).write_carmen(path)
    return path


def test_text(log, capsys):
    assert run(["doctor", str(log)]) == 0
    out = capsys.readouterr().out
    headings = [line.split()[0] for line in out.splitlines() if line and line[0] != " "]
    assert headings == ["drive.log", "contents", "scanner", "odometry", "mapped", "findings:", "it"]
    assert "101 scans, 20.0 s" in out
    assert max(map(len, out.splitlines()[:-1])) <= 110
    assert "\x1b" not in out


def test_json_of_several(log, tmp_path, capsys):
    (tmp_path / "none.log").write_text("nothing\n")
    assert run(["doctor", "--json", str(log), str(tmp_path / "none.log")]) == 1
    shown = json.loads(capsys.readouterr().out)
    assert shown["can_be_mapped"] is False
    assert [r["can_be_mapped"] for r in shown["recordings"]] == [True, False]
    assert shown["recordings"][0]["num_scans"] == 101
    assert shown["recordings"][1]["findings"][0]["code"] == "cannot_be_mapped"


def test_an_unknown_topic_is_reported_without_a_traceback(log, capsys):
    assert run(["doctor", "--scan-topic", "/scan", str(log)]) == 1
    captured = capsys.readouterr()
    assert "means nothing here" in captured.out
    assert "Traceback" not in captured.err
