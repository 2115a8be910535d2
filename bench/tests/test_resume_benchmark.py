# SPDX-License-Identifier: Apache-2.0
"""Killed runs open, are resumed, and end in the same bytes; what differs is noticed."""

from __future__ import annotations

import shutil

import pytest

from bench import resume
from cartoloop.journal.frames import FILE_NAME
from cartoloop.map_output.save import save
from tests.map_output.small_result import small_result


@pytest.mark.slow
def test_killed_runs_are_resumed():
    lines = []

    record = resume.run(10, seed=1, is_quick=True, progress=lines.append)

    figures = [row.figures for row in record.rows]
    assert sum(each["kills"].value for each in figures) == 10
    assert [each["faults"].value for each in figures] == [0.0, 0.0], lines


def test_files_that_differ_are_noticed(tmp_path):
    whole, out = tmp_path / "whole", tmp_path / "out"
    save(small_result(), whole)
    shutil.copytree(whole, out)
    assert resume._differing(out, whole) == []
    (out / "map.pgm").write_bytes(b"")
    (out / FILE_NAME).touch()

    assert resume._differing(out, whole) == ["map.pgm", FILE_NAME]


def test_a_journal_that_does_not_open_is_noticed(tmp_path):
    (tmp_path / FILE_NAME).write_bytes(b"no journal")
    kills = resume.Kills("a.log", "map")

    assert resume._examine(tmp_path, kills) is None
    assert kills.num_opened == 0
    assert "is no journal" in kills.faults[0]
