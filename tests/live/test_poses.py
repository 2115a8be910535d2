# SPDX-License-Identifier: Apache-2.0
"""Poses for a reader that leaves, or on a disk that is full for a time."""

from __future__ import annotations

import json

from cartoloop.live.notices import Notices
from cartoloop.live.poses import PoseWriter
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
