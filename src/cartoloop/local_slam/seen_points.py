# SPDX-License-Identifier: Apache-2.0
"""The points of a scan that lie in observed cells of a submap: only they can contradict a pose."""

from __future__ import annotations

import math

import numpy as np

from cartoloop.arrays import FloatArray
from cartoloop.config import CorrelativeMatcherConfig
from cartoloop.sensor.pose import Pose, transform_points
from cartoloop.submaps.probability_grid import ProbabilityGrid


def share_of_seen(grid: ProbabilityGrid, points: FloatArray, tf_submap_scan: Pose) -> float:
    """Return the share of the points in observed cells.

    Parameters
    ----------
    points : float64, shape (n, 2), tracking frame [m].
    """
    return np.count_nonzero(values_at(grid, points, tf_submap_scan) > 0.0) / len(points)


def residual_of_seen(
    grid: ProbabilityGrid,
    points: FloatArray,
    tf_submap_scan: Pose,
    config: CorrelativeMatcherConfig,
) -> float:
    """Return the residual of the points in observed cells; 0 if these are too few to judge.

    Parameters
    ----------
    points : float64, shape (n, 2), tracking frame [m].
    """
    values = values_at(grid, points, tf_submap_scan)
    seen = values[values > 0.0]
    if seen.size < max(config.min_num_seen, config.min_seen_share * len(points)):
        return 0.0
    return math.sqrt(float(np.square(1.0 - seen).mean()))


def values_at(grid: ProbabilityGrid, points: FloatArray, tf_submap_scan: Pose) -> FloatArray:
    """Return the value of the cell of each point, shape (n,); 0 or less where nothing was observed.

    Parameters
    ----------
    points : float64, shape (n, 2), tracking frame [m].
    """
    num_rows, num_columns = grid.cells.shape
    at = transform_points(tf_submap_scan, points) - (grid.origin_x, grid.origin_y)
    cells = np.floor(at / grid.resolution + 0.5).clip(-1, max(num_rows, num_columns))
    columns, rows = cells.astype(np.int64).T
    is_inside = (rows >= 0) & (rows < num_rows) & (columns >= 0) & (columns < num_columns)
    values = np.zeros(len(points))
    values[is_inside] = grid.cells[rows[is_inside], columns[is_inside]]
    return values
