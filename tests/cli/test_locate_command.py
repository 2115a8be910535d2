# SPDX-License-Identifier: Apache-2.0
"""``cartoloop locate`` with recordings, on maps of other programs."""

from __future__ import annotations

import gzip
import json
import math
import os
import signal
from pathlib import Path

import pytest

from cartoloop.cli import locate_command
from cartoloop.cli.live_mapping import poses_stream
from cartoloop.cli.locate_command import change
from cartoloop.cli.main import run
from cartoloop.errors import OutputError
from cartoloop.localisation import run as localisation_run
from cartoloop.localisation.answer import Answer, Place, State
from cartoloop.sensor.pose import Pose
from tests.localisation.rooms import BOX, ROOM, START, apart, carmen_text, drive, write_image

POSES = drive(START, 40, step=0.04, turn=0.03)
HALL = (((0, 0), (30, 0), (30, 2.2), (0, 2.2)),)


@pytest.fixture
def room(tmp_path):
    return str(write_image(tmp_path, ROOM))


@pytest.fixture
def log(tmp_path):
    path = tmp_path / "drive.log"
    path.write_text(carmen_text(ROOM, POSES))
    return str(path)


def answers_in(path):
    return [json.loads(line) for line in path.read_text().splitlines()]


def test_each_scan_gets_a_line_with_its_pose_in_the_map(room, log, tmp_path, capsys):
    poses = tmp_path / "poses.jsonl"

    assert run(["locate", room, log, "--poses", str(poses), "--strict"]) == 0

    answers = answers_in(poses)
    assert len(answers) == len(POSES)
    assert answers[-1]["state"] == "located"
    assert apart(POSES[-1], answers[-1]["map"])[0] < 0.1
    assert len(answers[-1]["covariance"]) == 9
    assert 0.8 < answers[-1]["agreement"] <= 1.0
    assert "located" in capsys.readouterr().out


def test_poses_on_standard_output_are_alone_there(room, log, capfd):
    assert run(["locate", room, log, "--poses", "-"]) == 0

    captured = capfd.readouterr()
    assert all(json.loads(line)["type"] == "pose" for line in captured.out.splitlines())
    assert "located" in captured.err


def test_a_strict_run_that_never_locates_has_its_own_status(room, tmp_path, capsys):
    path = tmp_path / "hall.log"
    path.write_text(carmen_text(HALL, drive(POSES[0]._replace(x=3.0, y=1.1, theta=0.0), 10)))

    assert run(["locate", room, str(path), "--strict"]) == 3
    assert run(["locate", room, str(path)]) == 0
    assert "never" in capsys.readouterr().out


def test_a_pose_on_the_command_line_decides_between_places(tmp_path, capsys):
    box = str(write_image(tmp_path, BOX))
    path = tmp_path / "box.log"
    path.write_text(carmen_text(BOX, [START]))

    at = ["--at", f"4.5,3.6,{math.degrees(START.theta) + 5.0}"]
    assert run(["locate", box, str(path), *at, "--strict"]) == 0
    assert "x 4.70 m, y 3.40 m" in capsys.readouterr().out


def test_the_latest_pose_is_kept_and_begun_with(tmp_path):
    box = str(write_image(tmp_path, BOX))
    path, kept = tmp_path / "box.log", tmp_path / "kept.json"
    path.write_text(carmen_text(BOX, [START]))
    begin = ["--at", f"4.7,3.4,{math.degrees(START.theta)}"]
    assert run(["locate", box, str(path), *begin, "--keep", str(kept)]) == 0

    assert run(["locate", box, str(path), "--keep", str(kept), "--strict"]) == 0
    assert apart(START, json.loads(kept.read_text())["map"])[0] < 0.1


@pytest.mark.parametrize("content", ["", "[]", "{}", '{"type": "cartoloop pose", "map": [1, 2]}'])
def test_a_file_that_holds_no_kept_pose_is_refused(room, log, tmp_path, capsys, content):
    kept = tmp_path / "kept.json"
    kept.write_text(content)

    assert run(["locate", room, log, "--keep", str(kept)]) == 1
    message = capsys.readouterr().err.strip()
    assert "is no pose" in message
    assert kept.read_text() == content


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["locate", "{folder}/no.yaml", "{log}"], "no.yaml"),
        (["locate", "{folder}", "{log}"], "is not there"),
        (["locate", "{room}", "{folder}/no.log"], "no.log"),
        (["locate", "{room}", "tcp://192.0.2.1:7000"], "--source-host"),
        (["locate", "{room}", "{log}", "--poses", "{folder}/no/poses"], "--poses"),
    ],
)
def test_errors_are_a_line(room, log, tmp_path, capsys, arguments, says):
    places = {"folder": tmp_path / "empty", "room": room, "log": log}
    places["folder"].mkdir()

    status = run([argument.format(**places) for argument in arguments])

    last = capsys.readouterr().err.strip().splitlines()[-1]
    assert status == 1
    assert last.startswith("cartoloop: ")
    assert says in last


