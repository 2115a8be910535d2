# SPDX-License-Identifier: Apache-2.0
"""``python -m bench viewer`` measures the cost and the latency of the live view."""

from __future__ import annotations

import pytest

from bench.__main__ import run
from bench.record import Figure, Record, Row, read_record
from bench.view.benchmark import misses
from cartoloop.simulation import ring, simulate

pytestmark = pytest.mark.slow


def test_every_figure_with_a_target_is_measured(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("bench.view.page.PAN_S", 0.5)
    log = tmp_path / "ring.log"
    simulate(ring(), seed=1, duration=115.0).write_carmen(log)

    status = run(["viewer", str(log), "--pace", "200", "--repeat", "1", "-o", str(tmp_path)])

    assert status == 0, capsys.readouterr().err
    rows = read_record(tmp_path / "viewer.json").rows
    finished, shown, one, ten, heard, seen = rows
    assert [row.case.get("viewers") for row in rows] == [None, None, 1, 10, None, None]
    for row in (one, ten):
        assert row.figures["sent to each"].value > finished.figures["sent"].value > 0.05
        assert row.figures["CPU more"].value > -90.0
        assert row.figures["CPU without a view"].value > 0.0
    assert 0.0 < heard.figures["seen after"].value < 20.0
    assert heard.figures["times closures were found"].value >= 1
    if "Chromium" in shown.notes or "playwright" in shown.notes:
        assert not shown.figures and not seen.figures
    else:
        assert 0.0 < shown.figures["first full picture"].value <= shown.figures["sharp"].value
        assert shown.figures["frames a second, panning"].value > 1.0
        assert abs(shown.figures["sent"].value - finished.figures["sent"].value) < 0.01
        assert 0.0 < seen.figures["seen after"].value < 20.0


def test_without_a_browser_the_rest_is_measured(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("shutil.which", lambda name: None)
    log = tmp_path / "ring.log"
    simulate(ring(), seed=1, duration=20.0).write_carmen(log)

    status = run(
        [
            "viewer", str(log), "--pace", "200", "--repeat", "1", "-o", str(tmp_path),
            "--strict",
        ]
    )  # fmt: skip

    assert status == 1
    assert "no Chromium is installed" in capsys.readouterr().out
    rows = read_record(tmp_path / "viewer.json").rows
    assert [bool(row.figures) for row in rows] == [True, False, True, True, False, False]


def test_figures_that_miss_their_target_are_listed():
    rows = (
        Row({"page": "a"}, {"sent": Figure(20.0, "MB"), "all sent after": Figure(9.0, "s")}),
        Row({"page": "b"}, {"frames a second, panning": Figure(29.0, better="more")}),
        Row({"page": "c"}, {"seen after": Figure(0.5, "s"), "CPU more": Figure(-3.0, "%")}),
    )

    missed = misses(Record("viewer", rows))

    assert [line.split(":")[0] for line in missed] == ["a", "b"]
    assert missed[0].startswith("a: sent 20 MB")
