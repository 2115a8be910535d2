# SPDX-License-Identifier: Apache-2.0
import json
from collections import Counter
from pathlib import Path

import pytest

from bench.command_runs import CommandFailed, run_command
from bench.document import to_markdown
from bench.fuzz.run import Results
from bench.fuzz.worker import Outcome
from bench.paper import experiments as paper
from bench.paper.published import SOURCES, published
from bench.paper.report import sections
from bench.record import Figure, Record, Row
from bench.results_page import write_results_page
from bench.soak.run import SoakResult, record_of
from cartoloop.errors import ConfigError, InputError


def relations_row(log: str, error: str, mean: float, **others: float) -> Row:
    figures = {
        "mean": Figure.exact(mean, "m"),
        "std": Figure.exact(0.02, "m"),
        "mean before": Figure.exact(1.0, "m"),
        "std before": Figure.exact(0.5, "m"),
    }
    for source, value in others.items():
        figures[SOURCES[source]] = Figure.exact(value, "m", better=None)
        figures[f"{SOURCES[source]} std"] = Figure.exact(0.1, "m", better=None)
    return Row({"experiment": "relations", "log": log, "error": error}, figures)


def report(*rows: Row) -> str:
    return to_markdown("Report", sections(Record("paper", rows)))


def test_quoted_figures_are_those_of_the_paper() -> None:
    intel = published()["logs"]["intel"]
    assert intel["errors"]["absolute_translational"]["paper"] == [0.0229, 0.0239]
    assert intel["closures"]["paper"] == 5786
    for log in published()["logs"].values():
        for by_source in log["errors"].values():
            assert set(by_source) <= set(SOURCES)


def test_lowest_error_is_bold_and_not_listed_as_behind() -> None:
    text = report(relations_row("fr079", "absolute_translational", 0.031, paper=0.0452))
    assert "**0.0310 ± 0.0200**" in text
    assert "Where we are behind" not in text


def test_error_above_another_is_listed_with_the_reason() -> None:
    text = report(relations_row("fr079", "absolute_translational", 0.05, paper=0.0452, GM=0.056))
    behind = text[text.index("Where we are behind") :]
    assert "0.0500" in behind
    assert "Cartographer (paper) 0.0452" in behind
    assert "GM 0.056" not in behind
    assert "where the scanner sits" in behind


def test_missing_data_is_listed_in_the_report() -> None:
    row = Row({"experiment": "performance", "log": "aces"}, notes="aces is not in the folder")
    text = report(row)
    assert "What is missing" in text
    assert "aces is not in the folder" in text


def test_missing_recordings_give_rows_with_the_reason(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setattr(paper, "run_command", lambda *arguments: None)
    options = paper.PaperOptions(tmp_path / "nowhere", tmp_path / "bench", 1, ("radish",))
    record = paper.run(options, lambda line: None)
    assert [row.case["log"] for row in record.rows] == list(published()["logs"])
    assert all("is not in the data folder" in row.notes for row in record.rows)
    assert not record.is_complete


def test_unknown_experiments_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="no experiment 'museums'; choose from radish, museum"):
        paper.run(paper.PaperOptions(tmp_path, tmp_path, 1, ("museums",)), print)


def test_failed_command_reports_its_last_line(tmp_path: Path) -> None:
    with pytest.raises(CommandFailed, match=r"map .* ended with status 1: cartoloop: .*nowhere"):
        run_command("map", tmp_path / "nowhere.log", "-o", tmp_path / "out")


def test_command_is_measured() -> None:
    run = run_command("--version")
    assert 0.0 < run.cpu_s < 20.0
    assert run.wall_s > 0.0
    assert 5.0 < run.peak_memory_mb < 2000.0


def test_results_page_has_figures_of_the_records(tmp_path: Path) -> None:
    record = Record(
        "paper",
        (relations_row("fr079", "absolute_translational", 0.031, paper=0.0452),),
        {"commit": "abc123", "date": "2026-01-01"},
    )
    (tmp_path / "paper.json").write_text(record.to_json())
    write_results_page(tmp_path, tmp_path / "docs" / "results.md")
    text = (tmp_path / "docs" / "results.md").read_text()
    assert "abc123" in text
    assert "2026-01-01" in text
    assert "Freiburg bldg 79" in text


