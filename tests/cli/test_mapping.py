# SPDX-License-Identifier: Apache-2.0
"""``cartoloop map`` around the mapper, which is a stand-in: stopping, failing, saving, telling."""

from __future__ import annotations

import json
import os
import signal
import sys
import types
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cartoloop.cli.main import run
from cartoloop.cli.map_command import default_folder
from cartoloop.cli.mapping import summary
from cartoloop.errors import InputError
from cartoloop.journal.frames import FILE_NAME as JOURNAL
from cartoloop.report import ConstraintSummary, InputSummary, Report
from cartoloop.sensor.events import LaserScan
from tests.map_output.small_result import FILES, small_result

NUM_SCANS = 40


class StandIn:
    """A mapper that puts every scan at the origin and can be shown to do something on the way."""

    made = 0
    at_scan = None  # (number, action)
    at_finish = None

    def __init__(self, config, calibration=None, **_):
        type(self).made += 1
        self.config = config
        self.stamps = []
        self.num_nodes = self.num_loop_closures = 0

    @property
    def num_scans(self):
        return len(self.stamps)

    def add(self, event):
        if isinstance(event, LaserScan):
            self.stamps.append(event.stamp)
            if self.at_scan and self.at_scan[0] == len(self.stamps):
                self.at_scan[1]()

    def result(self):
        poses = np.zeros((len(self.stamps), 3))
        summary = InputSummary(scans=len(self.stamps), duration_s=8.0)
        return replace(
            small_result(self.config),
            stamps=np.array(self.stamps),
            trajectory=poses,
            local_trajectory=poses,
            report=Report(input=summary, nodes=len(self.stamps), skipped={"no returns": 2}),
        )

    def finished(self):
        result = self.result()
        return replace(result, report=replace(result.report, finished=True))

    def finish(self, note=None):
        if self.at_finish:
            self.at_finish()
        return self.finished()

    def close(self):
        self.closed = True


@pytest.fixture
def mapper(monkeypatch):
    class Mapper(StandIn):
        pass

    module = types.ModuleType("cartoloop.mapper")
    module.Mapper = Mapper
    monkeypatch.setitem(sys.modules, "cartoloop.mapper", module)
    first_pass = types.ModuleType("cartoloop.first_pass")
    first_pass.recorded_calibration = lambda *_: None
    monkeypatch.setitem(sys.modules, "cartoloop.first_pass", first_pass)
    return Mapper


@pytest.fixture
def log(tmp_path):
    path = tmp_path / "some.log"
    ranges = " ".join(["5.00"] * 180)
    path.write_text(
        "".join(
            f"FLASER 180 {ranges} 0 0 0 0 0 0 {100 + 0.2 * k:.6f} robot {100 + 0.2 * k:.6f}\n"
            for k in range(NUM_SCANS)
        )
    )
    return path


def num_poses(folder):
    return len((folder / "trajectory.tum").read_text().splitlines()) - 1


def interrupt():
    os.kill(os.getpid(), signal.SIGINT)


def terminate():
    os.kill(os.getpid(), signal.SIGTERM)


def hang_up():
    os.kill(os.getpid(), signal.SIGHUP)


def fail():
    raise RuntimeError("the unforeseen\nhappened")


def run_out_of_memory(*_):
    raise MemoryError("Unable to allocate 142 PiB")


def end_of_input():
    raise InputError("some.log:12: the file is cut off")


def test_writes_all_files_and_names_the_picture(mapper, log, tmp_path, capsys):
    out = tmp_path / "out"

    assert run(["map", str(log), "-o", str(out), "--draw", "none", "--threads", "1"]) == 0

    assert {path.name for path in out.iterdir()} == FILES
    assert num_poses(out) == NUM_SCANS
    assert str(out / "map.png") in capsys.readouterr().out


def test_without_a_folder_it_is_named_after_the_recording(
    mapper, log, tmp_path, capsys, monkeypatch
):
    (tmp_path / "work").mkdir()
    monkeypatch.chdir(tmp_path / "work")

    assert run(["map", str(log)]) == 0

    assert {path.name for path in (tmp_path / "work" / "some-map").iterdir()} >= FILES
    assert "output         some-map\n" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("recording", "folder"),
    [
        ("x.bag", "x-map"),
        ("elsewhere/intel.clf.gz", "intel-map"),
        ("2024-01-01-10.30.00.bag", "2024-01-01-10.30.00-map"),
        ("x.bag.active", "x-map"),
        ("rosbag2_2024/", "rosbag2_2024-map"),
        ("/dev/stdin", "stdin-map"),
        ("-", "recording-map"),
        ("two\nlines\x1b[31m.log", "two_lines_[31m-map"),
    ],
)
def test_folders_are_named_after_recordings(recording, folder):
    assert default_folder(Path(recording)) == Path(folder)


