# SPDX-License-Identifier: Apache-2.0
"""``cartoloop locate --changes`` and ``--update``: what differs is reported, and taken over."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace

import numpy as np
import pytest

from cartoloop import InputError, load_map
from cartoloop.cli.main import run
from cartoloop.runs.recording import map_recording
from cartoloop.runs.update import update_map
from cartoloop.sensor.pose import Pose, inverse, transform_points
from cartoloop.simulation import make_world, simulate
from tests.localisation.rooms import ROOM, START, carmen_text, drive, write_image
from tests.localisation.test_changes import AFTER, poses_around

BEFORE_AT, AFTER_AT = (30.0, 6.58), (24.0, 6.58)
HALL = (((0, 0), (30, 0), (30, 2.2), (0, 2.2)),)


def crate_drive(corner, seed):
    """Return 40 s through an office in which a crate stands in a corridor."""
    x, y = corner
    corners = [(x, y), (x + 0.8, y), (x + 0.8, y + 0.4), (x, y + 0.4)]
    crate = [(*a, *b) for a, b in zip(corners, corners[1:] + corners[:1], strict=True)]
    world = make_world("office")
    walls = np.vstack((world.walls, crate))
    return simulate(replace(world, walls=walls), seed=seed, duration=40.0)


@pytest.fixture(scope="module")
def mapped(tmp_path_factory):
    """A folder with a map, and the recording of a later drive."""
    folder = tmp_path_factory.mktemp("crate")
    first, second = crate_drive(BEFORE_AT, 1), crate_drive(AFTER_AT, 2)
    first.write_log(folder / "first.log")
    map_recording(folder / "first.log", out=folder / "map")
    second.write_log(folder / "later.log")
    tf_map_world = inverse(Pose(*first.true_poses[0].tolist()))
    corners = np.array((BEFORE_AT, AFTER_AT)) + 0.4  # the middle of the front
    return folder, transform_points(tf_map_world, corners)


@pytest.fixture
def office(mapped, tmp_path):
    """A copy of the map that a test may change."""
    return shutil.copytree(mapped[0] / "map", tmp_path / "map")


def files_of(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}


def walls_near(folder, point):
    """Return the number of walls of a map within 0.15 m of a point."""
    shown = load_map(folder).occupancy_map()
    rows, cols = np.nonzero(shown.probability > 0.6)
    at = np.column_stack((shown.origin_x, shown.origin_y)) + shown.resolution * (
        np.column_stack((cols, rows)) + 0.5
    )
    return int((np.hypot(*(at - point).T) < 0.15).sum())


def test_an_updated_map_shows_what_is_new_and_not_what_is_gone(mapped, office, tmp_path, capsys):
    folder, (gone, new) = mapped
    before = (office / "map.cartoloop").read_bytes()
    assert walls_near(office, gone) > 3
    assert walls_near(office, new) == 0

    arguments = ["locate", str(office), str(folder / "later.log"), "--update"]
    assert run([*arguments, "--changes", str(tmp_path / "changed")]) == 0

    assert walls_near(office, gone) == 0
    assert walls_near(office, new) > 3
    assert (office / "before-update" / "map.cartoloop").read_bytes() == before
    assert walls_near(office / "before-update", gone) > 3
    out = capsys.readouterr().out
    assert "the map before is in" in out
    kinds = [area["kind"] for area in listed(tmp_path / "changed")]
    assert set(kinds) == {"appeared", "disappeared"}
    assert all(kind in out for kind in kinds)

    assert run(arguments) == 1
    assert "is in the map already" in capsys.readouterr().err


def listed(folder):
    return json.loads((folder / "changes.json").read_text())["areas"]


def test_a_map_is_updated_in_python(mapped, office):
    folder, (gone, new) = mapped

    result = update_map(office, folder / "later.log")

    assert result.sessions[-1].recording == "later.log"
    assert walls_near(office, gone) == 0
    assert walls_near(office, new) > 3


def test_a_robot_that_is_never_located_updates_nothing(office, tmp_path, capsys):
    path = tmp_path / "hall.log"
    path.write_text(carmen_text(HALL, drive(Pose(3.0, 1.1, 0.0), 10)))
    before = files_of(office)

    assert run(["locate", str(office), str(path), "--update"]) == 3
    assert "the robot was never located" in capsys.readouterr().out
    with pytest.raises(InputError, match="never located"):
        update_map(office, path)
    assert files_of(office) == before


def test_a_drive_that_finds_no_place_leaves_the_map_alone(office, tmp_path):
    path = tmp_path / "hall.log"
    path.write_text(carmen_text(HALL, drive(Pose(3.0, 1.1, 0.0), 10)))
    before = files_of(office)

    with pytest.raises(InputError, match="found no place"):
        update_map(office, path, at=Pose(0.0, 3.0, 0.0))

    assert files_of(office) == before


@pytest.mark.parametrize(
    ("arguments", "status", "says"),
    [
        (["locate", "{room}", "{log}", "--update"], 1, "cannot be updated"),
        (["locate", "{room}", "-", "--update"], 2, "needs a recording"),
        (["locate", "{room}", "{log}", "--changes", "{log}"], 1, "cannot write"),
    ],
)
def test_what_cannot_be_done_is_said_in_a_line(tmp_path, capsys, arguments, status, says):
    log = tmp_path / "drive.log"
    log.write_text(carmen_text(ROOM, [START]))
    places = {"room": write_image(tmp_path, ROOM), "log": log}

    assert run([argument.format(**places) for argument in arguments]) == status
    assert says in capsys.readouterr().err


def test_changes_of_a_foreign_map_are_listed(tmp_path, capfd):
    log, out = tmp_path / "drive.log", tmp_path / "changed"
    log.write_text(carmen_text(AFTER, 2 * poses_around()))
    room = str(write_image(tmp_path, ROOM))

    assert run(["locate", room, str(log), "--changes", str(out), "--poses", "-"]) == 0

    captured = capfd.readouterr()
    assert {area["kind"] for area in listed(out)} == {"appeared", "disappeared"}
    assert (out / "changes.png").stat().st_size > 1000
    assert "appeared" in captured.err
