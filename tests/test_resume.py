# SPDX-License-Identifier: Apache-2.0
"""Runs that are interrupted and resumed: the same bytes in the end, whenever it happened."""

from __future__ import annotations

import json
import random
import shutil
from dataclasses import replace

import pytest

import cartoloop
from cartoloop.config import Config
from cartoloop.config_file import load_config
from cartoloop.errors import InputError, Interrupted, OutputError
from cartoloop.journal.frames import FILE_NAME, PREAMBLE, Kind, frame_bytes, record_bytes
from cartoloop.map_file.file_set import FILES
from cartoloop.map_file.run_header import RunHeader, read_journal
from cartoloop.readers.read_options import ReadOptions
from cartoloop.runs.journal import RunJournal
from cartoloop.runs.observer import RunObserver
from cartoloop.runs.recording import map_recording
from cartoloop.runs.resuming import resume_recording
from cartoloop.sensor.pose import Pose
from cartoloop.simulation import ring, simulate
from cartoloop.stop_request import StopRequest

SETTINGS = (
    "local_slam.submaps.num_range_data=20",
    "global_slam.optimize_every_n_nodes=30",
    "global_slam.constraint_search.wide_search.min_path_length=10",
)
"""Small submaps, so that all kinds of records come up in a short drive."""


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    """A drive once around a small ring."""
    path = tmp_path_factory.mktemp("drive") / "ring.log"
    simulate(ring(), seed=1, duration=125.0).write_carmen(path)
    return path


@pytest.fixture(scope="module")
def settings():
    return load_config(None, SETTINGS)


@pytest.fixture(scope="module")
def whole(log, settings, tmp_path_factory):
    """The folder of a run without interruption, with the journal as it was at the end."""
    folder = tmp_path_factory.mktemp("whole")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(RunJournal, "remove", RunJournal.close)
        map_recording(log, settings, folder)
    return folder


def contents(folder):
    return {
        path.name: path.read_bytes()
        for path in folder.iterdir()
        if path.name not in (FILE_NAME, "report.json")
    }


def lasting(folder):
    """What of a report is the same in each run."""
    report = json.loads((folder / "report.json").read_text())
    for key in ("wall_s", "cpu_s", "peak_memory_mb", "real_time_factor", "stages"):
        del report[key]
    report["adjustment"] = [
        {key: value for key, value in run.items() if key != "ms"}
        for run in report["adjustment"]["each"]
    ]
    return report


def interrupted(whole, folder, share, random_bytes=b""):
    """Leave a folder as a run does that was killed."""
    journal = (whole / FILE_NAME).read_bytes()
    end = header_end(whole) + round(share * (len(journal) - header_end(whole)))
    folder.mkdir(exist_ok=True)
    (folder / FILE_NAME).write_bytes(journal[:end] + random_bytes)


def header_end(whole):
    data = (whole / FILE_NAME).read_bytes()
    return len(PREAMBLE) + 8 + int.from_bytes(data[len(PREAMBLE) : len(PREAMBLE) + 4], "little")


@pytest.mark.slow
@pytest.mark.parametrize("share", [0.0, 0.21, 0.5, 0.83, 1.0])
def test_a_resumed_run_ends_in_the_same_bytes(log, whole, tmp_path, share):
    interrupted(whole, tmp_path, share, random.Random(share).randbytes(100))

    resume_recording(log, out=tmp_path)

    assert contents(tmp_path) == contents(whole)
    assert lasting(tmp_path) == lasting(whole)
    assert {path.name for path in tmp_path.iterdir()} == set(FILES)


def test_what_was_computed_is_not_computed_again(log, whole, tmp_path, monkeypatch):
    def compute(*_):
        raise AssertionError("computed again")

    for place in (
        "first_pass.calibrate",
        "local_slam.scan_matcher.ScanMatcher.match",
        "local_slam.wall_step.WallStep.better_pose",
        "submaps.submap.insert_cells",
        "global_slam.constraint_search.search",
        "global_slam.wide_search.find_scans",
    ):
        monkeypatch.setattr(f"cartoloop.{place}", compute)
    interrupted(whole, tmp_path, 1.0)

    resume_recording(log, out=tmp_path)

    assert contents(tmp_path) == contents(whole)


def test_a_journal_has_records_of_all_kinds(whole):
    kinds = {record.kind for record in read_journal(whole / FILE_NAME)[1].records}

    assert kinds == set(Kind) - {Kind.HEADER, Kind.DROPPED, Kind.JOIN_SEARCHED, Kind.JOIN_DECIDED}


class StoppingAt(RunObserver):
    """Stops a run at a scan."""

    def __init__(self, stop, num_scans):
        self.stop, self.num_scans, self.num_resumed = stop, num_scans, 0

    def resumed(self, num_scans):
        self.num_resumed = num_scans

    def after_event(self, mapper, event):
        if mapper.num_scans == self.num_scans:
            self.stop.made = True


def stop_at(log, num_scans, out, run=map_recording, **options):
    stop = StopRequest()
    observer = StoppingAt(stop, num_scans)
    with pytest.raises(Interrupted) as error:
        run(log, out=out, stop=stop, observer=observer, **options)
    return observer, str(error.value)


