# SPDX-License-Identifier: Apache-2.0
"""Which scans are sparse, and how their submaps are searched."""

from __future__ import annotations

import numpy as np

from cartoloop.global_slam.closure_search import FinishedSubmap
from cartoloop.global_slam.sparse_scans import are_sparse
from cartoloop.sensor.pose import Pose
from cartoloop.sensor.scan_points import ScanPoints
from cartoloop.submaps.finished_grid import FinishedGrid


def along(*positions):
    return np.array([(x, 0.0, 0.0) for x in positions]).reshape(-1, 3)


def test_a_scan_a_metre_is_sparse():
    assert are_sparse(along(0.0, 1.0, 2.1, 2.9))


def test_usual_nodes_are_not():
    assert not are_sparse(along(*np.arange(0.0, 8.0, 0.2)))


def test_turns_on_the_spot_do_not_count():
    assert are_sparse(along(0.0, 0.0, 0.01, 0.02, 1.0, 1.0, 1.0, 2.0))


def test_a_single_gap_makes_no_sparse_scans():
    assert not are_sparse(along(0.0, 0.2, 0.4, 5.0, 5.2))


def test_none_and_one_are_not():
    assert not are_sparse(along())
    assert not are_sparse(along(1.0))


def wall_with_holes():
    """Return a submap grid of a wall; every third of its pixels was hit."""
    cells = np.full((40, 60), 40, np.uint8)
    cells[20, ::3] = 250
    return FinishedGrid(cells, 0.0, 0.0, 0.05)


def wall_points():
    return np.column_stack((np.arange(-1.0, 1.0, 0.04), np.zeros(50)))


def best_score(submap):
    found = submap.matcher.match(
        wall_points(), Pose(1.5, 1.0, 0.0), linear_window=0.3, angular_window=0.1, min_score=0.0
    )
    return found.score


def test_holes_of_sparse_scans_are_closed_for_the_search():
    poses, grid = along(0.0, 1.0, 2.0), wall_with_holes()
    scans = ScanPoints.of([wall_points()] * 3)
    sparse = FinishedSubmap.of(0, grid, scans, poses)
    dense = FinishedSubmap.of(0, grid, scans, 0.1 * poses)
    assert (sparse.is_sparse, dense.is_sparse) == (True, False)
    assert best_score(sparse) > 0.8 > 0.6 > best_score(dense)


def test_the_refinement_keeps_the_cells_as_they_are():
    grid = wall_with_holes()
    sparse = FinishedSubmap(0, grid, 0.5, is_sparse=True)
    dense = FinishedSubmap(0, grid, 0.5)
    np.testing.assert_array_equal(sparse.smooth_map.cells, dense.smooth_map.cells)
