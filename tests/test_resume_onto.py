# SPDX-License-Identifier: Apache-2.0
"""Runs that add a session to a map and are interrupted: resumed, opened, and the old map stays."""

from __future__ import annotations

import json
import shutil

import numpy as np
import pytest
from test_resume import StoppingAt, contents

import cartoloop
from cartoloop.config_file import load_config
from cartoloop.errors import InputError, Interrupted, OutputError
from cartoloop.journal.frames import FILE_NAME, PREAMBLE, Kind
from cartoloop.map_file.file_set import FILES
from cartoloop.map_file.run_header import BaseOfRun, RunHeader, read_journal
from cartoloop.runs.base import base_of_resumed_run
from cartoloop.runs.journal import InterruptedRun, RunJournal
from cartoloop.runs.recording import map_recording
from cartoloop.runs.resuming import resume_recording
from cartoloop.sensor.pose import Pose, wrap_angles
from cartoloop.session import MAIN_PART
from cartoloop.simulation import ring, simulate
from cartoloop.stop_request import StopRequest

OPTIONS = (
    "local_slam.submaps.num_range_data=20",
    "global_slam.optimize_every_n_nodes=30",
    "global_slam.constraint_search.wide_search.min_path_length=10",
)
SETTINGS = load_config(None, OPTIONS)


def drive(folder, name, seed):
    path = folder / name
    simulate(ring(), seed=seed, duration=60.0).write_carmen(path)
    return path


@pytest.fixture(scope="module")
def first(tmp_path_factory):
    """The folder of the map of a drive."""
    folder = tmp_path_factory.mktemp("first")
    map_recording(drive(folder, "one.log", 1), SETTINGS, folder / "map")
    return folder / "map"


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    """Another drive in the same place."""
    return drive(tmp_path_factory.mktemp("second"), "two.log", 2)


@pytest.fixture(scope="module")
def whole(first, log, tmp_path_factory):
    """The folder of a run without interruption, with the journal as it was at the end."""
    folder = tmp_path_factory.mktemp("whole") / "map"
    shutil.copytree(first, folder)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(RunJournal, "remove", RunJournal.close)
        map_recording(log, SETTINGS, folder, onto=folder)
    return folder


def interrupted(first, whole, folder, share):
    """Leave a folder as a run does that was killed: the old map and a part of a journal."""
    shutil.copytree(first, folder, dirs_exist_ok=True)
    journal = (whole / FILE_NAME).read_bytes()
    head = len(PREAMBLE)
    begin = head + 8 + int.from_bytes(journal[head : head + 4], "little")
    (folder / FILE_NAME).write_bytes(journal[: begin + round(share * (len(journal) - begin))])


@pytest.mark.slow
@pytest.mark.parametrize("share", [0.0, 0.5, 0.9])
def test_a_resumed_run_ends_in_the_same_bytes(first, log, whole, tmp_path, share):
    interrupted(first, whole, tmp_path, share)

    result = resume_recording(log, out=tmp_path)

    assert [session.part for session in result.sessions] == [MAIN_PART, MAIN_PART]
    assert contents(tmp_path) == contents(whole)
    assert {path.name for path in tmp_path.iterdir()} == set(FILES)


@pytest.fixture(scope="module")
def followed(first, log, tmp_path_factory):
    """The folder of a run that may search for its place twenty times only, with its journal."""
    settings = load_config(None, (*OPTIONS, "global_slam.constraint_search.join.max_searches=20"))
    folder = tmp_path_factory.mktemp("followed") / "map"
    shutil.copytree(first, folder)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(RunJournal, "remove", RunJournal.close)
        map_recording(log, settings, folder, onto=folder)
    return folder


def test_a_place_where_few_scans_fit_is_followed(followed):
    result = cartoloop.load(followed)
    (join,) = result.report.extra["joins"]
    assert join["joined"]
    assert join["searches"] == 20
    assert join["agreeing_scans"] > 10


@pytest.mark.slow
def test_a_resumed_run_follows_the_same_places(first, log, followed, tmp_path):
    interrupted(first, followed, tmp_path, 0.9)

    resume_recording(log, out=tmp_path)

    assert contents(tmp_path) == contents(followed)


def test_what_was_computed_is_not_computed_again(first, log, whole, tmp_path, monkeypatch):
    def compute(*_, **__):
        raise AssertionError("computed again")

    for place in (
        "first_pass.calibrate",
        "local_slam.scan_matcher.ScanMatcher.match",
        "global_slam.constraint_search.search",
        "global_slam.wide_search.find_scans",
        "global_slam.joining.find_scans",
        "global_slam.part_joins.tentative_joins",
    ):
        monkeypatch.setattr(f"cartoloop.{place}", compute)
    interrupted(first, whole, tmp_path, 1.0)

    resume_recording(log, out=tmp_path)

    assert contents(tmp_path) == contents(whole)
    assert {path.name for path in tmp_path.iterdir()} == set(FILES)


def test_the_journal_has_the_searches_and_the_join(whole):
    kinds = {record.kind for record in read_journal(whole / FILE_NAME)[1].records}

    assert {Kind.JOIN_SEARCHED, Kind.JOIN_DECIDED} <= kinds


def stopped(log, onto, out):
    stop = StopRequest()
    with pytest.raises(Interrupted) as error:
        map_recording(log, SETTINGS, out, onto=onto, stop=stop, observer=StoppingAt(stop, 150))
    return str(error.value)


