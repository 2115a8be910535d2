# SPDX-License-Identifier: Apache-2.0
"""What a finished submap keeps, drops and computes again, and how well scans fit it."""

from __future__ import annotations

import numpy as np
import pytest

from cartoloop.global_slam.closure_search import FinishedSubmap, mean_score
from cartoloop.sensor.pose import Pose
from cartoloop.sensor.scan_points import ScanPoints
from cartoloop.submaps.finished_grid import MAX_PROBABILITY, MIN_PROBABILITY, FinishedGrid


def wall():
    """Return a grid whose second row is a wall, the first free, the third never observed."""
    cells = np.array([[1] * 8, [255] * 8, [0] * 8], dtype=np.uint8)
    return FinishedGrid(cells, 0.0, 0.0, 0.1)


def test_unknown_cells_count_as_the_least_probability():
    points = np.array([[0.3, 0.1], [0.3, 0.0], [0.3, 0.2], [9.0, 9.0]])
    expected = (MAX_PROBABILITY + 3.0 * MIN_PROBABILITY) / 4.0
    assert mean_score(wall(), ScanPoints.of([points]), np.zeros((1, 3))) == pytest.approx(expected)


def test_the_score_follows_the_nodes_poses():
    points = np.array([[0.0, 0.0], [0.1, 0.0]])
    poses = np.array([[0.2, 0.1, 0.0]])
    assert mean_score(wall(), ScanPoints.of([points]), poses) == pytest.approx(MAX_PROBABILITY)


def test_no_nodes_and_no_grid_score_nothing():
    assert mean_score(wall(), ScanPoints.of([]), np.zeros((0, 3))) == 0.0


def test_a_released_submap_computes_its_grids_again():
    submap = FinishedSubmap(0, wall(), 0.9)
    before = submap.smooth_map
    submap.release()
    after = submap.smooth_map
    assert after is not before
    np.testing.assert_array_equal(after.cells, before.cells)


def test_what_a_search_needs_is_about_what_it_makes():
    cells = np.random.default_rng(0).integers(0, 256, (400, 500), dtype=np.uint8)
    submap = FinishedSubmap(0, FinishedGrid(cells, 0.0, 0.0, 0.05), 0.9)
    smooth_map = submap.smooth_map
    submap.matcher.match(
        np.zeros((1, 2)), Pose(1.0, 1.0, 0.0), linear_window=1.0, angular_window=0.1, min_score=0.0
    )
    made = smooth_map.cells.nbytes + submap.matcher.memory_bytes
    assert submap.search_bytes == pytest.approx(made, rel=0.5)
