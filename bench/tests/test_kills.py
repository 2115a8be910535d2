# SPDX-License-Identifier: Apache-2.0
"""Killed runs leave a whole map, and what is no whole map is noticed."""

from __future__ import annotations

import shutil

import pytest

from bench import kills
from bench.opened_files import digests_of, opening_fault
from cartoloop.map_file.file_set import FILES
from cartoloop.map_output.save import save
from tests.map_output.small_result import small_result


@pytest.mark.slow
def test_killed_runs_leave_whole_maps(monkeypatch):
    monkeypatch.setattr(kills, "DRIVE_S", 15.0)
    lines = []

    record = kills.run(4, 3, seed=1, progress=lines.append)

    assert sum(row.figures["kills"].value for row in record.rows) == 4
    assert [row.figures["faults"].value for row in record.rows] == [0.0] * len(record.rows), lines


def test_files_of_two_maps_are_noticed(tmp_path):
    old, new, mixed = tmp_path / "old", tmp_path / "new", tmp_path / "mixed"
    save(small_result(), old)
    save(small_result(nodes=2), new)
    (new / "map.png").write_bytes((new / "map.png").read_bytes() + b"\0")
    shutil.copytree(old, mixed)
    shutil.copy(new / "map.png", mixed)
    digests = {"old": digests_of(old), "new": digests_of(new)}
    drive = kills.Drive(tmp_path / "drive.log", old, digests, 1.0, 1.0)

    def faults(folder):
        return kills._examined(kills.Kill("map", "saving", "SIGKILL", 0.5), drive, folder).faults

    assert faults(old) == faults(new) == []
    (fault,) = faults(mixed)
    assert fault.startswith("files of two maps")


@pytest.mark.parametrize("name", FILES)
def test_a_file_that_was_cut_off_is_noticed(tmp_path, name):
    save(small_result(), tmp_path)
    path = tmp_path / name
    assert opening_fault(path) == ""

    path.write_bytes(path.read_bytes()[: -len(path.read_bytes()) // 3])
    fault = opening_fault(path)

    # A table, trajectory, graph or list of parameters may end at any line.
    assert fault.startswith(f"{name} does not open") or name.endswith(
        (".csv", ".tum", ".g2o", ".toml")
    )
