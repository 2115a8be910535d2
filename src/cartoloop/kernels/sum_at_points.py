# SPDX-License-Identifier: Apache-2.0
"""The sum of the values of a grid at the points of scans."""

from __future__ import annotations

import math

import numpy as np

from cartoloop._jit import kernel
from cartoloop.arrays import ByteArray, FloatArray, IntArray


@kernel
def sum_at_points(
    cells: ByteArray,
    least: int,
    origin_x: float,
    origin_y: float,
    resolution: float,
    points: FloatArray,
    firsts: IntArray,
    ends: IntArray,
    poses: FloatArray,
) -> np.int64:
    """Return the sum of the cells at the points of all scans.

    Parameters
    ----------
    cells : uint8, shape (num_rows, num_cols).
    least : lower limit of a value, and value of points outside.
    origin_x, origin_y, resolution : centre of cell (0, 0) and edge of a cell [m].
    points : float64, shape (n, 2), scan frame [m].
    firsts, ends : int64, shape (k,): scan i has ``points[firsts[i] : ends[i]]``.
    poses : float64, shape (k, 3), of the scans in the grid's frame [m, m, rad].
    """
    num_rows, num_cols = cells.shape
    total = np.int64(0)
    for i in range(firsts.shape[0]):
        cos, sin = math.cos(poses[i, 2]), math.sin(poses[i, 2])
        for k in range(firsts[i], ends[i]):
            x = poses[i, 0] + cos * points[k, 0] - sin * points[k, 1]
            y = poses[i, 1] + sin * points[k, 0] + cos * points[k, 1]
            col = np.int64(np.floor((x - origin_x) / resolution + 0.5))
            row = np.int64(np.floor((y - origin_y) / resolution + 0.5))
            value = np.int64(least)
            if 0 <= col < num_cols and 0 <= row < num_rows:
                value = max(value, np.int64(cells[row, col]))
            total += value
    return total
