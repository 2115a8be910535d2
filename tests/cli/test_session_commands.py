# SPDX-License-Identifier: Apache-2.0
"""``cartoloop map --onto`` and ``cartoloop merge`` from the command line."""

from __future__ import annotations

import io
from contextlib import redirect_stdout

import pytest

from cartoloop.cli.main import run
from cartoloop.cli.options import parse_pose_deg
from cartoloop.cli.session_lines import APART_STATUS
from cartoloop.errors import InputError
from cartoloop.result import load_map
from cartoloop.session import MAIN_PART
from cartoloop.simulation import ring, simulate
from tests.map_output.small_result import FILES, small_result

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def ring_folder(ring_result, tmp_path_factory):
    folder = tmp_path_factory.mktemp("ring")
    ring_result.save(folder)
    return folder


@pytest.fixture
def own_ring_folder(ring_result, tmp_path):
    ring_result.save(tmp_path / "own")
    return tmp_path / "own"


@pytest.fixture(scope="module")
def another_log(tmp_path_factory):
    """A drive along one side of the ring, in the same building."""
    path = tmp_path_factory.mktemp("another") / "another.log.gz"
    simulate(ring(), seed=3, duration=45.0).write_log(path)
    return path


@pytest.fixture(scope="module")
def strange_log(tmp_path_factory):
    path = tmp_path_factory.mktemp("strange") / "strange.log.gz"
    simulate(ring(seed=7), seed=2, duration=20.0).write_log(path)
    return path


@pytest.fixture(scope="module")
def added(ring_result, another_log, tmp_path_factory):
    """A map in whose folder a recording was added, and what the command said."""
    folder, said = tmp_path_factory.mktemp("added"), io.StringIO()
    ring_result.save(folder)
    with redirect_stdout(said):
        assert run(["map", str(another_log), "--onto", str(folder)]) == 0
    return folder, said.getvalue()


def parts(folder):
    return [session.part for session in load_map(folder).sessions]


def names(folder):
    return {path.name for path in folder.iterdir()}


def test_recording_is_added_to_a_map_in_its_folder(added):
    folder, said = added
    assert parts(folder) == [MAIN_PART, MAIN_PART]
    assert names(folder) == FILES
    assert "2 of 2 in one map" in said
    assert "scans agree" in said


def test_added_session_has_the_name_of_its_recording(added, another_log):
    _, second = load_map(added[0]).sessions
    assert second.recording == second.name == another_log.name
    assert second.fingerprint


def test_trajectory_has_the_scans_of_both_sessions(ring_folder, another_log, tmp_path):
    out = tmp_path / "both"
    assert run(["map", str(another_log), "--onto", str(ring_folder), "-o", str(out)]) == 0
    lines = (out / "trajectory.tum").read_text().splitlines()
    before = (ring_folder / "trajectory.tum").read_text().splitlines()
    assert len(lines) - 1 == len(before) - 1 + 226
    stamps = [float(line.split()[0]) for line in lines[1:]]
    assert stamps == sorted(stamps)
    assert parts(ring_folder) == [MAIN_PART]


def test_session_without_a_place_is_kept_apart(own_ring_folder, strange_log, capsys):
    assert run(["map", str(strange_log), "--onto", str(own_ring_folder)]) == APART_STATUS
    assert parts(own_ring_folder) == [MAIN_PART, 1]
    assert "apart" in capsys.readouterr().out


