# SPDX-License-Identifier: Apache-2.0
"""Mapping a live source from Python."""

from __future__ import annotations

import io
import json

import pytest
from live_room import lines

from cartoloop.errors import InputError
from cartoloop.live.live_run import LiveObserver, LiveOptions, map_live
from cartoloop.live.messages import EndMessage, parse_message


class Sender:
    """Sends what it is given, then ends or fails."""

    name = "sender"

    def __init__(self, sent, failure=None):
        self.sent, self.failure = sent, failure

    def open(self):
        return "listening"

    def run(self, put, notices, stop):
        for line in self.sent:
            put(parse_message(line))
        if self.failure is not None:
            raise self.failure
        put(EndMessage())


class Recorder(LiveObserver):
    """Keeps the lines that are said."""

    def __init__(self):
        self.lines, self.num_changes = [], 0

    def say(self, line):
        self.lines.append(line)

    def changed(self, mapper):
        self.num_changes += 1


def test_map_and_poses_of_all_scans_are_written(tmp_path):
    recorder, poses = Recorder(), io.BytesIO()
    options = LiveOptions(waits=True, poses=poses)
    result = map_live(Sender(lines(4.0)), None, tmp_path, options, observer=recorder)

    report = json.loads((tmp_path / "report.json").read_text())
    assert report["input"]["name"] == result.report.input.name == "sender"
    assert report["wall_s"] > 0.0
    assert len(result.stamps) == len(poses.getvalue().splitlines()) == 21
    assert recorder.lines[0] == "listening (Ctrl-C ends)"
    assert recorder.num_changes >= 21


def test_a_source_that_fails_leaves_its_map(tmp_path):
    source = Sender(lines(4.0), InputError("sender: connection lost"))
    with pytest.raises(InputError, match="connection lost"):
        map_live(source, None, tmp_path, LiveOptions(waits=True))

    assert len((tmp_path / "trajectory.tum").read_text().splitlines()) > 15


def test_a_source_without_scans_is_an_error(tmp_path):
    with pytest.raises(InputError, match="no scan with enough returns"):
        map_live(Sender([]), None, tmp_path)
    assert (tmp_path / "report.json").exists()
