# SPDX-License-Identifier: Apache-2.0
"""The pixel-accurate correlative matcher over a small window, exhaustive [Olson 2009]."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from cartoloop._jit import kernel

FloatArray = NDArray[np.float64]


@kernel
def window_sums(
    grid: NDArray[np.float32],
    unknown: np.float32,
    cols: NDArray[np.int64],
    rows: NDArray[np.int64],
    half_width: int,
    out_sums: NDArray[np.float32],
) -> None:
    """Write the sum of probabilities at the points, for each shift by whole cells, into `out_sums`.

    Parameters
    ----------
    grid : shape (num_rows, num_cols), probabilities; 0 where never observed.
    unknown : the value of cells never observed or outside.
    cols, rows : int64, shape (n,), cells of the points without translation.
    half_width : w of eq. (8), in cells.
    out_sums : float32, shape (2 w + 1, 2 w + 1), by row and column of the translation.
    """
    num_rows, num_cols = grid.shape
    width = 2 * half_width + 1
    out_sums[:] = 0.0
    for k in range(cols.shape[0]):
        col = cols[k] - half_width
        row = rows[k] - half_width
        if col >= 0 and row >= 0 and col + width <= num_cols and row + width <= num_rows:
            for dy in range(width):
                for dx in range(width):
                    value = grid[row + dy, col + dx]
                    out_sums[dy, dx] += max(value, unknown)
        else:
            for dy in range(width):
                for dx in range(width):
                    value = unknown
                    if 0 <= col + dx < num_cols and 0 <= row + dy < num_rows:
                        value = max(grid[row + dy, col + dx], unknown)
                    out_sums[dy, dx] += value


@kernel
def match_correlative(
    grid: NDArray[np.float32],
    unknown: float,
    origin_x: float,
    origin_y: float,
    resolution: float,
    points: FloatArray,
    estimate: FloatArray,
    half_width: int,
    half_num_rotations: int,
    rotation_step: float,
    translation_weight: float,
    rotation_weight: float,
    out_pose: FloatArray,
) -> float:
    """Write the best pose of the window into `out_pose`; return its mean probability in [0, 1].

    Parameters
    ----------
    grid, unknown, origin_x, origin_y, resolution : as in :func:`scan_residuals.accumulate_match`.
    points : float64, shape (n, 2), scan frame [m]; n > 0.
    estimate : float64, shape (3,), centre of the window.
    half_width, half_num_rotations : w_x = w_y and w_theta of eq. (8).
    rotation_step : delta_theta of eq. (7) [rad].
    translation_weight, rotation_weight : candidates are compared by their mean probability times
        ``exp(-(translation_weight * distance + rotation_weight * |rotation|)^2)``.
    out_pose : float64, shape (3,).
    """
    num_points = points.shape[0]
    width = 2 * half_width + 1
    sums = np.empty((width, width), dtype=np.float32)
    cols = np.empty(num_points, dtype=np.int64)
    rows = np.empty(num_points, dtype=np.int64)
    best = -1.0
    best_score = 0.0
    for j in range(-half_num_rotations, half_num_rotations + 1):
        theta = estimate[2] + j * rotation_step
        c = math.cos(theta)
        s = math.sin(theta)
        for k in range(num_points):
            x = estimate[0] + c * points[k, 0] - s * points[k, 1]
            y = estimate[1] + s * points[k, 0] + c * points[k, 1]
            cols[k] = np.int64(np.floor((x - origin_x) / resolution + 0.5))
            rows[k] = np.int64(np.floor((y - origin_y) / resolution + 0.5))
        window_sums(grid, np.float32(unknown), cols, rows, half_width, sums)
        for dy in range(width):
            for dx in range(width):
                score = np.float64(sums[dy, dx]) / num_points
                if score <= best:
                    continue
                distance = resolution * math.hypot(dx - half_width, dy - half_width)
                delta = translation_weight * distance + rotation_weight * abs(j * rotation_step)
                weighted = score * math.exp(-delta * delta)
                if weighted > best:
                    best = weighted
                    best_score = score
                    out_pose[0] = estimate[0] + (dx - half_width) * resolution
                    out_pose[1] = estimate[1] + (dy - half_width) * resolution
                    out_pose[2] = theta
    return best_score
