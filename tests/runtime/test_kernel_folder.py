# SPDX-License-Identifier: Apache-2.0
"""Locks of kernels between processes, and removal of unused versions."""

from __future__ import annotations

import os
import subprocess
import sys
import time

import pytest

from cartoloop.runtime import kernel_folder
from cartoloop.runtime.kernel_folder import UNUSED_S, KernelLocks, remove_unused

HOLD = """
import sys
from pathlib import Path
from cartoloop.runtime.kernel_folder import KernelLocks

locks = KernelLocks(Path(sys.argv[1]))
print(locks.acquire("voxel_filter"), flush=True)
sys.stdin.readline()
locks.release("voxel_filter")
print("released", flush=True)
sys.stdin.readline()
"""


@pytest.fixture
def other(tmp_path):
    """Another process, which holds the lock of one kernel."""
    process = subprocess.Popen(
        [sys.executable, "-c", HOLD, str(tmp_path)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert process.stdout.readline() == "True\n"
    yield process
    process.communicate("\n\n")


def test_a_lock_is_held_by_one_process_at_a_time(tmp_path, other):
    locks = KernelLocks(tmp_path)
    assert not locks.acquire("voxel_filter")
    assert locks.acquire("search_scans")
    other.stdin.write("\n")
    other.stdin.flush()
    assert other.stdout.readline() == "released\n"
    assert locks.acquire("voxel_filter")


def test_killing_a_process_releases_its_locks(tmp_path, other, monkeypatch):
    monkeypatch.setattr(kernel_folder, "_MAX_WAIT_S", 1e9)
    locks = KernelLocks(tmp_path)
    assert not locks.acquire("voxel_filter")
    other.kill()
    locks.wait("voxel_filter")
    assert locks.acquire("voxel_filter")


def test_waiting_is_limited(tmp_path, other, monkeypatch):
    monkeypatch.setattr(kernel_folder, "_MAX_WAIT_S", 0.05)
    locks = KernelLocks(tmp_path)
    start = time.monotonic()
    locks.wait("voxel_filter")
    assert time.monotonic() - start >= 0.05


def test_the_waiting_time_is_limited_over_all_kernels(tmp_path, other, monkeypatch):
    monkeypatch.setattr(kernel_folder, "_MAX_WAIT_S", 0.5)
    locks = KernelLocks(tmp_path)
    locks.wait("voxel_filter")
    monkeypatch.setattr(time, "sleep", lambda seconds: pytest.fail("waits again"))
    locks.wait("voxel_filter")


def test_without_a_lock_file_no_process_waits(tmp_path):
    locks = KernelLocks(tmp_path / "missing")
    assert locks.acquire("voxel_filter")
    locks.release("voxel_filter")


def make_folder(path, used):
    """Make a folder of kernels that was last used at a time [s, epoch]."""
    path.mkdir(parents=True)
    (path / "turns").touch()
    (path / "kernel.nbi").touch()
    os.utime(path / "turns", (used, used))
    os.utime(path / "kernel.nbi", (used - 1e6, used - 1e6))
    return path


def test_folders_unused_for_long_are_removed(tmp_path):
    now = time.time()
    old = make_folder(tmp_path / "0123456789abcdef", now - 1000.0)
    used = make_folder(tmp_path / "0123456789abcde0-checked", now - 10.0)
    without_locks = make_folder(tmp_path / "0123456789abcde1", now - 1000.0)
    (without_locks / "turns").unlink()
    for path in (without_locks / "kernel.nbi", without_locks):
        os.utime(path, (now - 1000.0, now - 1000.0))
    foreign = make_folder(tmp_path / "photographs", now - 1000.0)
    (tmp_path / "0123456789abcde2").touch()
    remove_unused(tmp_path, now - 100.0)
    assert not old.exists()
    assert not without_locks.exists()
    assert (used / "kernel.nbi").exists()
    assert (foreign / "kernel.nbi").exists()
    assert len(list(tmp_path.iterdir())) == 3


def test_a_new_folder_removes_unused_ones_and_counts_as_used(tmp_path):
    own = make_folder(tmp_path / "0123456789abcde0", time.time() - UNUSED_S - 60.0)
    old = make_folder(tmp_path / "0123456789abcdef", time.time() - UNUSED_S - 60.0)
    KernelLocks(own)
    assert old.exists()  # only a new folder removes others
    new = tmp_path / "0123456789abcde1"
    new.mkdir()
    KernelLocks(new)
    assert not old.exists()
    assert own.exists()
