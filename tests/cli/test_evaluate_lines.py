# SPDX-License-Identifier: Apache-2.0
"""``cartoloop evaluate lines``."""

from __future__ import annotations

import json

import numpy as np
import pytest
from PIL import Image

from cartoloop.cli.main import run
from tests.evaluation.drawn_map import FREE, room

YAML = """\
image: floor.png
mode: trinary
resolution: 0.05
origin: [-5.0, -5.0, 0.0]
negate: 0
occupied_thresh: 0.65
free_thresh: 0.196
"""


@pytest.fixture
def floor(tmp_path):
    """A folder with the map of a room of 4 m by 3 m, its middle at the origin, with a door."""
    image = room(4.03, 3.03)
    image.occupancy[80:90, 130:] = FREE
    shades = np.rint((1.0 - image.occupancy[::-1]) * 255.0).astype(np.uint8)
    Image.fromarray(shades).save(tmp_path / "floor.png")
    (tmp_path / "map.yaml").write_text(YAML)
    return tmp_path


def lines_file(folder, text):
    path = folder / "lines.txt"
    path.write_text(text)
    return str(path)


def test_prints_the_paper_s_table_and_what_does_not_count(floor, capsys):
    lines = lines_file(floor, "-2 0.5 2 0.5 4.09\n0.1 -1.5 0.1 1.5\n-2 -0.7 2 -0.7 4.0\n")

    assert run(["evaluate", "lines", str(floor), lines]) == 0

    captured = capsys.readouterr()
    head, *rows = captured.out.splitlines()
    assert head.split("  ")[1:5] == [
        "Laser tape", "Cartoloop", "Error (absolute)", "Error (relative)"
    ]  # fmt: skip
    assert rows[0].split() == ["1", "4.09", "4.05", "-0.04", "-1.0%", "-0.4"]
    assert rows[1].split() == ["2", "-", "3.05", "-", "-", "-"]
    assert rows[2].split() == ["3", "4.00", "-", "-", "-", "-"]
    assert "Mean absolute error            0.040 m" in rows
    assert "Within a pixel at each end     1 of 1 (a pixel is 0.05 m)" in rows
    assert captured.err == (
        f"cartoloop: {lines}:3: line 3 does not count: no wall with free floor before it within "
        "0.5 m of its end 2, (2, -0.7)\n"
    )


def test_prints_json(floor, capsys):
    lines = lines_file(floor, "-2 0.5 2 0.5 4.09\n")

    assert run(["evaluate", "lines", str(floor / "map.yaml"), lines, "--json"]) == 0

    shown = json.loads(capsys.readouterr().out)
    assert shown["lines"][0]["map"] == pytest.approx(4.05, abs=0.01)
    assert shown["num_within_a_pixel_at_each_end"] == 1


def test_says_so_if_no_line_can_be_compared(floor, capsys):
    assert run(["evaluate", "lines", str(floor), lines_file(floor, "-2 0.5 2 0.5\n")]) == 0

    assert "No line was measured both in the map and with the tape." in capsys.readouterr().out


def test_the_search_can_be_widened(floor, capsys):
    lines = lines_file(floor, "-1.2 0.5 1.2 0.5 4\n")

    run(["evaluate", "lines", str(floor), lines, "--json"])
    narrow = json.loads(capsys.readouterr().out)
    run(["evaluate", "lines", str(floor), lines, "--json", "--search", "1"])
    wide = json.loads(capsys.readouterr().out)

    assert narrow["lines"][0]["walls"] == [None, None]
    assert wide["lines"][0]["map"] == pytest.approx(4.05, abs=0.01)


def test_draws_the_lines_over_the_map(floor, capsys):
    lines = lines_file(floor, "-2 0.5 2 0.5 4.09\n-2 -0.7 2 -0.7 4.0\n")
    plot = floor / "lines.png"

    assert run(["evaluate", "lines", str(floor), lines, "--plot", str(plot)]) == 0
    first = plot.read_bytes()
    run(["evaluate", "lines", str(floor), lines, "--plot", str(plot)])

    assert plot.read_bytes() == first
    with Image.open(plot) as picture:
        pixels = np.asarray(picture).astype(int)
        # 200 pixels of 5 cm, enlarged 8 times
        assert picture.size == (1600, 1600)
    # blue where both walls are, at y = 0.5 m; red where one is missing, at y = -0.7 m
    measured, missing = pixels[800 - 80, 600], pixels[800 + 112, 600]
    assert measured[2] > measured[0] + 100
    assert missing[0] > missing[2] + 100
    # only from wall to wall
    assert (pixels[800 - 80, 450] == pixels[400, 100]).all()


def test_the_largest_maps_are_drawn_smaller(floor):
    shades = np.full((100, 9000), 254, np.uint8)
    shades[:, 8000] = 0
    Image.fromarray(shades).save(floor / "floor.png")
    lines = lines_file(floor, "-4 -2.5 395 -2.5\n")

    assert run(["evaluate", "lines", str(floor), lines, "--plot", str(floor / "a.png")]) == 0

    with Image.open(floor / "a.png") as picture:
        assert picture.size == (3000, 34)


@pytest.mark.parametrize(
    ("arguments", "status", "message"),
    [
        (["none.yaml", "lines.txt"], 1, "none.yaml: cannot be read"),
        (["map.yaml", "none.txt"], 1, "none.txt: cannot be read"),
        (["map.yaml", "lines.txt", "--search", "0"], 2, "search = 0 m"),
        (["map.yaml", "lines.txt", "--plot", "lines.gif"], 2, "ends in .png, .jpg, .jpeg or .webp"),
        (["map.yaml", "lines.txt", "--plot", "none/lines.png"], 1, "cannot be written"),
        (["map.yaml", "far.txt"], 1, "far.txt:2: end 1 of the line, (50, 0), is off the map"),
    ],
)
def test_errors_are_one_line(floor, monkeypatch, capsys, arguments, status, message):
    monkeypatch.chdir(floor)
    lines_file(floor, "-2 0.5 2 0.5 4.09\n")
    (floor / "far.txt").write_text("# far\n50 0 0 0\n")

    assert run(["evaluate", "lines", *arguments]) == status

    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1
