# SPDX-License-Identifier: Apache-2.0
"""``python -m bench live`` measures every scan of a recording that is replayed in real time."""

from __future__ import annotations

import pytest

from bench.__main__ import run
from bench.record import read_record
from cartoloop.simulation import corridor, simulate

pytestmark = pytest.mark.slow


def test_latencies_of_a_replay_are_measured(tmp_path, capsys):
    log = tmp_path / "a.log"
    simulate(corridor(), seed=1, duration=60.0).write_carmen(log)

    status = run(["live", str(log), "--paces", "8,16", "--seconds", "1", "-o", str(tmp_path)])

    assert status == 0, capsys.readouterr().err
    rows = read_record(tmp_path / "live.json").rows
    assert [row.case["times real time"] for row in rows] == [8.0, 16.0]
    for row, scans in zip(rows, (41, 81), strict=True):
        figures = {name: figure.value for name, figure in row.figures.items()}
        assert 0 <= scans - figures["scans"] <= 2
        assert figures["without a pose"] < figures["scans"]  # most on a busy machine
        assert 0.0 < figures["median latency"] <= figures["99% within"] <= figures["longest"]
        assert 0.0 < figures["CPU until the pose, 99% within"] <= figures["longest"]
        assert figures["nodes"] > 10
        assert figures["dropped"] == 0
        assert figures["closures join within"] >= 0.0
    assert "median latency [ms]" in capsys.readouterr().out


def test_invalid_paces_are_refused(tmp_path, capsys):
    for paces in ("fast", "0", ""):
        assert run(["live", "--paces", paces, "-o", str(tmp_path)]) == 2
        assert "--paces" in capsys.readouterr().err
