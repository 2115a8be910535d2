# SPDX-License-Identifier: Apache-2.0
"""``cartoloop info`` and ``cartoloop export`` on a map made by hand."""

from __future__ import annotations

import json

import pytest

from cartoloop.cli.main import run
from cartoloop.quality.verdict import Quality
from cartoloop.report import InputSummary
from tests.map_output.small_result import FILES, small_result

SENSORS = [
    {"name": "front", "beams": 181, "field_of_view_deg": 180.0, "range_max_m": 30.0},
    {"name": "top", "beams": None, "field_of_view_deg": None, "range_max_m": None},
]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    out = tmp_path_factory.mktemp("info") / "small"
    result = small_result(
        input=InputSummary("small.bag", 3, 0.4, 0.5),
        finished=True,
        quality=Quality("good"),
        skipped={"no returns": 2},
        config_hash="0123456789abcdef",
        extra={"sensors": SENSORS, "odometry": {}},
    )
    result.graph.fix_submap(0)  # as mapping does
    result.save(out)
    return out


def test_info_shows_the_facts_of_a_map(folder, capsys):
    assert run(["info", str(folder)]) == 0

    lines = capsys.readouterr().out.splitlines()
    shown = {line[:19].strip(): line[19:] for line in lines}
    assert shown["recording"] == "small.bag"
    assert shown["extent"].startswith("3.0 m × 1.9 m, x -0.1 to 3.0 m, y ")
    assert shown["length of the way"] == "0.5 m"
    assert shown["resolution"] == "5 cm"
    assert shown["verdict"] == "good"
    assert shown["duration"] == "0 s, 3 scans"
    assert shown["sensor"] == (
        "front: 181 beams over 180 deg, up to 30 m; top: point clouds; odometry"
    )
    assert shown["skipped"] == "2 no returns"
    assert "0123456789abcdef" in shown["made by"]
    assert all(name in shown["files"] for name in FILES)


def test_info_as_json_has_numbers_in_si_units(folder, capsys):
    assert run(["info", str(folder), "--json"]) == 0

    facts = json.loads(capsys.readouterr().out)
    assert facts["extent"]["right"] - facts["extent"]["left"] == pytest.approx(3.0)
    assert facts["area_m2"] > 4.0
    assert facts["path_length_m"] == 0.5
    assert facts["duration_s"] == 0.4
    assert facts["stamps"] == [100.0, 100.4]
    assert facts["sensors"] == SENSORS
    assert facts["verdict"] == "good"
    assert facts["finished"] is True
    assert set(facts["files"]) == FILES
    assert facts["files"]["map.pgm"] == (folder / "map.pgm").stat().st_size


def test_info_of_a_map_file_alone(folder, tmp_path, capsys):
    alone = tmp_path / "moved.cartoloop"
    alone.write_bytes((folder / "map.cartoloop").read_bytes())

    assert run(["info", str(alone)]) == 0
    assert "moved.cartoloop" in capsys.readouterr().out


def test_export_writes_what_map_wrote_and_names_it(folder, tmp_path, capsys):
    assert run(["export", str(folder), "-o", str(tmp_path / "again")]) == 0

    written = capsys.readouterr().out.split()
    assert str(tmp_path / "again" / "map.png") in written
    for name in ("map.png", "map.pgm", "graph.g2o", "trajectory.tum", "closures.csv"):
        assert (tmp_path / "again" / name).read_bytes() == (folder / name).read_bytes()


def test_export_draws_a_turned_part_with_other_cells(folder, tmp_path, capsys):
    part = ["--resolution", "0.1", "--rotate", "90", "--crop", "-2,0,0,1.5", "--draw", "none"]

    assert run(["export", str(folder), "-o", str(tmp_path / "part.pgm"), *part]) == 0

    lines = (tmp_path / "part.yaml").read_text().splitlines()
    assert "resolution: 0.1" in lines
    assert "origin: [-2.0, 0.0, 0.0]" in lines
    assert b"\n20 15\n255\n" in (tmp_path / "part.pgm").read_bytes()[:60]


def test_export_leaves_out_what_stray_rays_saw(folder, tmp_path, capsys):
    assert run(["info", str(folder), "--json"]) == 0
    extent = json.loads(capsys.readouterr().out)["extent"]

    assert run(["export", str(folder), "-o", str(tmp_path / "a.pgm"), "--crop", "auto"]) == 0

    left, bottom = (extent[side] - 0.5 for side in ("left", "bottom"))
    lines = (tmp_path / "a.yaml").read_text().splitlines()
    origin = next(line for line in lines if line.startswith("origin: "))
    assert json.loads(origin[8:])[:2] == [
        pytest.approx(left, abs=0.06),
        pytest.approx(bottom, abs=0.06),
    ]


def test_export_says_by_how_much_it_turned_the_walls(folder, tmp_path, capsys):
    assert run(["export", str(folder), "-o", str(tmp_path / "a.png"), "--rotate", "auto"]) == 0
    assert capsys.readouterr().err == "turned by 0.0 deg\n"


@pytest.mark.parametrize(
    ("options", "status", "says"),
    [
        (["--crop", "1,2,3"], 2, "'1,2,3' is neither L,B,R,T"),
        (["--rotate", "left"], 2, "neither an angle in degrees nor auto"),
        (["--rotate", "nan"], 2, "cannot turn"),
        (["--format", "png,svg"], 2, "no format 'svg'"),
        (["--resolution", "-1"], 2, "a resolution of -1 m is impossible"),
        (["--draw", "walls"], 2, "cannot draw 'walls'"),
    ],
)
def test_export_refuses_what_it_cannot_draw(folder, tmp_path, capsys, options, status, says):
    assert run(["export", str(folder), "-o", str(tmp_path / "out"), *options]) == status

    error = capsys.readouterr().err
    assert says in error
    assert "Traceback" not in error
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("command", [["info"], ["export", "-o", "x"]])
def test_what_is_no_map_is_reported_in_a_line(command, tmp_path, capsys):
    assert run([*command, str(tmp_path)]) == 1

    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert "map.cartoloop" in error
