# SPDX-License-Identifier: Apache-2.0
"""``cartoloop quality``, and ``--strict``, on maps made by hand."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest
import typer

from cartoloop.cli.main import run
from cartoloop.cli.mapping import DOUBTFUL_STATUS, require_good, summary
from cartoloop.cli.quality_command import text
from cartoloop.quality.verdict import Kind, Place, Quality, Severity
from cartoloop.report import Report
from tests.map_output.small_result import small_result

PLACE = Place(
    1.5, -2.0, 3.0, 100.0, 120.5, Kind.GAP, Severity.DOUBTFUL, "a gap", "record without gaps"
)


def test_only_good_maps_pass_a_strict_run():
    doubtful = Report(quality=Quality("doubtful", (PLACE,)))

    require_good(Report(quality=Quality("good")), strict=True)
    require_good(doubtful, strict=False)
    for report in (doubtful, Report(quality=Quality("wrong")), Report()):
        with pytest.raises(typer.Exit) as end:
            require_good(report, strict=True)
        assert end.value.exit_code == DOUBTFUL_STATUS == 3


def test_the_summary_of_a_run_has_the_verdict(tmp_path):
    lines = summary(Report(quality=Quality("doubtful", (PLACE,))), tmp_path).splitlines()

    assert "quality        doubtful at x 1.5, y -2.0 (stamp 100.00): a gap" in lines


def test_all_places_are_listed_with_advice():
    quality = Quality("doubtful", (PLACE, replace(PLACE, severity=Severity.MINOR)), {"gaps": 1.0})

    shown = text(quality)

    assert shown.startswith("verdict        doubtful")
    assert "1  doubtful gap at x 1.5 m, y -2.0 m, radius 3.0 m, stamps 100.000 to 120.500" in shown
    assert "2  minor gap" in shown
    assert shown.count("try: record without gaps") == 2
    assert shown.splitlines()[-1].split() == ["gaps", "1"]


def test_a_map_of_two_nodes_is_not_judged(tmp_path, capsys):
    small_result().save(tmp_path)

    assert run(["quality", str(tmp_path), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["verdict"] == "unknown"
    assert run(["quality", str(tmp_path), "--strict"]) == 3


def test_a_folder_without_a_map_is_refused(tmp_path, capsys):
    assert run(["quality", str(tmp_path)]) == 1
    assert "map.cartoloop" in capsys.readouterr().err