def test_an_interrupted_addition_says_how_to_go_on(
    own_ring_folder, another_log, capsys, monkeypatch
):
    def fail(*_, **__):
        raise InputError("the last pass failed")

    before = (own_ring_folder / "map.cartoloop").read_bytes()
    with monkeypatch.context() as patch:
        patch.setattr("cartoloop.mapper.Mapper.finish", fail)
        assert run(["map", str(another_log), "--onto", str(own_ring_folder)]) == 1
    assert (own_ring_folder / "map.cartoloop").read_bytes() == before
    capsys.readouterr()

    assert run(["info", str(own_ring_folder)]) == 0
    command = f"cartoloop map {another_log.name} --resume {own_ring_folder}"
    assert f"`{command}` goes on with it" in capsys.readouterr().err
    assert run(["map", str(another_log), "--resume", str(own_ring_folder), "--at", "1,2,3"]) == 1
    assert "another pose at first" in capsys.readouterr().err
    onto = ["--onto", str(own_ring_folder), "--resume", str(own_ring_folder)]
    assert run(["map", str(another_log), *onto]) == 0
    assert "2 of 2 in one map" in capsys.readouterr().out
    assert parts(own_ring_folder) == [MAIN_PART, MAIN_PART]
    assert run(["map", str(another_log), "--resume", str(own_ring_folder)]) == 0
    assert "nothing to resume" in capsys.readouterr().out


def test_maps_of_two_buildings_are_merged_apart(ring_folder, strange_log, tmp_path, capsys):
    strange, out = tmp_path / "strange", tmp_path / "both"
    assert run(["map", str(strange_log), "-o", str(strange)]) == 0
    status = run(["merge", str(ring_folder), str(strange), "-o", str(out)])
    assert status == APART_STATUS
    assert names(out) == FILES
    assert parts(out) == [MAIN_PART, 1]
    # The same maps may be merged again, in the same folder.
    assert run(["merge", str(ring_folder), str(strange), "-o", str(out)]) == APART_STATUS
    capsys.readouterr()
    assert run(["merge", str(strange), str(ring_folder), "-o", str(ring_folder)]) == 1
    assert "holds another map" in capsys.readouterr().err


def test_one_map_cannot_be_merged(ring_folder, tmp_path, capsys):
    assert run(["merge", str(ring_folder), "-o", str(tmp_path / "out")]) == 1
    assert "give at least two" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_map_that_is_not_there_is_one_line(another_log, tmp_path, capsys):
    assert (
        run(["map", str(another_log), "--onto", str(tmp_path / "none"), "-o", str(tmp_path)]) == 1
    )
    assert capsys.readouterr().out == "", "the recording was read for nothing"
    assert run(["merge", str(tmp_path / "none"), str(tmp_path), "-o", str(tmp_path / "out")]) == 1
    for line in capsys.readouterr().err.splitlines():
        assert "Traceback" not in line


def test_a_damaged_map_is_refused_at_once(tmp_path, capsys):
    (tmp_path / "map.cartoloop").write_bytes(b"")
    (tmp_path / "drive.log").write_text("no recording")

    assert run(["map", str(tmp_path / "drive.log"), "--onto", str(tmp_path)]) == 1

    assert "map.cartoloop: is empty; map the recording again" in capsys.readouterr().err


def test_map_without_returns_cannot_be_merged(ring_folder, tmp_path, capsys):
    small_result().save(tmp_path / "small")
    status = run(["merge", str(ring_folder), str(tmp_path / "small"), "-o", str(tmp_path / "out")])
    assert status in (1, APART_STATUS)
    assert "Traceback" not in capsys.readouterr().err


def test_pose_in_the_map_is_in_degrees():
    assert parse_pose_deg("1,-2,90", "--at") == pytest.approx((1.0, -2.0, 1.570796))
    assert parse_pose_deg(None, "--at") is None


@pytest.mark.parametrize(
    "given",
    [["--at", "1,2,3"], ["--onto", "{map}", "--at", "1,2"], ["--onto", "{map}", "--at", "x"]],
)
def test_pose_that_is_none_is_refused(given, ring_folder, ring_log, capsys):
    words = [word.format(map=ring_folder) for word in given]
    assert run(["map", str(ring_log), *words]) == 2
    assert "--at" in capsys.readouterr().err


def test_a_map_that_is_merged_twice_is_refused(ring_folder, tmp_path, capsys):
    twice = [str(ring_folder), str(ring_folder / "map.cartoloop")]
    assert run(["merge", *twice, "-o", str(tmp_path / "out")]) == 1
    assert "is given twice" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
