# SPDX-License-Identifier: Apache-2.0
"""Processes take turns to compile; kernels of versions that nobody uses are removed."""

from __future__ import annotations

import os
import subprocess
import sys
import time

import pytest

from cartoloop import _kernel_folder
from cartoloop._kernel_folder import UNUSED_S, Turns, remove_unused

HOLD = """
import sys
from pathlib import Path
from cartoloop._kernel_folder import Turns

turns = Turns(Path(sys.argv[1]))
print(turns.is_taken("voxel_filter"), flush=True)
sys.stdin.readline()
turns.give_back("voxel_filter")
print("given back", flush=True)
sys.stdin.readline()
"""


@pytest.fixture
def other(tmp_path):
    """Another process, which has the turn of one kernel."""
    process = subprocess.Popen(
        [sys.executable, "-c", HOLD, str(tmp_path)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert process.stdout.readline() == "False\n"
    yield process
    process.communicate("\n\n")


def test_a_turn_is_one_process_alone_until_it_gives_it_back(tmp_path, other):
    turns = Turns(tmp_path)
    assert turns.is_taken("voxel_filter")
    assert not turns.is_taken("search_scans")
    other.stdin.write("\n")
    other.stdin.flush()
    assert other.stdout.readline() == "given back\n"
    assert not turns.is_taken("voxel_filter")


def test_a_process_that_is_killed_holds_up_nobody(tmp_path, other, monkeypatch):
    monkeypatch.setattr(_kernel_folder, "_PATIENCE_S", 1e9)
    turns = Turns(tmp_path)
    assert turns.is_taken("voxel_filter")
    other.kill()
    turns.wait("voxel_filter")
    assert not turns.is_taken("voxel_filter")


def test_nobody_waits_forever(tmp_path, other, monkeypatch):
    monkeypatch.setattr(_kernel_folder, "_PATIENCE_S", 0.05)
    turns = Turns(tmp_path)
    start = time.monotonic()
    turns.wait("voxel_filter")
    assert time.monotonic() - start >= 0.05


def test_patience_is_lost_once_for_all_kernels(tmp_path, other, monkeypatch):
    monkeypatch.setattr(_kernel_folder, "_PATIENCE_S", 0.5)
    turns = Turns(tmp_path)
    turns.wait("voxel_filter")
    monkeypatch.setattr(time, "sleep", lambda seconds: pytest.fail("waits again"))
    turns.wait("voxel_filter")


def test_nobody_waits_where_there_is_no_file_for_turns(tmp_path):
    turns = Turns(tmp_path / "missing")
    assert not turns.is_taken("voxel_filter")
    turns.give_back("voxel_filter")


def make_folder(path, used):
    """Make a folder of kernels that was last used at a time [s, epoch], and then not any more."""
    path.mkdir(parents=True)
    (path / "turns").touch()
    (path / "kernel.nbi").touch()
    os.utime(path / "turns", (used, used))
    os.utime(path / "kernel.nbi", (used - 1e6, used - 1e6))
    return path


def test_folders_that_have_not_been_used_for_long_are_removed(tmp_path):
    now = time.time()
    old = make_folder(tmp_path / "0123456789abcdef", now - 1000.0)
    used = make_folder(tmp_path / "0123456789abcde0-checked", now - 10.0)
    before_turns = make_folder(tmp_path / "0123456789abcde1", now - 1000.0)
    (before_turns / "turns").unlink()
    for path in (before_turns / "kernel.nbi", before_turns):
        os.utime(path, (now - 1000.0, now - 1000.0))
    foreign = make_folder(tmp_path / "photographs", now - 1000.0)
    (tmp_path / "0123456789abcde2").touch()
    remove_unused(tmp_path, now - 100.0)
    assert not old.exists()
    assert not before_turns.exists()
    assert (used / "kernel.nbi").exists()
    assert (foreign / "kernel.nbi").exists()
    assert len(list(tmp_path.iterdir())) == 3


def test_a_new_version_removes_what_nobody_uses_and_counts_as_used_itself(tmp_path):
    own = make_folder(tmp_path / "0123456789abcde0", time.time() - UNUSED_S - 60.0)
    old = make_folder(tmp_path / "0123456789abcdef", time.time() - UNUSED_S - 60.0)
    Turns(own)
    assert old.exists()  # it has looked after the others when it was new
    new = tmp_path / "0123456789abcde1"
    new.mkdir()
    Turns(new)
    assert not old.exists()
    assert own.exists()
