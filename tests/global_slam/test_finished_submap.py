# SPDX-License-Identifier: Apache-2.0
"""What a finished submap keeps, drops and makes anew, and how well scans fit it."""

from __future__ import annotations

import numpy as np
import pytest

from cartoloop.global_slam.finished_submap import (
    FinishedSubmap,
    mean_score,
    release_least_recent,
)
from cartoloop.submaps.finished_grid import MAX_PROBABILITY, MIN_PROBABILITY, FinishedGrid


def wall():
    """Return a grid whose second row is a wall, the first free, the third never observed."""
    cells = np.array([[1] * 8, [255] * 8, [0] * 8], dtype=np.uint8)
    return FinishedGrid(cells, 0.0, 0.0, 0.1)


def searched(index, last_used):
    submap = FinishedSubmap(index, wall(), 0.9)
    assert submap.smooth_map.cells.shape == (3, 8)
    submap.last_used = last_used
    return submap


def test_the_score_is_the_mean_probability_and_unknown_or_outside_counts_as_the_least():
    points = np.array([[0.3, 0.1], [0.3, 0.0], [0.3, 0.2], [9.0, 9.0]])
    expected = (MAX_PROBABILITY + 3.0 * MIN_PROBABILITY) / 4.0
    assert mean_score(wall(), [points], np.zeros((1, 3))) == pytest.approx(expected)


def test_the_score_follows_the_nodes_poses():
    points = np.array([[0.0, 0.0], [0.1, 0.0]])
    poses = np.array([[0.2, 0.1, 0.0]])
    assert mean_score(wall(), [points], poses) == pytest.approx(MAX_PROBABILITY)


def test_no_nodes_and_no_grid_score_nothing():
    assert mean_score(wall(), [], np.zeros((0, 3))) == 0.0


def test_what_was_searched_longest_ago_is_released_first():
    submaps = [searched(0, 3), searched(1, 1), searched(2, 2)]
    each = submaps[0].memory_bytes

    release_least_recent(submaps, 2 * each)

    assert [submap.memory_bytes > 0 for submap in submaps] == [True, False, True]


def test_a_released_submap_makes_its_grids_anew():
    submap = searched(0, 1)
    before = submap.smooth_map.cells.copy()
    submap.release()
    assert submap.memory_bytes == 0
    np.testing.assert_array_equal(submap.smooth_map.cells, before)
