# SPDX-License-Identifier: Apache-2.0
"""What the lifelong benchmark counts as drawn."""

from __future__ import annotations

import numpy as np
import pytest

from bench import lifelong
from bench.record import Figure, Record, Row
from cartoloop.sensor.pose import Pose, transform_points
from tests.map_output.small_result import small_result

SEGMENTS = np.array([(0.0, 0.0, 1.0, 0.0), (2.0, 0.0, 2.0, 0.01)])


def test_places_lie_close_together_along_furniture():
    points = lifelong._points(SEGMENTS)
    along = points[points[:, 1] == 0.0][:-1, 0]
    assert np.diff(along).max() < 0.03
    assert points[-1] == pytest.approx((2.0, 0.01))


def test_places_along_walls_may_lie_farther_apart():
    points = lifelong._points(SEGMENTS, 0.6)
    assert points == pytest.approx(np.array([(0.0, 0.0), (1.0, 0.0), (2.0, 0.0), (2.0, 0.01)]))


def test_distances_are_to_the_nearest_segment():
    points = np.array([(0.5, 0.3), (-0.3, 0.4), (2.0, 1.01)])
    assert lifelong._distances(points, SEGMENTS) == pytest.approx([0.3, 0.5, 1.0])


def test_walls_are_drawn_and_floor_is_seen():
    """The map has a wall along x at y = 0.525 m, and floor up to x = 3 m."""
    result, tf_truth_map = small_result(), Pose(4.0, -2.0, 0.7)
    points = transform_points(tf_truth_map, np.array([(1.0, 0.52), (1.0, 1.2), (9.0, 0.52)]))
    assert lifelong._is_drawn(result, tf_truth_map, points).tolist() == [True, False, False]
    assert lifelong._is_seen(result, tf_truth_map, points).tolist() == [True, True, False]


def test_what_stands_on_a_drive():
    visit = lifelong._Visit.__new__(lifelong._Visit)
    visit.walls = SEGMENTS
    places = np.array([(0.5, 0.01), (0.5, 0.2), (0.5, 0.4)])
    assert visit.has_walls(places).tolist() == [True, False, False]
    assert visit.is_clear(places).tolist() == [False, False, True]


def test_drives_whose_figures_were_kept_are_not_made_again(tmp_path, monkeypatch):
    made = []

    def drive(folder, number, options, progress):
        made.append(number)
        error = Figure.exact(float(number), "cm")
        return Row({"drive": str(number)}, {"error": error, lifelong.ALONE: error})

    monkeypatch.setattr(lifelong, "_new_drive", drive)
    options = lifelong.LifelongOptions(3, seed=7, keep=tmp_path)
    for numbers in ((1, 2), (1, 2, 3)):
        with lifelong._folder(options) as folder:
            rows = [lifelong._drive(folder, number, options, print) for number in numbers]
    assert made == [1, 2, 3]
    assert [row.figures["error"].value for row in rows] == [1.0, 2.0, 3.0]
    with lifelong._folder(lifelong.LifelongOptions(3, seed=8, keep=tmp_path)) as other:
        assert other != folder


def test_figures_of_an_earlier_version_are_completed(tmp_path, monkeypatch):
    figure = Figure.exact(1.5, "cm")
    monkeypatch.setattr(lifelong, "_error_alone", lambda *_: figure)
    row = Row({"drive": "1"}, {"error": Figure.exact(2.0, "cm")})
    (tmp_path / "1.json").write_text(Record("lifelong", (row,)).to_json(), encoding="utf-8")
    options = lifelong.LifelongOptions(2, seed=7, keep=tmp_path)
    drive = lifelong._drive(tmp_path, 1, options, print)
    assert drive.figures == {"error": Figure.exact(2.0, "cm"), lifelong.ALONE: figure}


def test_map_of_a_drive_that_was_stopped_is_made_again(tmp_path, monkeypatch):
    made = []

    def command(*words):
        made.append(words[0])
        words[-1].mkdir()

    monkeypatch.setattr(lifelong, "run_command", command)
    (tmp_path / "alone-3.part").mkdir()
    for _ in range(2):
        assert lifelong._mapped_alone(tmp_path, 3, print) == tmp_path / "alone-3"
    assert made == ["map"]
    assert [path.name for path in tmp_path.iterdir()] == ["alone-3"]


def test_errors_are_compared_with_those_of_drives_alone():
    def drive(number, own, alone):
        names = ("file", "peak memory", "time a node", "error", "error of this drive")
        figures = {name: Figure.exact(own, "") for name in names}
        return Row({"drive": str(number)}, figures | {lifelong.ALONE: Figure.exact(alone, "")})

    growth = lifelong._growth([drive(1, 2.0, 2.0), drive(2, 3.0, 4.0), drive(3, 5.0, 6.0)])
    assert growth.figures["error over the first"].value == 2.5
    assert growth.figures["mean error over drives alone"].value == 0.8
    assert "mean error over drives alone" not in lifelong._growth([drive(1, 2.0, 2.0)]).figures


def test_folder_that_is_not_kept_is_removed():
    with lifelong._folder(lifelong.LifelongOptions(3, seed=7)) as folder:
        assert folder.is_dir()
    assert not folder.exists()
