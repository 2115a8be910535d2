# SPDX-License-Identifier: Apache-2.0
"""Cells that only walls hide are unknown to all that read a growing grid."""

from __future__ import annotations

import numpy as np
import pytest

from cartoloop.config import CorrelativeMatcherConfig, SubmapConfig
from cartoloop.local_slam.seen_points import share_of_seen, values_at
from cartoloop.scan_matching import correlative, least_squares
from cartoloop.sensor.pose import Pose
from cartoloop.submaps.probability_grid import Extent, ProbabilityGrid
from cartoloop.submaps.submap import ActiveSubmaps

AWAY = Pose(0.07, 0.04, 0.03)


def returns_of_room():
    angles = np.radians(np.arange(-180.0, 180.0, 1.0))
    beams = np.column_stack((np.cos(angles), np.sin(angles)))
    ranges = np.minimum(3.0 / np.abs(beams[:, 0]).clip(1e-9), 2.0 / np.abs(beams[:, 1]).clip(1e-9))
    return ranges[:, np.newaxis] * beams


@pytest.fixture(scope="module")
def grids():
    """Return the grid of a room, and the same with the hidden cells cleared."""
    active = ActiveSubmaps(SubmapConfig())
    for _ in range(5):
        active.insert(Pose(0.0, 0.0, 0.0), returns_of_room(), np.empty((0, 2)))
    grid = active.submaps[0].grid
    cleared = ProbabilityGrid(grid.resolution)
    cleared.extent = Extent(grid.cells.clip(0.0), grid.first_col, grid.first_row)
    return grid, cleared


def test_walls_hide_cells_all_around(grids):
    assert np.count_nonzero(grids[0].cells < 0.0) > 150


def test_a_finished_grid_does_not_show_them(grids):
    finished, expected = (grid.finish() for grid in grids)
    assert np.array_equal(finished.cells, expected.cells)
    assert finished.origin_x == expected.origin_x
    assert finished.origin_y == expected.origin_y


def test_points_in_them_are_not_in_observed_cells(grids):
    beyond = returns_of_room() * 1.02
    values, expected = (values_at(grid, beyond, AWAY).clip(0.0) for grid in grids)
    assert np.array_equal(values, expected)
    assert share_of_seen(grids[0], beyond, AWAY) == share_of_seen(grids[1], beyond, AWAY)


def test_both_matchers_match_as_without_them(grids):
    points, information = returns_of_room(), np.array([1.0, 0.0, 0.0, 1.0, 0.0, 1.0])
    found, fine = [], []
    for grid in grids:
        window = CorrelativeMatcherConfig()
        found.append(correlative.match(grid, points, AWAY, window, correlative.Scratch()))
        smooth = least_squares.SmoothMap(grid.cells, grid.origin_x, grid.origin_y, grid.resolution)
        options = least_squares.MatchOptions(10.0, 20, 1e-6)
        fine.append(least_squares.match(smooth, points, AWAY, AWAY, information, options))
    assert found[0] == found[1]
    assert fine[0].tf_submap_scan == fine[1].tf_submap_scan
    assert fine[0].cost == fine[1].cost
