# SPDX-License-Identifier: Apache-2.0
"""Mapping a whole recording from Python."""

from __future__ import annotations

import json

import pytest

import cartoloop
from cartoloop.errors import InputError, Interrupted, OutputError
from cartoloop.runs.observer import RunObserver
from cartoloop.sensor.repeated_scans import SENT_AGAIN
from cartoloop.simulation import ring, simulate
from cartoloop.stop_request import StopRequest

NUM_SCANS = 41


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    """A short recording with a damaged line."""
    path = tmp_path_factory.mktemp("run") / "ring.log"
    simulate(ring(), seed=1, duration=0.2 * (NUM_SCANS - 1)).write_carmen(path)
    path.write_text(path.read_text() + "FLASER 180 1.0\n")
    return path


class Recorder(RunObserver):
    """Records the calls, and stops or interrupts at a scan."""

    def __init__(self, stop=None, stop_at=None, interrupt_at=None):
        self.calls, self.num_events = [], 0
        self.stop, self.stop_at, self.interrupt_at = stop, stop_at, interrupt_at

    def started(self, num_scans):
        self.calls.append(("started", num_scans))

    def after_event(self, mapper, event):
        self.num_events += 1
        if mapper.num_scans == self.stop_at:
            self.stop.made = True
        if mapper.num_scans == self.interrupt_at:
            raise KeyboardInterrupt

    def finishing(self, mapper, stage):
        if stage is None:
            self.calls.append("finishing")

    def mapped(self, result, failure):
        self.calls.append(("mapped", failure))

    def saving(self, folder):
        self.calls.append(("saving", folder))

    def saved(self, result, failure):
        self.calls.append(("saved", failure))


def test_the_report_has_name_times_and_skipped_lines(log, tmp_path):
    result = cartoloop.map_recording(log, out=tmp_path / "out")

    report = json.loads((tmp_path / "out" / "report.json").read_text())
    assert report["input"]["name"] == result.report.input.name == "ring.log"
    assert report["wall_s"] == result.report.wall_s > 0.0
    assert report["real_time_factor"] == pytest.approx(8.0 / report["wall_s"])
    assert sum(report["skipped"].values()) == len(report["problems"]) == 1
    assert len(result.stamps) == NUM_SCANS
    assert (tmp_path / "out" / "map.png").exists()


def test_without_a_folder_nothing_is_written(log, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    result = cartoloop.map_recording([log])

    assert result.report.wall_s > 0.0
    assert list(tmp_path.iterdir()) == []


def test_the_observer_is_called_in_order(log):
    recorder = Recorder()
    cartoloop.map_recording(log, observer=recorder)

    assert recorder.num_events == 2 * NUM_SCANS
    assert recorder.calls == [
        ("started", NUM_SCANS),
        "finishing",
        ("mapped", None),
        ("saved", None),
    ]


@pytest.mark.parametrize("how", [{"stop_at": 7}, {"interrupt_at": 7}])
def test_a_stopped_run_saves_its_map(log, tmp_path, how):
    stop = StopRequest()
    with pytest.raises(Interrupted, match="stopped after 7 scans; the map of these is in"):
        cartoloop.map_recording(
            log, out=tmp_path / "out", observer=Recorder(stop, **how), stop=stop
        )

    assert len((tmp_path / "out" / "trajectory.tum").read_text().splitlines()) == 7 + 1


def test_a_map_of_few_of_the_scans_is_an_error(log, tmp_path):
    bad = [f"FLASER 9 1.0 {k}\n" for k in range(2 * NUM_SCANS)]
    (tmp_path / "bad.log").write_text(log.read_text() + "".join(bad))

    with pytest.raises(InputError, match=r"bad\.log: 83 of 124 scans were skipped, the map in .*"):
        cartoloop.map_recording(tmp_path / "bad.log", out=tmp_path / "out")
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    assert report["finished"] is False
    assert sum(report["skipped"].values()) == 83


def test_a_map_of_most_of_the_scans_is_a_success(log, tmp_path):
    bad = [f"FLASER 9 1.0 {k}\n" for k in range(NUM_SCANS - 1)]
    (tmp_path / "bad.log").write_text(log.read_text() + "".join(bad))

    assert cartoloop.map_recording(tmp_path / "bad.log").report.finished


def test_scans_that_are_sent_four_times_are_no_loss(tmp_path):
    lines, ranges, number = [], [], 0
    simulate(ring(), seed=1, duration=24.0).write_carmen(tmp_path / "ring.log")
    for line in (tmp_path / "ring.log").read_text().splitlines():
        words = line.split()
        if words[0] == "FLASER":
            beams = slice(2, 2 + int(words[1]))
            ranges = words[beams] if number % 4 == 0 else ranges
            words[beams], number = ranges, number + 1
        lines.append(" ".join(words) + "\n")
    (tmp_path / "fast.log").write_text("".join(lines))

    result = cartoloop.map_recording(tmp_path / "fast.log")

    assert result.report.finished
    assert result.report.skipped == {SENT_AGAIN: 121 - len(result.stamps)}
    assert len(result.stamps) < 0.5 * 121


def test_another_recording_is_refused_before_it_is_read(log, tmp_path):
    cartoloop.map_recording(log, out=tmp_path / "out")
    (tmp_path / "no.log").write_text("no log at all")

    with pytest.raises(OutputError, match="holds another map"):
        cartoloop.map_recording(tmp_path / "no.log", out=tmp_path / "out")
    with pytest.raises(InputError, match="not in a known format"):
        cartoloop.map_recording(tmp_path / "no.log", out=tmp_path / "out", overwrite=True)


def test_a_run_stopped_before_its_first_scan_saves_nothing(log, tmp_path):
    stop = StopRequest()
    stop.made = True

    with pytest.raises(Interrupted, match="stopped before the first scan: nothing was saved"):
        cartoloop.map_recording(log, out=tmp_path / "out", stop=stop)
    assert list((tmp_path / "out").iterdir()) == []


class Breaking(RunObserver):
    """Makes the folder impossible to write while the recording is mapped."""

    def __init__(self, folder):
        self.folder = folder

    def finishing(self, mapper, stage):
        if stage is None:
            self.folder.rename(self.folder.with_name("elsewhere"))
            self.folder.write_text("now a file")


def test_a_map_whose_folder_is_gone_is_saved_elsewhere(log, tmp_path, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    out = tmp_path / "out"

    with pytest.raises(OutputError, match=r"cannot write there.*; the map was saved in .* instead"):
        cartoloop.map_recording(log, out=out, observer=Breaking(out))
    (place,) = tmp_path.glob("cartoloop-*")
    assert len(cartoloop.load(place).stamps) == NUM_SCANS


def test_an_empty_map_is_an_error(tmp_path):
    ranges = " ".join(["81.91"] * 180)
    lines = [f"FLASER 180 {ranges} 0 0 0 0 0 0 {k}.0 robot {k}.0\n" for k in range(1, 20)]
    (tmp_path / "blind.log").write_text("".join(lines))

    with pytest.raises(InputError, match=r"blind\.log: no scan has enough returns"):
        cartoloop.map_recording(tmp_path / "blind.log", out=tmp_path / "out")
    assert (tmp_path / "out" / "report.json").exists()