@pytest.mark.parametrize("name", ["{room}", "{log}", "{folder}/../drive.log", "{folder}/link"])
def test_poses_never_replace_what_is_read(room, log, tmp_path, capsys, name):
    folder = tmp_path / "sub"
    folder.mkdir()
    (folder / "link").symlink_to(log)
    file = Path(name.format(room=room, log=log, folder=folder))
    before = file.read_bytes()

    assert run(["locate", room, log, "--poses", str(file)]) == 1

    assert "is read by this command" in capsys.readouterr().err
    assert file.read_bytes() == before


def test_poses_never_replace_files_of_a_map(tmp_path):
    saved = tmp_path / "map.cartoloop"
    saved.write_bytes(b"map")

    with pytest.raises(OutputError, match="is a file of a map"), poses_stream(str(saved)):
        pass

    with poses_stream(str(tmp_path / "poses")) as stream:
        assert stream is not None
    assert saved.read_bytes() == b"map"


@pytest.mark.parametrize(
    "given", [["--source-host", "0.0.0.0"], ["--end-after", "1"], ["--no-drop"]]
)
def test_live_options_are_refused_for_recordings(room, log, capsys, given):
    assert run(["locate", room, log, *given]) == 2
    assert f"{given[0]}: is for live sources" in capsys.readouterr().err


def test_an_unwritable_keep_file_is_refused_at_once(room, log, tmp_path, capsys):
    assert run(["locate", room, log, "--keep", str(tmp_path / "nowhere" / "kept.json")]) == 1

    captured = capsys.readouterr()
    assert "cannot be written; give a file in a folder that can be" in captured.err
    assert "located" not in captured.out


def test_locating_goes_on_without_room_for_the_pose(room, log, tmp_path, monkeypatch, capsys):
    def full(path, kept):
        raise OutputError(f"{path}: cannot be written: No space left on device")

    monkeypatch.setattr(localisation_run, "KEEP_PERIOD_S", 0.1)
    monkeypatch.setattr(localisation_run, "write_pose_file", full)
    poses = tmp_path / "poses.jsonl"
    given = ["--poses", str(poses), "--keep", str(tmp_path / "kept.json")]

    assert run(["locate", room, log, *given]) == 1
    assert len(answers_in(poses)) == len(POSES)
    assert capsys.readouterr().err.count("localising goes on") == 1


def test_a_map_in_place_of_a_recording_is_named(room, tmp_path, capsys):
    (tmp_path / "map.cartoloop").write_bytes(b"")

    for path in (tmp_path, tmp_path / "map.cartoloop"):
        assert run(["locate", room, str(path)]) == 1
        assert "is a map, not a recording" in capsys.readouterr().err


def test_a_pose_that_does_not_fit_is_reported(room, log, tmp_path, capsys):
    given = ["locate", room, log, "--at", "1e308,0,0", "--poses", str(tmp_path / "poses.jsonl")]

    assert run(given) == 0

    assert "--at: the scan does not fit there" in capsys.readouterr().out


def test_a_recording_that_is_cut_off_is_reported(room, log, tmp_path, capsys):
    whole = gzip.compress(Path(log).read_bytes())
    cut = tmp_path / "cut.log.gz"
    cut.write_bytes(whole[: len(whole) // 2])

    assert run(["locate", room, str(cut), "--poses", str(tmp_path / "poses.jsonl")]) == 1

    captured = capsys.readouterr()
    assert "scans" in captured.out
    assert "the poses are of a part of the recording" in captured.err
    assert answers_in(tmp_path / "poses.jsonl")


def test_a_recording_that_is_stopped_has_its_own_status(room, log, tmp_path, monkeypatch, capsys):
    def stop(answer):
        os.kill(os.getpid(), signal.SIGINT)
        return "stopping"

    monkeypatch.setattr(locate_command, "change", stop)
    poses = tmp_path / "poses.jsonl"

    assert run(["locate", room, log, "--poses", str(poses)]) == 130

    assert 0 < len(answers_in(poses)) < len(POSES)
    assert "stopped after" in capsys.readouterr().err


def test_a_single_place_that_is_not_proved_has_no_probability():
    pose = Pose(1.0, 2.0, 0.0)
    answers = [
        Answer(
            7.0, State.AMBIGUOUS, None, None, pose, math.nan, math.nan, math.nan,
            tuple(Place(pose, 0.5, 0.6) for _ in range(count)),
        )
        for count in (1, 2)
    ]  # fmt: skip

    assert change(answers[0]).endswith(
        "one place fits, not proved yet: x 1.00 m, y 2.00 m, 0.0 deg"
    )
    assert "2 places fit, the likeliest (50%)" in change(answers[1])