def test_a_stopped_run_is_resumed_again_and_again(log, settings, whole, tmp_path):
    _, message = stop_at(log, 200, tmp_path, config=settings)
    assert f"--resume {tmp_path} goes on with it" in message
    assert (tmp_path / "map.png").exists()
    observer, _ = stop_at(log, 400, tmp_path, run=resume_recording)
    assert 195 <= observer.num_resumed <= 200

    resume_recording(log, out=tmp_path)

    assert contents(tmp_path) == contents(whole)
    assert not (tmp_path / FILE_NAME).exists()


def test_a_stop_before_it_came_as_far_loses_nothing(log, whole, tmp_path):
    interrupted(whole, tmp_path, 0.8)
    journal = tmp_path / FILE_NAME
    whole_frames = journal.read_bytes()[: read_journal(journal)[1].size]
    _, message = stop_at(log, 50, tmp_path, run=resume_recording)

    assert "before the run had come as far as before: nothing was saved" in message
    assert journal.read_bytes() == whole_frames
    assert [path.name for path in tmp_path.iterdir()] == [FILE_NAME]


def test_a_finished_map_is_not_mapped_again(log, whole, tmp_path):
    shutil.copytree(whole, tmp_path, dirs_exist_ok=True)
    (tmp_path / FILE_NAME).unlink()
    before = contents(tmp_path)

    result = resume_recording(log, out=tmp_path)

    assert len(result.stamps) == len(cartoloop.load_map(whole).stamps)
    assert contents(tmp_path) == before


def test_where_nothing_was_begun_nothing_is_resumed(log, tmp_path):
    with pytest.raises(OutputError, match="holds no interrupted run; map without --resume"):
        resume_recording(log, out=tmp_path)


def test_another_recording_does_not_resume_a_run(whole, tmp_path):
    other = tmp_path / "other.log"
    simulate(ring(), seed=2, duration=10.0).write_carmen(other)
    out = tmp_path / "out"
    interrupted(whole, out, 0.5)
    before = (out / FILE_NAME).read_bytes()

    with pytest.raises(InputError, match=r"interrupted run of another recording \(ring.log\)"):
        resume_recording(other, out=out)
    with pytest.raises(OutputError, match=r"holds an interrupted run \(of ring.log\)"):
        map_recording(other, out=out)
    assert (out / FILE_NAME).read_bytes() == before


def test_other_parameters_do_not_resume_a_run(log, whole, tmp_path):
    interrupted(whole, tmp_path, 0.5)

    with pytest.raises(InputError, match=r"other parameters \(local_slam.submaps.num_range_data"):
        resume_recording(log, tmp_path, Config())
    options = ReadOptions(laser_pose=Pose(0.1, 0.0, 0.0))
    with pytest.raises(InputError, match="another laser pose of the recording"):
        resume_recording(log, out=tmp_path, options=options)


def with_header(folder, **changes):
    """Change the header of a journal."""
    header, content = read_journal(folder / FILE_NAME)
    changed = replace(header, **changes)
    records = [record_bytes(Kind.HEADER, changed.to_json())]
    records += [record_bytes(kind, bytes(payload)) for kind, payload in content.records]
    (folder / FILE_NAME).write_bytes(PREAMBLE + frame_bytes(records))


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"program": "0.0.9"}, "cartoloop 0.0.9 began it"),
        ({"environment": {"machine": "abacus"}}, "it was begun with machine abacus"),
        ({"kind": "live"}, "holds a live run that was interrupted"),
    ],
)
def test_a_run_of_another_program_is_not_resumed(log, whole, tmp_path, changes, reason):
    interrupted(whole, tmp_path, 0.5)
    with_header(tmp_path, **changes)

    with pytest.raises(InputError, match=reason):
        resume_recording(log, out=tmp_path)


def test_a_header_is_read_as_it_was_written(settings):
    header = RunHeader("map", "a.log", "12ab", settings.config, settings.origins, {"echo": "first"})

    assert RunHeader.from_json(memoryview(header.to_json())) == header


def test_an_interrupted_run_opens_as_a_map(whole, tmp_path):
    finished = cartoloop.load_map(whole)
    interrupted(whole, tmp_path, 0.9)

    result = cartoloop.load_map(tmp_path)

    count = len(result.stamps)
    assert 0.5 * len(finished.stamps) < count <= len(finished.stamps)
    assert result.stamps.tolist() == finished.stamps[:count].tolist()
    assert result.local_trajectory.tolist() == finished.local_trajectory[:count].tolist()
    errors = result.trajectory[:, :2] - finished.trajectory[:count, :2]
    assert abs(errors).max() < 0.3
    assert result.graph.num_loop_closures > 0
    assert not result.report.finished
    grids = result.submap_grids
    assert len(grids) == result.graph.num_submaps
    same = [grid.packed == finished.submap_grids[i].packed for i, grid in enumerate(grids)]
    assert all(same[:-2])
    result.save(tmp_path / "saved")
    assert {path.name for path in (tmp_path / "saved").iterdir()} == set(FILES)


def test_a_map_beside_a_journal_is_the_map(whole, tmp_path):
    shutil.copytree(whole, tmp_path, dirs_exist_ok=True)
    interrupted(whole, tmp_path, 0.5)

    assert cartoloop.load_map(tmp_path).report.finished
    assert not cartoloop.load_map(tmp_path / FILE_NAME).report.finished
