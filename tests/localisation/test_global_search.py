# SPDX-License-Identifier: Apache-2.0
"""Searches of the whole map find the same as looking at every candidate in turn."""

from __future__ import annotations

import math

import numpy as np
import pytest

from cartoloop.kernels.search_window import ROUNDING, rotation_step, scan_extent
from cartoloop.localisation import global_search
from cartoloop.localisation.global_search import (
    PLACE_ANGLE_RAD,
    PLACE_DISTANCE_M,
    TileMatches,
    find,
    find_near,
    is_same_place,
    list_places,
    runner_up_score,
    search_tiles,
)
from cartoloop.localisation.known_map import KnownMap
from cartoloop.sensor.pose import IDENTITY, Pose
from cartoloop.submaps.finished_grid import mean_probability
from tests.localisation.rooms import BOX, ROOM, START, known_map, points

RESOLUTION = 0.25


def all_means(known, scan, heading, window):
    """Return the mean value by rotation, row and column of all candidates, and the rotations."""
    grid = known.grid
    cells = np.asarray(known._cells.cells, dtype=np.int64)
    height, width = (size // 2 for size in cells.shape)
    step = rotation_step(scan_extent(scan).farthest, grid.resolution, 0.5 * grid.resolution)
    half = math.ceil(window / step - ROUNDING)
    turns = heading + step * np.arange(-half, half + 1)
    far = 4 * max(cells.shape)
    padded = np.pad(cells, far)
    totals = np.zeros((len(turns), 2 * height + 1, 2 * width + 1), dtype=np.int64)
    for k, turn in enumerate(turns):
        cos, sin = math.cos(turn), math.sin(turn)
        for x, y in scan:
            col = math.floor((width * RESOLUTION + cos * x - sin * y) / RESOLUTION + 0.5)
            row = math.floor((height * RESOLUTION + sin * x + cos * y) / RESOLUTION + 0.5)
            first_row, first_col = far + row - height, far + col - width
            totals[k] += padded[
                first_row : first_row + 2 * height + 1, first_col : first_col + 2 * width + 1
            ]
    return totals / len(scan), turns


@pytest.fixture(scope="module", params=[ROOM, BOX])
def case(request):
    return known_map(request.param, RESOLUTION), points(request.param, START)[::6]


def test_the_best_place_is_the_best_of_all_candidates(case):
    known, scan = case
    half = math.pi / 2.0
    means = [all_means(known, scan, heading, half)[0] for heading in (half, 3.0 * half)]

    found = find(known, scan, 0.3)

    assert found.score == pytest.approx(mean_probability(max(mean.max() for mean in means)))


def test_the_best_place_elsewhere_is_the_best_of_the_others(case):
    known, scan = case
    means, turns = all_means(known, scan, 0.0, math.pi)
    turn, row, col = np.unravel_index(np.argmax(means), means.shape)
    rows, cols = np.mgrid[0 : means.shape[1], 0 : means.shape[2]]
    is_near = np.hypot(rows - row, cols - col) * RESOLUTION <= PLACE_DISTANCE_M + 1e-9
    steps = np.abs(np.arange(len(turns)) - turn) * (turns[1] - turns[0])
    means[np.ix_(steps <= PLACE_ANGLE_RAD)] *= np.where(is_near, 0.0, 1.0)
    best = find(known, scan, 0.3)

    tiles = search_tiles(known, scan, best.score - 0.5)
    assert runner_up_score(known, tiles, best) == pytest.approx(
        max(mean_probability(means.max()), best.score - 0.5), abs=0.02
    )


def test_no_place_is_found_below_the_score(case):
    known, scan = case
    best = find(known, scan, 0.3)

    assert find(known, scan, best.score + 0.01) is None
    assert find(known, scan, best.score - 0.01) == best


def test_listed_places_reach_the_score_and_are_apart(case):
    known, scan = case
    best = find(known, scan, 0.3)

    places = list_places(known, scan, search_tiles(known, scan, best.score - 0.1)).places

    assert places[0].score == pytest.approx(best.score, abs=0.05)
    for k, place in enumerate(places):
        assert place.score >= best.score - 0.1
        assert not any(is_same_place(place.tf_map_tracking, o.tf_map_tracking) for o in places[:k])


def test_parts_of_the_search_do_not_change_the_list(case, monkeypatch):
    known, scan = case
    tiles = search_tiles(known, scan, 0.5)
    first = list_places(known, scan, tiles)
    monkeypatch.setattr(global_search, "NUM_PARTS", 1)

    assert search_tiles(known, scan, 0.5).matches == tiles.matches
    assert list_places(known, scan, tiles) == first


def test_a_list_that_is_cut_short_has_the_best_place(case, monkeypatch):
    known, scan = case
    best = find(known, scan, 0.3)
    monkeypatch.setattr(global_search, "MAX_PARTS", 0)

    listed = list_places(known, scan, search_tiles(known, scan, best.score - 0.3))

    assert not listed.is_complete
    assert listed.places[0].score == pytest.approx(best.score, abs=0.05)


def test_of_no_tiles_nothing_is_listed(case):
    known, scan = case

    assert list_places(known, scan, TileMatches(np.zeros((0, 3)), [], 0.5)) == ([], True)


def test_poses_half_a_turn_apart_are_different_places():
    assert is_same_place(Pose(1.0, 2.0, math.pi), Pose(1.5, 2.0, -math.pi))
    assert not is_same_place(Pose(1.0, 2.0, 0.0), Pose(1.0, 2.0, math.pi))


def test_a_map_may_lie_at_the_coordinates_of_surveyors():
    near = known_map(ROOM)
    x, y, resolution = near.grid.origin_x, near.grid.origin_y, near.grid.resolution
    far = KnownMap(near.grid.cells, x + 4e5, y + 5e6, resolution, IDENTITY, "far")
    start = Pose(START.x + 4e5, START.y + 5e6, START.theta)

    found = find_near(far, points(ROOM, START), start, 0.5, 0.2, 0.5)

    assert math.hypot(found.tf_map_tracking.x - start.x, found.tf_map_tracking.y - start.y) < 0.1
    assert find_near(far, points(ROOM, START), START, 0.5, 0.2, 0.5) is None