def test_results_page_shows_faults_and_changed_inputs(tmp_path: Path) -> None:
    day = SoakResult(Counter(drop=3), sent=900, received=890, mapped=889, lost=10, missing=0)
    (tmp_path / "soak.json").write_text(record_of({"dds": day}, 0.5, drives_again=False).to_json())
    inputs = Results()
    for number, what in enumerate(("fine", "stated", "stated", "ValueError")):
        inputs.add(Outcome(number, "map rows", what, "", [], 0.5 * number))
    (tmp_path / "fuzz.json").write_text(inputs.record().to_json())
    write_results_page(tmp_path, tmp_path / "results.md")
    lines = [
        [cell.strip() for cell in line.split("|")[1:-1]]
        for line in (tmp_path / "results.md").read_text().splitlines()
        if line.startswith(("| dds", "| map rows", "| all"))
    ]
    assert lines[0][:8] == ["dds", "0.5", "once", "3", "900", "889", "10", "1"]
    assert lines[1] == ["map rows", "4", "1", "2", "1", "1.50"]
    assert lines[2] == ["all", *lines[1][1:]]
    assert [len(line) for line in lines] == [15, 6, 6]


def test_folder_without_records_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="run 'python -m bench paper' first"):
        write_results_page(tmp_path, tmp_path / "results.md")


def test_remarks_name_only_published_recordings() -> None:
    from bench.paper.shortfalls import remarks

    assert set(remarks()) - {"any", "limits"} <= set(published()["logs"])
    assert json.dumps(remarks())


def performance_row(memory: float) -> Row:
    figures = {
        "peak memory": Figure(memory, "MB"),
        f"{SOURCES['cpp']} peak memory": Figure.exact(145, "MB", better=None),
    }
    return Row({"experiment": "performance", "log": "mit-csail"}, figures)


def test_a_program_that_takes_less_memory_is_listed() -> None:
    text = report(performance_row(391.0))
    assert "Cartographer (C++) 145" in text[text.index("Where we are behind") :]
    assert "Where we are behind" not in report(performance_row(100.0))


def test_less_precise_closures_are_listed() -> None:
    figures = {
        "precision": Figure.exact(99.0, "%", better="more"),
        "precision of found": Figure.exact(89.5, "%", better="more"),
        f"{SOURCES['paper']} precision": Figure.exact(97.2, "%", better=None),
    }
    text = report(Row({"experiment": "closures", "log": "intel"}, figures))
    behind = text[text.index("Where we are behind") :]
    assert "precision of found [%]" in behind
    assert "| precision [%]" not in behind


def test_adjustment_runs_are_only_in_the_long_report(tmp_path: Path) -> None:
    case = {"experiment": "adjustment run", "log": "museum", "run": 7}
    names = ("nodes", "constraints", "iterations", "time")
    row = Row(case, {name: Figure.exact(4321) for name in names})
    assert "4,321" in to_markdown("Report", sections(Record("paper", (row,)), tmp_path))
    assert "4,321" not in report(row)


def test_stage_times_are_one_row_per_recording() -> None:
    text = report(
        stage_row("mit-csail", "match", 1.5),
        stage_row("mit-csail", "search", 2.5),
        stage_row("aces", "search", 0.25),
    )
    _, heads, _, csail, aces = text[text.index("Where the time goes") :].split("\n|")[:5]
    assert [cell.strip() for cell in heads.split("|")] == ["", "match", "search", ""]
    assert [cell.strip() for cell in csail.split("|")] == ["MIT CSAIL", "1.50", "2.50", ""]
    assert [cell.strip() for cell in aces.split("|")[:3]] == ["ACES", "", "0.250"]


def stage_row(log: str, stage: str, seconds: float) -> Row:
    return Row(
        {"experiment": "stages", "log": log, "stage": stage}, {"total": Figure(seconds, "s")}
    )
