# SPDX-License-Identifier: Apache-2.0
"""Maps of other buildings are measured whole, and as images alone."""

from __future__ import annotations

import numpy as np
import pytest

from bench.localisation import other_buildings
from bench.localisation.drives import Drive
from bench.localisation.images import IMAGE, OURS, known_map_as_image, known_maps_of
from bench.localisation.other_buildings import stranger_rows
from cartoloop.localisation.known_map import load_known_map
from cartoloop.map_output.save import save
from tests.localisation import rooms
from tests.map_output.small_result import small_result


def test_an_image_is_what_is_read_from_its_files(tmp_path):
    result = small_result()
    save(result, tmp_path)

    read = load_known_map(tmp_path / "map.yaml")
    image = known_map_as_image(result)

    assert np.array_equal(image.grid.cells, read.grid.cells)
    assert image.grid.resolution == read.grid.resolution
    assert image.tf_map_grid == pytest.approx(read.tf_map_grid)


def test_a_map_is_given_whole_and_as_its_image():
    maps = known_maps_of(small_result())

    assert list(maps) == [OURS, IMAGE]
    assert not {3, 251} & set(np.unique(maps[IMAGE].grid.cells))
    assert {3, 251} <= set(np.unique(maps[OURS].grid.cells))


CORNER = (((10, 9), (13, 9), (13, 11), (10, 11)),)
"""A room that has nothing in common with the one that is driven in."""


@pytest.fixture
def rows(monkeypatch):
    """Rows of a drive that fits in the image, by mistake, and not in the map itself."""
    poses = rooms.drive(rooms.START, 30, step=0.05, turn=0.04)
    drive = Drive("", None, list(rooms.events(rooms.ROOM, poses)), np.array(poses))
    maps = {OURS: rooms.known_map(CORNER), IMAGE: rooms.known_map(rooms.ROOM)}
    monkeypatch.setattr(other_buildings, "simulated_drive", lambda *_, **__: drive)
    monkeypatch.setattr(other_buildings, "known_maps_of", lambda _: maps)
    monkeypatch.setattr(other_buildings, "OTHERS", ("flat",))
    monkeypatch.setattr(other_buildings, "NUM_SCANS", 3)
    return list(stranger_rows((1, 2), 2, lambda _: None))


def test_claims_in_images_of_others_have_their_own_rows(rows):
    wrong = {}
    for row in rows:
        wrong.setdefault(row.case["what"], {})[row.case["map"]] = row.figures["wrong"].value

    kinds = ("", ", from a wrong pose")
    drives = [wrong.pop(f"in the map of another building{kind}") for kind in kinds]
    assert [each[OURS] for each in drives] == [0.0, 0.0]
    assert all(each[IMAGE] > 90.0 for each in drives)
    scans = wrong.pop("one scan, in the map of another building")
    assert scans == {OURS: 0.0, IMAGE: 100.0}
    rings = wrong.pop("in the map of another building of the same size")
    assert rings[OURS] == 0.0
    assert rings[IMAGE] > 90.0
    (plan,) = wrong.values()
    assert plan == {OURS: 0.0, IMAGE: 0.0}


def test_each_map_of_another_building_is_driven_alike(rows):
    drives = [row.figures["drives"].value for row in rows if "drives" in row.figures]

    # two seeds, both maps of a pair, and two drives each; of one size or plan one map a seed
    assert drives == [8.0] * 4 + [4.0] * 4
