# SPDX-License-Identifier: Apache-2.0
"""Finished maps drawn again: the same bytes by default, other cells, a part, turned."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from cartoloop.errors import ConfigError, OutputError
from cartoloop.map_output import export
from cartoloop.map_output.colours import LIGHT
from cartoloop.map_output.export import (
    Drawing,
    angle_to_axes,
    compose_again,
    export_map,
    turned,
)
from cartoloop.map_output.surveyed_floor import Extent
from cartoloop.quality.verdict import Kind, Place, Quality, Severity
from cartoloop.report import Report
from cartoloop.result import load_map
from cartoloop.submaps.finished_grid import FinishedGrid
from tests.map_output.small_result import small_result

FREE, WALL = 3, 250
PLACE = Place(1.0, 0.0, 0.5, 1.0, 2.0, Kind.GAP, Severity.DOUBTFUL, "a gap", "none")


def with_cells(cells, *, times=3):
    """The small result with another grid, seen several times, so that it is certain."""
    result = small_result()
    for _ in range(times - 1):
        result.graph.add_submap((0.0, 0.0, 0.0))
    return replace(result, submap_grids=[FinishedGrid(cells, 0.025, 0.025, 0.05)] * times)


def wall_map(size=80, col=40):
    """Free floor of 4 m by 4 m with a wall one cell wide along y."""
    cells = np.full((size, size), FREE, np.uint8)
    cells[:, col] = WALL
    return with_cells(cells)


def at(occupancy_map, x, y):
    col = math.floor((x - occupancy_map.origin_x) / occupancy_map.resolution)
    row = math.floor((y - occupancy_map.origin_y) / occupancy_map.resolution)
    return occupancy_map.probability[row, col]


def test_without_options_the_bytes_are_those_of_the_map(tmp_path):
    result = small_result()
    result.graph.fix_submap(0)  # as mapping does
    result.save(tmp_path / "map")

    written = export_map(load_map(tmp_path / "map"), tmp_path / "again")

    assert {path.name for path in written} == {path.name for path in (tmp_path / "again").iterdir()}
    assert len(written) == 8
    for path in written:
        assert path.read_bytes() == (tmp_path / "map" / path.name).read_bytes(), path.name


def test_smaller_cells_are_composed_of_the_submaps():
    result = wall_map()
    for later in (1, 2):  # two of three visits see the wall half a cell further
        result.graph.submap_poses[later] = (0.025, 0.0, 0.0)
    true = np.mean((2.025, 2.05, 2.05))

    errors = {}
    for resolution in (0.05, 0.0125):
        drawn = compose_again(result, resolution)
        wall = np.flatnonzero(drawn.probability[len(drawn.probability) // 2] > 0.5)
        errors[resolution] = abs(drawn.origin_x + (wall.mean() + 0.5) * resolution - true)

    assert drawn.resolution == 0.0125
    assert errors[0.0125] < 0.005 < errors[0.05]


@pytest.mark.parametrize("resolution", [0.08, 0.1, 0.25, 1.0])
def test_walls_are_not_lost_between_larger_cells(resolution):
    drawn = compose_again(wall_map(), resolution)

    assert drawn.resolution == pytest.approx(resolution)
    for y in np.arange(0.3, 3.7, 0.1):
        assert at(drawn, 2.025, y) > 0.9
    if resolution < 0.5:
        assert at(drawn, 1.025, 1.0) < 0.1
        assert at(drawn, 3.025, 1.0) < 0.1
    assert drawn.origin_x / resolution == pytest.approx(round(drawn.origin_x / resolution))


def test_a_part_has_the_cells_of_the_whole_map():
    whole, part = compose_again(wall_map()), compose_again(wall_map(), None, Extent(1, 0.5, 3, 2))

    assert part.probability.shape == (30, 40)
    assert (part.origin_x, part.origin_y) == (1.0, 0.5)
    first_row, first_col = (
        round((0.5 - whole.origin_y) / 0.05),
        round((1.0 - whole.origin_x) / 0.05),
    )
    same = whole.probability[first_row : first_row + 30, first_col : first_col + 40]
    assert np.array_equal(part.probability, same)


def test_a_part_of_a_fine_map_needs_no_memory_for_the_rest():
    drawn = compose_again(wall_map(), 0.0001, Extent(2.0, 1.0, 2.01, 1.01))

    assert drawn.probability.shape == (100, 100)


def test_nothing_is_drawn_beyond_a_part(tmp_path):
    drawing = Drawing(crop=Extent(1.0, 0.4, 1.4, 0.6), layers=("trajectory", "closures"))
    result = replace(wall_map(), trajectory=np.array([(0.0, 0.5, 0.0), (4.0, 0.5, 0.0)]))
    result = replace(result, stamps=np.array([1.0, 2.0]), local_trajectory=result.trajectory)

    export_map(result, tmp_path / "part.png", drawing)

    with Image.open(tmp_path / "part.png") as picture:
        pixels = np.asarray(picture.convert("RGB"))
    beside = pixels[140 : pixels.shape[0] - 80, :40]
    assert (beside == LIGHT.ground).all()


def test_a_turned_map_is_turned_with_all_its_poses():
    result = wall_map()
    quality = Quality("doubtful", (PLACE,))
    result = replace(result, report=Report(quality=quality))

    quarter = turned(result, math.pi / 2)

    drawn = compose_again(quarter)
    assert at(drawn, -1.0, 2.025) > 0.9  # the wall lies along x now
    assert at(drawn, -1.0, 1.0) < 0.1
    assert quarter.trajectory[0] == pytest.approx((-0.5, 0.5, math.pi / 2))
    assert quarter.graph.node_poses[1] == pytest.approx((-0.5, 1.0, math.pi / 2 + 0.1))
    place = quarter.report.quality.places[0]
    assert (place.x, place.y) == pytest.approx((0.0, 1.0))
    assert np.array_equal(quarter.graph.relative_poses, result.graph.relative_poses)
    assert result.trajectory[0] == pytest.approx((0.5, 0.5, 0.0))


@pytest.mark.parametrize("degrees", [-37.0, -3.5, 0.0, 12.25, 44.0])
def test_walls_can_be_turned_to_the_axes(degrees):
    cells = np.full((120, 120), FREE, np.uint8)
    cells[20, 20:100] = cells[99, 20:100] = cells[20:100, 20] = cells[20:100, 99] = WALL
    oblique = turned(with_cells(cells), math.radians(degrees))

    assert math.degrees(angle_to_axes(oblique)) == pytest.approx(-degrees, abs=0.3)


@pytest.mark.parametrize(
    ("name", "files"),
    [
        ("plan.png", {"plan.png"}),
        ("plan.pgm", {"plan.pgm", "plan.yaml"}),
        ("plan.tum", {"plan.tum"}),
        ("plan.g2o", {"plan.g2o"}),
        ("v1.2", {"v1.2"}),
    ],
)
def test_the_ending_of_a_file_chooses_its_format(name, files, tmp_path):
    export_map(small_result(), tmp_path / name)

    assert {path.name for path in tmp_path.iterdir()} == files
    if name == "plan.pgm":
        assert "image: plan.pgm\n" in (tmp_path / "plan.yaml").read_text()


def test_formats_choose_the_files_of_a_folder(tmp_path):
    export_map(small_result(), tmp_path / "out", formats=["tum", "png"])

    names = {path.name for path in (tmp_path / "out").iterdir()}
    assert names == {"map.png", "trajectory.tum", "local_trajectory.tum"}


@pytest.mark.parametrize(
    ("drawing", "says"),
    [
        (Drawing(resolution=0.0), "a resolution of 0 m is impossible"),
        (Drawing(resolution=math.nan), "a resolution of nan m is impossible"),
        (Drawing(resolution=1e308), "a resolution of 1e+308 m is impossible"),
        (Drawing(turn=math.inf), "cannot turn"),
        (Drawing(crop=Extent(2, 0, 1, 1)), "the smaller first"),
        (Drawing(crop=Extent(90, 90, 91, 91)), "the map is from x -0.3 to 3.2 m, y -0.3 to 2.2 m"),
    ],
)
def test_impossible_drawings_are_refused_in_a_line(drawing, says, tmp_path):
    with pytest.raises(ConfigError) as refusal:
        export_map(small_result(), tmp_path / "out", drawing)

    assert says in str(refusal.value)
    assert "\n" not in str(refusal.value)
    assert list(tmp_path.iterdir()) == []


def test_a_map_is_not_mixed_with_another_drawing_of_it(tmp_path):
    small_result().save(tmp_path / "map")

    with pytest.raises(ConfigError, match="another folder"):
        export_map(small_result(), tmp_path / "map", Drawing(resolution=0.1))
    with pytest.raises(OutputError, match=r"map\.pgm: is a file of a map"):
        export_map(small_result(), tmp_path / "map" / "map.pgm", Drawing(resolution=0.1))
    with pytest.raises(ConfigError, match="unknown ending"):
        export_map(small_result(), tmp_path / "map.jpg")
    with pytest.raises(ConfigError, match="no format 'svg'"):
        export_map(small_result(), tmp_path / "out", formats=["svg"])


def test_a_failing_export_keeps_the_files_of_the_last_one(tmp_path, monkeypatch):
    result = wall_map()
    export_map(result, tmp_path, formats=("pgm", "tum"))
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    write = export.write_file

    def full_disk(path, content):
        if path.name == "map.yaml":
            raise OutputError(f"{path}: cannot be written: No space left on device")
        write(path, content)

    monkeypatch.setattr(export, "write_file", full_disk)
    with pytest.raises(OutputError):
        export_map(result, tmp_path, Drawing(resolution=0.1), formats=("pgm", "tum"))

    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_an_export_adds_to_the_files_of_other_formats(tmp_path):
    export_map(wall_map(), tmp_path, formats=("tum",))
    export_map(wall_map(), tmp_path, formats=("pgm",))

    names = {path.name for path in tmp_path.iterdir()}
    assert names == {"trajectory.tum", "local_trajectory.tum", "map.pgm", "map.yaml"}
