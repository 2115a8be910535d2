# SPDX-License-Identifier: Apache-2.0
"""Mapping a live source from Python."""

from __future__ import annotations

import io
import json

import pytest
from live_room import lines

from cartoloop.errors import InputError, OutputError
from cartoloop.live.live_run import LiveObserver, LiveOptions, map_live
from cartoloop.live.message_loop import MessageOptions
from cartoloop.live.messages import EndMessage, parse_message
from cartoloop.map_output.save import save
from cartoloop.report import InputSummary
from cartoloop.result import load_map
from tests.map_output.small_result import FILES, small_result


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
    options = LiveOptions(MessageOptions(waits=True), poses=poses)
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
        map_live(source, None, tmp_path, LiveOptions(MessageOptions(waits=True)))

    assert len((tmp_path / "trajectory.tum").read_text().splitlines()) > 15


def test_a_source_without_scans_is_an_error(tmp_path):
    with pytest.raises(InputError, match="no scan with enough returns"):
        map_live(Sender([]), None, tmp_path)
    assert (tmp_path / "report.json").exists()


@pytest.fixture
def kept(tmp_path):
    """A folder with a finished map."""
    save(small_result(input=InputSummary("yesterday"), finished=True), tmp_path)
    return tmp_path


def contents(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}


def test_a_folder_with_a_map_is_refused(kept):
    with pytest.raises(OutputError, match=r"holds another map \(of yesterday\).*--overwrite"):
        map_live(Sender(lines(4.0)), None, kept)


def test_a_finished_map_is_replaced_only_at_the_end(kept):
    before = contents(kept)

    class Watcher(Recorder):
        """Keeps what the folder holds before the map is saved."""

        def mapped(self, result, failure):
            now = contents(kept)
            self.has_journal = bool(now.pop("journal.cartoloop", b""))
            self.while_mapping = now

    watcher = Watcher()
    map_live(
        Sender(lines(4.0)),
        None,
        kept,
        LiveOptions(MessageOptions(waits=True)),
        observer=watcher,
        overwrite=True,
    )

    assert watcher.while_mapping == before
    assert watcher.has_journal
    assert {path.name for path in kept.iterdir()} == FILES
    assert json.loads((kept / "report.json").read_text())["input"]["name"] == "sender"


def test_a_drive_that_fails_is_saved_beside_a_finished_map(kept):
    before = contents(kept)
    source = Sender(lines(4.0), InputError("sender: connection lost"))

    with pytest.raises(InputError, match="connection lost"):
        map_live(source, None, kept, LiveOptions(MessageOptions(waits=True)), overwrite=True)

    assert contents(kept) == before
    assert set(contents(kept / "stopped")) == FILES


def test_a_drive_without_scans_replaces_nothing(kept):
    before = contents(kept)

    with pytest.raises(InputError, match="the map is empty"):
        map_live(Sender([]), None, kept, overwrite=True)

    assert contents(kept) == before
    assert not (kept / "stopped").exists()


def test_a_drive_that_is_killed_opens_as_a_map(tmp_path):
    class Killed(Recorder):
        """Keeps the journal as it is before the map is saved."""

        def mapped(self, result, failure):
            self.result = result
            (tmp_path / "killed").mkdir()
            journal = (tmp_path / "out" / "journal.cartoloop").read_bytes()
            (tmp_path / "killed" / "journal.cartoloop").write_bytes(journal)

    killed = Killed()
    map_live(
        Sender(lines(60.0)),
        None,
        tmp_path / "out",
        LiveOptions(MessageOptions(waits=True)),
        observer=killed,
    )

    opened = load_map(tmp_path / "killed")
    whole = killed.result
    assert 0 < len(opened.stamps) <= len(whole.stamps)
    assert opened.local_trajectory.tolist() == whole.local_trajectory[: len(opened.stamps)].tolist()
    assert not opened.report.finished
    assert opened.report.input.name == "sender"
    with pytest.raises(OutputError, match=r"holds an interrupted run \(of sender\)"):
        map_live(Sender(lines(4.0)), None, tmp_path / "killed")
    assert not (tmp_path / "out" / "journal.cartoloop").exists()