def test_the_summary_has_one_line_for_any_folder():
    lines = summary(Report(), Path("two\nlines")).splitlines()
    assert lines[-1].endswith("two\\nlines/map.png")


def test_the_summary_says_in_words_what_the_counts_are():
    constraints = ConstraintSummary(loop_closure=2, rejected=1, searched=169, found=6)

    lines = summary(Report(constraints=constraints), Path("out")).splitlines()

    assert lines[3:5] == [
        "loop closures  2 in the map, 1 rejected because the others contradict them",
        "searches       169 pairs of a scan and a submap compared while mapping, 6 matched",
    ]


def test_the_report_has_name_times_and_skipped_lines(mapper, log, tmp_path):
    log.write_text(log.read_text() + "FLASER 180 1.0\n")

    run(["map", str(log), "-o", str(tmp_path / "out")])
    report = json.loads((tmp_path / "out" / "report.json").read_text())

    assert report["input"]["name"] == "some.log"
    assert report["wall_s"] > 0
    assert report["cpu_s"] > 0
    assert report["real_time_factor"] == pytest.approx(8.0 / report["wall_s"])
    assert report["skipped"]["no returns"] == 2
    assert len(report["skipped"]) == 2
    assert len(report["problems"]) == 1


def test_settings_reach_the_mapper_and_the_saved_configuration(mapper, log, tmp_path):
    (tmp_path / "my.toml").write_text("[local_slam.submaps]\nnum_range_data = 9\n")

    given = ["--config", str(tmp_path / "my.toml"), "--set", "sensor.max_range=7"]
    run(["map", str(log), "-o", str(tmp_path / "out"), *given])
    saved = (tmp_path / "out" / "config.toml").read_text()

    assert "num_range_data = 9" in saved
    assert "max_range = 7.0" in saved
    assert "file my.toml" in saved


@pytest.mark.parametrize("stop", [interrupt, terminate, hang_up])
def test_a_stop_in_the_middle_saves_what_was_mapped(mapper, log, tmp_path, capsys, stop):
    mapper.at_scan = (7, stop)

    assert run(["map", str(log), "-o", str(tmp_path / "out")]) == 130

    assert {path.name for path in (tmp_path / "out").iterdir()} == FILES | {JOURNAL}
    assert num_poses(tmp_path / "out") == 7
    assert "stopped after 7 scans" in capsys.readouterr().err


def test_a_second_interrupt_does_not_wait_for_the_scan(mapper, log, tmp_path):
    def twice():
        interrupt()
        interrupt()
        raise AssertionError("still running")

    mapper.at_scan = (7, twice)

    assert run(["map", str(log), "-o", str(tmp_path / "out")]) == 130
    assert num_poses(tmp_path / "out") == 7


def test_a_third_interrupt_says_that_nothing_was_saved(mapper, log, tmp_path, capsys, monkeypatch):
    def twice():
        interrupt()
        interrupt()

    def once_more(*_, **__):
        interrupt()
        raise AssertionError("still running")

    mapper.at_scan = (7, twice)
    monkeypatch.setattr("cartoloop.map_output.save.compose_map", once_more)

    assert run(["map", str(log), "-o", str(tmp_path / "out")]) == 130
    hint = f"--resume {tmp_path / 'out'} goes on with it"
    end = f"cartoloop: stopped at once: nothing was saved; {hint}\n"
    assert capsys.readouterr().err.endswith(end)
    assert [path.name for path in (tmp_path / "out").iterdir()] == [JOURNAL]


def test_a_hang_up_that_nohup_ignores_is_ignored(mapper, log, tmp_path):
    mapper.at_scan = (7, hang_up)
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        assert run(["map", str(log), "-o", str(tmp_path / "out")]) == 0
    finally:
        signal.signal(signal.SIGHUP, before)

    assert num_poses(tmp_path / "out") == NUM_SCANS


