# SPDX-License-Identifier: Apache-2.0
"""The command line of the benchmarks."""

from __future__ import annotations

import json

import pytest

from bench.__main__ import run
from bench.record import Record

pytestmark = pytest.mark.slow

KERNEL = "simulate a scan"
"""The fastest kernel to measure."""


@pytest.fixture
def measured(tmp_path):
    """The JSON of a short benchmark."""
    assert run(["kernels", "--only", KERNEL, "--repeat", "2", "-o", str(tmp_path)]) == 0
    return tmp_path / "kernels.json"


def changed(path, factor):
    """A copy of a record with all times multiplied by `factor` and without spread."""
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
    return run(["kernels", *arguments, "--against", str(before), *options])


def test_benchmark_prints_a_table_and_writes_a_record(tmp_path, capsys):
    assert run(["kernels", "--only", KERNEL, "--repeat", "2", "-o", str(tmp_path)]) == 0
    record = Record.from_json((tmp_path / "kernels.json").read_text())
    assert record.benchmark == "kernels"
    assert {"commit", "date", "processor", "python"} <= set(record.environment)
    assert "| simulate a scan " in capsys.readouterr().out


def test_slower_figure_is_reported_and_fails_if_strict(measured, capsys):
    faster = changed(measured, 0.01)
    assert again(measured, faster) == 0
    assert "WORSE" in capsys.readouterr().out
    assert again(measured, faster, "--strict") == 1


def test_faster_figure_is_reported(measured, capsys):
    slower = changed(measured, 100.0)
    assert again(measured, slower, "--strict") == 0
    output = capsys.readouterr().out
    assert "better" in output
    assert "WORSE" not in output


def test_invalid_earlier_record_fails_before_measuring(tmp_path, capsys):
    other = tmp_path / "other.json"
    other.write_text("{}")
    assert run(["kernels", "--against", str(other)]) == 1
    output = capsys.readouterr()
    assert f"{other}: is not a record of a benchmark" in output.err
    assert KERNEL not in output.out


def test_page_has_the_records(measured, capsys):
    page = measured.parent / "page" / "results.md"
    assert run(["page", str(measured.parent), "-o", str(page)]) == 0
    assert "## Kernels" in page.read_text()
    assert "bench kernels" in page.read_text()


def test_record_of_another_benchmark_is_refused(measured, capsys):
    assert run(["matching", "--against", str(measured)]) == 1
    assert "is a record of 'kernels'" in capsys.readouterr().err
