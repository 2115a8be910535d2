# SPDX-License-Identifier: Apache-2.0
"""Files that are written completely or not at all, and what killed processes leave of them."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from cartoloop.errors import OutputError
from cartoloop.map_output.unfinished_file import LEFT_AFTER_S, unfinished_file


def ended_process():
    """Return the number of a process that has ended."""
    process = subprocess.Popen([sys.executable, "-c", ""])
    process.wait()
    return process.pid


def left_by(pid, path, age):
    """Make a file as a process leaves it that was killed some time ago [s]."""
    left = path.with_name(f".{path.name}.{pid}")
    left.write_bytes(b"half")
    made = left.stat().st_mtime - age
    os.utime(left, (made, made))
    return left


def write(path):
    with unfinished_file(path) as unfinished:
        unfinished.write_bytes(b"whole")


def test_a_file_appears_when_it_is_whole(tmp_path):
    path = tmp_path / "map.png"
    with unfinished_file(path) as unfinished:
        unfinished.write_bytes(b"whole")
        assert not path.exists()
    assert path.read_bytes() == b"whole"
    assert list(tmp_path.iterdir()) == [path]


def test_a_failure_keeps_the_file_that_was_there(tmp_path):
    path = tmp_path / "map.png"
    path.write_bytes(b"before")
    with pytest.raises(RuntimeError), unfinished_file(path) as unfinished:
        unfinished.write_bytes(b"half")
        raise RuntimeError
    assert path.read_bytes() == b"before"
    assert list(tmp_path.iterdir()) == [path]


def test_a_folder_that_is_missing_is_reported(tmp_path):
    with pytest.raises(OutputError, match=r"map\.png: cannot be written"):
        write(tmp_path / "missing" / "map.png")


@pytest.mark.parametrize("name", ["map.png", "plan [2].png"])
def test_what_a_killed_process_left_is_removed(tmp_path, name):
    path = tmp_path / name
    left = left_by(ended_process(), path, 2.0 * LEFT_AFTER_S)
    write(path)
    assert not left.exists()
    assert list(tmp_path.iterdir()) == [path]


def test_what_may_still_be_written_is_kept(tmp_path):
    path = tmp_path / "map.png"
    kept = [
        left_by(os.getppid(), path, 2.0 * LEFT_AFTER_S),  # it runs
        left_by(ended_process(), path, 0.1 * LEFT_AFTER_S),  # it may run on another machine
        left_by("old", path, 2.0 * LEFT_AFTER_S),  # it is none of ours
    ]
    write(path)
    assert sorted(tmp_path.iterdir()) == sorted([path, *kept])