def test_a_stopped_run_keeps_a_finished_map(mapper, log, tmp_path, capsys):
    out = tmp_path / "out"
    assert run(["map", str(log), "-o", str(out)]) == 0
    mapper.at_scan = (7, interrupt)

    assert run(["map", str(log), "-o", str(out)]) == 130

    assert num_poses(out) == NUM_SCANS
    assert num_poses(out / "stopped") == 7
    error = capsys.readouterr().err
    assert f"writing {out / 'stopped'}\n" in error
    assert f"the map of these is in {out / 'stopped'}, since {out} holds a finished map" in error


def test_the_map_of_another_recording_is_kept_unless_allowed(mapper, log, tmp_path, capsys):
    other, out = tmp_path / "other.log", str(tmp_path / "out")
    other.write_text("".join(log.read_text().splitlines(keepends=True)[:9]))
    assert run(["map", str(log), "-o", out]) == 0
    capsys.readouterr()

    assert run(["map", str(other), "-o", out]) == 1
    refusal = capsys.readouterr()
    assert refusal.out == ""
    assert "holds another map (of some.log)" in refusal.err
    assert num_poses(tmp_path / "out") == NUM_SCANS

    assert run(["map", str(other), "-o", out, "--overwrite"]) == 0
    assert num_poses(tmp_path / "out") == 9


def test_the_folder_is_checked_before_the_recording_is_read(mapper, log, tmp_path, capsys):
    (tmp_path / "broken.log").write_text("no log at all\n")

    assert run(["map", str(tmp_path / "broken.log"), "-o", str(log / "out")]) == 1
    assert "cannot write there" in capsys.readouterr().err


def test_a_stop_of_the_last_pass_saves_what_was_mapped(mapper, log, tmp_path, capsys):
    mapper.at_finish = staticmethod(interrupt)

    assert run(["map", str(log), "-o", str(tmp_path / "out")]) == 130
    assert num_poses(tmp_path / "out") == NUM_SCANS
    assert "stopped after 40 scans" in capsys.readouterr().err


def test_signals_are_as_before_afterwards(mapper, log, tmp_path):
    numbers = signal.SIGINT, signal.SIGTERM, signal.SIGHUP
    before = [signal.getsignal(number) for number in numbers]

    run(["map", str(log), "-o", str(tmp_path / "out")])

    assert [signal.getsignal(number) for number in numbers] == before


@pytest.mark.parametrize(
    ("failure", "message"),
    [
        (fail, "unexpected RuntimeError: the unforeseen happened"),
        (end_of_input, "is cut off"),
        (run_out_of_memory, "there is not enough memory (Unable to allocate 142 PiB); end other"),
    ],
)
def test_a_failure_saves_the_map_and_is_reported_in_a_line(
    mapper, log, tmp_path, capsys, failure, message
):
    mapper.at_scan = (7, failure)

    assert run(["map", str(log), "-o", str(tmp_path / "out")]) == 1

    error = capsys.readouterr().err
    assert num_poses(tmp_path / "out") == 7
    assert message in error.splitlines()[-1]
    assert "Traceback" not in error


def test_debug_shows_where_the_unexpected_happened(mapper, log, tmp_path, capsys):
    mapper.at_scan = (7, fail)

    assert run(["map", str(log), "-o", str(tmp_path / "out"), "--debug"]) == 1
    assert "in fail" in capsys.readouterr().err


def test_an_unwritable_folder_is_reported_before_mapping(mapper, log, tmp_path, capsys):
    assert run(["map", str(log), "-o", str(log / "out")]) == 1

    assert mapper.made == 0
    assert "cannot write there" in capsys.readouterr().err


@pytest.mark.parametrize("content", [None, b"", b"no log at all\n", b"\x1f\x8b\x00"])
def test_a_file_that_is_no_recording_is_reported_in_a_line(mapper, tmp_path, capsys, content):
    path = tmp_path / "bad.log"
    if content is not None:
        path.write_bytes(content)

    assert run(["map", str(path), "-o", str(tmp_path / "out")]) == 1

    error = capsys.readouterr().err
    assert error.startswith("cartoloop: ")
    assert "bad.log" in error
    assert error.count("\n") == 1
    assert not (tmp_path / "out").exists()
