# SPDX-License-Identifier: Apache-2.0
"""Poses for a reader that leaves, or on a disk that is full for a time."""

from __future__ import annotations

import json
import os
from threading import Timer

import pytest

from cartoloop.cli.main import run
from cartoloop.live import poses
from cartoloop.live.notices import Notices
from cartoloop.live.poses import PoseWriter, open_poses
from cartoloop.sensor.pose import IDENTITY


class Stream:
    """Keeps lines; raises an error at some of them."""

    def __init__(self, error, *places):
        self.error, self.places = error, places
        self.written, self.lines = 0, []

    def write(self, line):
        self.written += 1
        if self.written - 1 in self.places:
            raise self.error
        self.lines.append(json.loads(line)["stamp"])

    def flush(self):
        pass


def written(stream):
    said = []
    notices = Notices(said.append)
    writer = PoseWriter(stream, notices)
    for stamp in range(5):
        writer.put(float(stamp), IDENTITY, IDENTITY, 0.0)
    writer.close(timeout=60.0)
    return stream.lines, notices.counts, said


def test_poses_go_on_when_a_full_disk_has_room_again():
    lines, counts, said = written(Stream(OSError(28, "No space left on device"), 1, 2))

    assert lines == [0.0, 3.0, 4.0]
    assert counts == {"poses lost: they cannot be written": 2}
    assert said[0] == "poses lost: they cannot be written: No space left on device"


def test_poses_end_when_their_reader_leaves():
    lines, counts, _ = written(Stream(BrokenPipeError(32, "Broken pipe"), 1))

    assert lines == [0.0]
    assert counts == {"the reader of the poses left": 1}


@pytest.fixture
def pipe(tmp_path):
    if not hasattr(os, "mkfifo"):
        pytest.skip("no named pipes here")
    os.mkfifo(tmp_path / "pipe")
    return tmp_path / "pipe"


def test_a_pipe_that_nobody_reads_is_not_waited_for_long(pipe):
    with pytest.raises(BrokenPipeError, match="nobody reads this pipe"):
        open_poses(pipe, wait=0.1)


def test_the_reader_of_a_pipe_may_come_later(pipe):
    received = []
    reader = Timer(0.2, lambda: received.append(pipe.read_bytes()))
    reader.start()

    with open_poses(pipe, wait=60.0) as stream:
        writer = PoseWriter(stream, Notices(lambda _: None))
        for stamp in range(900):  # more than a pipe holds: each line waits for the reader
            writer.put(float(stamp), IDENTITY, IDENTITY, 0.0)
        writer.close(timeout=60.0)
    reader.join()

    assert [json.loads(line)["stamp"] for line in received[0].splitlines()] == list(range(900))


def test_poses_in_a_file_replace_those_of_before(tmp_path):
    (tmp_path / "poses").write_text("those of an earlier run")

    with open_poses(tmp_path / "poses") as stream:
        stream.write(b"new")

    assert (tmp_path / "poses").read_text() == "new"


def test_a_pipe_without_a_reader_is_reported_in_a_line(pipe, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(poses, "READER_S", 0.0)

    assert run(["live", "-", "-o", str(tmp_path / "out"), "--poses", str(pipe)]) == 1

    [line] = capsys.readouterr().err.splitlines()
    assert line.endswith("pipe: cannot be written: nobody reads this pipe; start its reader first")
