# SPDX-License-Identifier: Apache-2.0
"""The benchmarks from the command line; what they measure is tested beside them."""

from __future__ import annotations

import json

import pytest

from cartoloop.benchmarks.record import Record
from cartoloop.cli.main import run

pytestmark = pytest.mark.slow

KERNEL = "simulate a scan"
"""What needs the least to be measured."""


@pytest.fixture
def measured(tmp_path):
    """The JSON of a short benchmark."""
    assert run(["bench", "kernels", "--only", KERNEL, "--repeat", "2", "-o", str(tmp_path)]) == 0
    return tmp_path / "kernels.json"


def changed(path, factor):
    """A copy of a record in which all took so many times as long, and always the same time."""
    found = json.loads(path.read_text())
    for row in found["rows"]:
        for figure in row["figures"].values():
            figure["value"] *= factor
            figure["low"] = figure["high"] = figure["value"]
    copy = path.with_name(f"{factor}.json")
    copy.write_text(json.dumps(found))
    return copy


def again(path, before, *options):
    arguments = ["--only", KERNEL, "--repeat", "2", "-o", str(path.parent)]
    return run(["bench", "kernels", *arguments, "--against", str(before), *options])


def test_a_benchmark_prints_a_table_and_writes_its_record(tmp_path, capsys):
    assert run(["bench", "kernels", "--only", KERNEL, "--repeat", "2", "-o", str(tmp_path)]) == 0
    record = Record.from_json((tmp_path / "kernels.json").read_text())
    assert record.benchmark == "kernels"
    assert {"commit", "date", "processor", "python"} <= set(record.environment)
    assert "| simulate a scan " in capsys.readouterr().out


def test_what_got_slower_is_told_and_fails_only_if_asked_to(measured, capsys):
    faster = changed(measured, 0.01)
    assert again(measured, faster) == 0
    assert "WORSE" in capsys.readouterr().out
    assert again(measured, faster, "--strict") == 1


def test_what_got_faster_is_told(measured, capsys):
    slower = changed(measured, 100.0)
    assert again(measured, slower, "--strict") == 0
    told = capsys.readouterr().out
    assert "better" in told
    assert "WORSE" not in told


def test_a_file_that_is_no_record_is_told_before_anything_is_measured(tmp_path, capsys):
    other = tmp_path / "other.json"
    other.write_text("{}")
    assert run(["bench", "kernels", "--against", str(other)]) == 1
    told = capsys.readouterr()
    assert f"{other}: is no record of a benchmark" in told.err
    assert KERNEL not in told.out


def test_a_page_is_made_of_the_records(measured, capsys):
    page = measured.parent / "page" / "results.md"
    assert run(["bench", "page", str(measured.parent), "-o", str(page)]) == 0
    assert "## Kernels" in page.read_text()
    assert "bench kernels" in page.read_text()


def test_a_record_of_another_benchmark_is_refused(measured, capsys):
    assert run(["bench", "matching", "--against", str(measured)]) == 1
    assert "is a record of 'kernels'" in capsys.readouterr().err
