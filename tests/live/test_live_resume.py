# SPDX-License-Identifier: Apache-2.0
"""Live maps that are continued after a restart."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace

import pytest
from live_room import message_of
from test_live_run import Recorder, Sender

from cartoloop.config import Config
from cartoloop.errors import InputError, Interrupted
from cartoloop.journal.frames import FILE_NAME, PREAMBLE, Kind, frame_bytes, record_bytes
from cartoloop.journal.writer import JournalWriter
from cartoloop.live.continued import last_pose, map_to_continue
from cartoloop.live.live_run import LiveOptions, map_live
from cartoloop.live.message_loop import MessageOptions
from cartoloop.map_file.run_header import RunHeader
from cartoloop.map_output.save import save
from cartoloop.result import load_map
from cartoloop.runs import journal
from cartoloop.sensor.pose import IDENTITY
from cartoloop.session import MAIN_PART
from cartoloop.stop_request import StopRequest
from tests.map_output.small_result import FILES, small_result


class FlushedWriter(JournalWriter):
    """The latest writer can be asked to write at once: what a kill costs depends on the clock."""

    latest = None

    def __init__(self, *arguments, **options):
        super().__init__(*arguments, **options)
        FlushedWriter.latest = self


@pytest.fixture(autouse=True)
def _flushed_writer(monkeypatch):
    monkeypatch.setattr(journal, "JournalWriter", FlushedWriter)


class Killed(Recorder):
    """Copies the folder of a run at its end, before anything is saved, as a kill leaves it."""

    def __init__(self, out, copy):
        super().__init__()
        self.out, self.copy = out, copy

    def mapped(self, result, failure):
        FlushedWriter.latest.flush()
        shutil.copytree(self.out, self.copy)


def drive(events, out, copy, onto=None, lifelong=False, **options):
    sent = [json.dumps(message_of(event)).encode() + b"\n" for event in events]
    killed = Killed(out, copy)
    result = map_live(
        Sender(sent),
        None,
        out,
        LiveOptions(MessageOptions(waits=True), **options),
        observer=killed,
        onto=onto or (out if out.exists() else None),
        lifelong=lifelong,
    )
    return result, killed


@pytest.mark.slow
def test_a_map_is_continued_kill_after_kill(ring_events, tmp_path):
    events = ring_events[: len(ring_events) // 3]
    out, one, two = tmp_path / "out", tmp_path / "one", tmp_path / "two"
    drive(events, out, one)
    assert [path.name for path in one.iterdir()] == [FILE_NAME]

    _, killed = drive(events, one, two, starts_at_end=True)
    assert killed.lines[0] == f"recovering the map of the interrupted run in {one}"
    assert FILE_NAME in {path.name for path in two.iterdir()}
    result, _ = drive(events, two, tmp_path / "three", starts_at_end=True)

    assert [session.part for session in result.sessions] == [MAIN_PART] * 3
    num_scans = sum(hasattr(event, "ranges") for event in events)
    assert len(result.stamps) == 3 * num_scans
    assert {path.name for path in two.iterdir()} == FILES


@pytest.mark.slow
def test_a_drive_added_to_another_map_is_recovered(ring_result, ring_events, tmp_path):
    base, out, killed = tmp_path / "base", tmp_path / "out", tmp_path / "killed"
    ring_result.save(base)
    before = {path.name: path.read_bytes() for path in base.iterdir()}

    events = ring_events[: len(ring_events) // 2]
    result, _ = drive(events, out, killed, onto=base, start=IDENTITY)
    assert [session.part for session in result.sessions] == [MAIN_PART] * 2
    assert [path.name for path in killed.iterdir()] == [FILE_NAME]
    found = map_to_continue(killed, lambda _: None)

    assert {path.name: path.read_bytes() for path in base.iterdir()} == before
    assert [session.part for session in found.sessions] == [MAIN_PART] * 2
    # The closures of the drive were in its journal.
    num_before = ring_result.graph.num_nodes
    rows = found.graph.closure_rows >= 0
    assert (found.graph.index_b[rows] >= num_before).any()
    assert found.graph.num_nodes > 1.4 * num_before


@pytest.mark.slow
def test_the_old_map_gives_way_to_a_lifelong_drive(ring_result, ring_events, tmp_path):
    base = tmp_path / "base"
    ring_result.save(base)

    events = ring_events[: len(ring_events) // 2]
    result, _ = drive(events, base, tmp_path / "copy", onto=base, lifelong=True, start=IDENTITY)

    assert result.report.extra["lifelong"]["removed_nodes"] > 0
    again, _ = drive(ring_events[:200], base, tmp_path / "again", starts_at_end=True)
    assert not again.config.lifelong.enabled


@pytest.mark.slow
def test_a_drive_that_is_cut_short_replaces_the_map(ring_result, ring_events, tmp_path):
    base = tmp_path / "base"
    ring_result.save(base)
    stop = StopRequest()

    class Stopping(Recorder):
        def finishing(self, mapper, stage):
            stop.made = True

    sent = [json.dumps(message_of(event)).encode() + b"\n" for event in ring_events[:300]]
    options = LiveOptions(MessageOptions(waits=True), start=IDENTITY)
    with pytest.raises(Interrupted):
        map_live(Sender(sent), None, base, options, observer=Stopping(), stop=stop, onto=base)

    found = load_map(base)
    assert len(found.sessions) == 2
    assert not found.report.finished
    assert {path.name for path in base.iterdir()} == FILES


def test_a_map_that_was_saved_is_not_recovered_again(tmp_path):
    saved = small_result(finished=True)
    save(replace(saved, report=replace(saved.report, fingerprint="12ab")), tmp_path)
    before = (tmp_path / "map.cartoloop").read_bytes()
    write(tmp_path, RunHeader("live", "robot", "12ab", Config(), continues=True))

    map_to_continue(tmp_path, pytest.fail)

    assert (tmp_path / "map.cartoloop").read_bytes() == before
    assert not (tmp_path / FILE_NAME).exists()


def test_an_ended_map_is_continued_as_it_is(tmp_path):
    saved = small_result(finished=True)
    save(saved, tmp_path)
    before = (tmp_path / "map.cartoloop").read_bytes()

    found = map_to_continue(tmp_path, lambda _: None)

    assert last_pose(found) == tuple(saved.trajectory[-1])
    assert (tmp_path / "map.cartoloop").read_bytes() == before


def test_a_journal_becomes_the_map_first(tmp_path):
    write(tmp_path, RunHeader("live", "robot", "12ab", Config()))
    lines = []

    map_to_continue(tmp_path, lines.append)

    assert lines == [f"recovering the map of the interrupted run in {tmp_path}"]
    assert {path.name for path in tmp_path.iterdir()} == FILES
    assert not load_map(tmp_path).report.finished


def test_an_interrupted_recording_is_not_continued(tmp_path):
    write(tmp_path, RunHeader("map", "a.bag", "12ab", Config()))

    with pytest.raises(
        InputError, match=r"interrupted run of a recording \(a.bag\); end that first"
    ):
        map_to_continue(tmp_path, lambda _: None)


def test_a_folder_without_a_map_is_not_continued(tmp_path):
    with pytest.raises(InputError, match="is not there; give a folder"):
        map_to_continue(tmp_path, lambda _: None)


def write(folder, header):
    content = frame_bytes([record_bytes(Kind.HEADER, header.to_json())])
    (folder / FILE_NAME).write_bytes(PREAMBLE + content)


def test_a_drive_without_scans_leaves_the_map_alone(tmp_path):
    save(small_result(), tmp_path)
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}

    with pytest.raises(InputError, match="no scan has arrived"):
        map_live(Sender([]), None, tmp_path, onto=tmp_path)

    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before
