# SPDX-License-Identifier: Apache-2.0
from pathlib import Path

import pytest

from bench.command_runs import CommandFailed
from bench.loading import first_picture, loading_rows
from bench.page_text import page_text
from bench.record import Record
from bench.results_page import write_results_page
from tests.map_output.small_result import small_result

pytestmark = pytest.mark.slow


def test_loading_and_first_picture_are_measured(tmp_path: Path) -> None:
    small_result().save(tmp_path / "out")

    rows = loading_rows("ring", tmp_path / "out", repeats=1)

    assert [row.case["what"] for row in rows] == [
        "loading", "first picture of `cartoloop view`",
    ]  # fmt: skip
    loading = rows[0].figures
    assert 0.0 < loading["cpu"].value < loading["cpu with imports"].value
    assert rows[1].figures["wall"].value > 0.0
    assert rows[1].figures["cpu"].value > 0.0
    records = tmp_path / "records"
    records.mkdir()
    (records / "journal.json").write_text(Record("journal", tuple(rows)).to_json())
    write_results_page(records, tmp_path / "page.md")
    text = (tmp_path / "page.md").read_text()
    assert page_text()["benchmarks"]["journal"]["title"] in text
    assert "first picture of `cartoloop view`" in text


def test_a_map_without_a_picture_fails_the_measurement(tmp_path: Path) -> None:
    with pytest.raises(CommandFailed, match="is not shown"):
        first_picture(tmp_path)