@pytest.mark.slow
def test_a_stopped_run_leaves_the_old_map_and_is_resumed(first, log, whole, tmp_path):
    shutil.copytree(first, tmp_path, dirs_exist_ok=True)
    before = contents(tmp_path)

    message = stopped(log, tmp_path, tmp_path)

    assert f"--resume {tmp_path} goes on with it" in message
    assert {name: (tmp_path / name).read_bytes() for name in before} == before
    resume_recording(log, out=tmp_path)
    assert {name: (tmp_path / name).read_bytes() for name in before} == contents(whole)


@pytest.mark.slow
def test_a_run_into_another_folder_is_resumed(first, log, whole, tmp_path):
    stopped(log, first, tmp_path)

    resume_recording(log, out=tmp_path)

    assert contents(tmp_path) == contents(whole)
    assert len(cartoloop.load_map(first).sessions) == 1


def test_an_interrupted_run_opens_with_the_map_before(first, whole, tmp_path):
    interrupted(first, whole, tmp_path, 0.95)
    before, after = cartoloop.load_map(first), cartoloop.load_map(whole)

    assert len(cartoloop.load_map(tmp_path).sessions) == 1
    opened = cartoloop.load_map(tmp_path / FILE_NAME)

    assert [session.part for session in opened.sessions] == [MAIN_PART, MAIN_PART]
    assert opened.sessions[1].recording == "two.log"
    count = len(opened.stamps)
    assert len(before.stamps) < count <= len(after.stamps)
    errors = opened.trajectory[:, :2] - after.trajectory[:count, :2]
    assert abs(errors).max() < 0.3
    assert opened.graph.num_loop_closures > before.graph.num_loop_closures
    assert not opened.report.finished
    opened.save(tmp_path / "saved")


def test_before_it_finds_its_place_the_session_is_apart(first, whole, tmp_path):
    interrupted(first, whole, tmp_path, 0.05)

    opened = cartoloop.load_map(tmp_path / FILE_NAME)

    assert [session.part for session in opened.sessions] == [MAIN_PART, 1]
    before = cartoloop.load_map(first)
    count = before.graph.num_nodes
    apart = opened.graph.node_poses[:count] - before.graph.node_poses
    apart[:, 2] = wrap_angles(apart[:, 2])
    assert np.abs(apart).max() < 0.05  # the chain counts less while mapping


def test_without_the_map_before_the_session_opens_alone(whole, tmp_path):
    shutil.copy(whole / FILE_NAME, tmp_path)

    opened = cartoloop.load_map(tmp_path)

    [session] = opened.sessions
    assert session.first_node == 0
    assert opened.graph.num_nodes > 100


def test_a_map_that_has_changed_is_not_added_to(first, log, whole, tmp_path):
    interrupted(first, whole, tmp_path, 0.5)
    (tmp_path / "map.cartoloop").write_bytes((whole / "map.cartoloop").read_bytes())
    (tmp_path / "report.json").unlink()
    damage = json.loads((first / "report.json").read_text())
    (tmp_path / "report.json").write_text(json.dumps(damage))

    with pytest.raises(InputError, match=r"is not the map any more .* `cartoloop merge"):
        resume_recording(log, out=tmp_path)


def test_a_run_killed_after_it_was_saved_has_ended(log, whole, tmp_path):
    shutil.copytree(whole, tmp_path, dirs_exist_ok=True)

    result = resume_recording(log, out=tmp_path)

    assert len(result.sessions) == 2
    assert {path.name for path in tmp_path.iterdir()} == set(FILES)


def test_an_ended_run_has_nothing_to_resume(log, whole, tmp_path):
    shutil.copytree(whole, tmp_path, dirs_exist_ok=True)
    (tmp_path / FILE_NAME).unlink()

    assert len(resume_recording(log, out=tmp_path).sessions) == 2


def test_a_pose_in_the_map_is_kept_for_later(first, log, tmp_path):
    stop = StopRequest()
    pose = Pose(0.0, 0.0, 0.0)
    with pytest.raises(Interrupted):
        map_recording(
            log,
            SETTINGS,
            tmp_path,
            onto=first,
            onto_pose=pose,
            stop=stop,
            observer=StoppingAt(stop, 20),
        )
    header = read_journal(tmp_path / FILE_NAME)[0]
    assert header.base.pose == pose
    assert header.base.path == str(first)


def test_an_interrupted_run_of_another_drive_stays(first, whole, tmp_path):
    interrupted(first, whole, tmp_path, 0.5)
    before = (tmp_path / FILE_NAME).read_bytes()
    other = tmp_path.parent / "three.log"
    simulate(ring(), seed=3, duration=10.0).write_carmen(other)

    with pytest.raises(OutputError, match=r"holds an interrupted run \(of one.log \+ two.log\)"):
        map_recording(other, SETTINGS, tmp_path, onto=tmp_path)
    assert (tmp_path / FILE_NAME).read_bytes() == before


def test_a_map_that_was_moved_is_asked_for(tmp_path):
    moved = tmp_path / "moved"
    base = BaseOfRun(str(moved), "0" * 16, ("two.log", ""), None)
    header = RunHeader("map", "two.log", "", SETTINGS.config, base=base)

    with pytest.raises(InputError, match=r"moved\) is not there any more: give it with --onto"):
        base_of_resumed_run(InterruptedRun(tmp_path, header), None)
