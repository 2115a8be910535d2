# SPDX-License-Identifier: Apache-2.0
"""The search of nodes in a submap: which matches are distinct."""

from __future__ import annotations

import numpy as np
import pytest

from cartoloop.config import ConstraintSearchConfig
from cartoloop.global_slam.closure_search import FinishedSubmap, search
from cartoloop.sensor.scan_points import ScanPoints
from cartoloop.submaps.finished_grid import FinishedGrid, mean_probability
from tests.global_slam.closures import requests

RESOLUTION, WALL, SIDE = 0.1, 220, 60
CORNER = [(0, k) for k in range(12)] + [(k, 0) for k in range(1, 12)]
MARGIN = ConstraintSearchConfig().min_runner_up_margin


def search_corner(value_elsewhere, below_best):
    """Search a corner in a grid that has it, and another one whose cells have another value."""
    cells = np.ones((SIDE, SIDE), np.uint8)
    for row, col in CORNER:
        cells[10 + row, 10 + col] = WALL
        cells[35 + row, 35 + col] = value_elsewhere
    points = np.array([((col + 0.5) * RESOLUTION, (row + 0.5) * RESOLUTION) for row, col in CORNER])
    threshold = mean_probability(WALL) - below_best
    config = ConstraintSearchConfig(min_score=threshold, min_score_ratio=1.0, min_num_points=2)
    request = requests((0, 0))._replace(
        tf_submap_node=np.array([[2.0, 2.0, 0.0]]),
        linear_window=np.array([3.0]),
        angular_window=np.array([0.1]),
    )
    submap = FinishedSubmap(0, FinishedGrid(cells, 0.0, 0.0, RESOLUTION), 1.0)
    return search(submap, np.array([7], np.int32), request, ScanPoints.of([points]), config)


@pytest.mark.parametrize("below_best", [0.5 * MARGIN, 0.001])
def test_a_match_is_ambiguous_if_another_place_fits_as_well(below_best):
    values = np.arange(1, WALL)
    gaps = mean_probability(WALL) - np.array([mean_probability(float(v)) for v in values])
    as_well, worse = values[gaps < 0.95 * MARGIN][0], values[gaps > 1.05 * MARGIN][-1]

    outcome = search_corner(int(as_well), below_best)
    assert outcome.ambiguous.tolist() == [7]
    assert len(outcome.matches.row) == 0

    outcome = search_corner(int(worse), below_best)
    assert outcome.ambiguous.tolist() == []
    assert outcome.matches.row.tolist() == [7]
    assert outcome.matches.tf_submap_node[0, :2] == pytest.approx((1.0, 1.0), abs=RESOLUTION)
