# SPDX-License-Identifier: Apache-2.0
"""The slow, obvious twin of kernels/scan_residuals.py: (CS) without a derivative in it."""

from __future__ import annotations

import math

import numpy as np
from scipy.interpolate import BSpline


def _hermite(before, left, right, after, u):
    """The cubic from `left` to `right` whose slopes at both are central differences."""
    slope_left, slope_right = (right - before) / 2, (after - left) / 2
    return (
        (2 * u**3 - 3 * u**2 + 1) * left
        + (u**3 - 2 * u**2 + u) * slope_left
        + (3 * u**2 - 2 * u**3) * right
        + (u**3 - u**2) * slope_right
    )


def naive_smooth_probability(grid, unknown, col, row):
    """Return M_smooth at (col, row) of a grid that goes on as `unknown` for ever."""

    def value(at_col, at_row):
        inside = 0 <= at_row < grid.shape[0] and 0 <= at_col < grid.shape[1]
        p = float(grid[at_row, at_col]) if inside else 0.0
        return p if p > 0.0 else unknown

    left, below = math.floor(col), math.floor(row)
    along = [
        _hermite(*(value(c, r) for c in range(left - 1, left + 3)), col - left)
        for r in range(below - 1, below + 3)
    ]
    return _hermite(*along, row - below)


def naive_smoothed_probability(grid, unknown, col, row):
    """Return the cells weighted by their distances, in both directions, by the cubic B-spline."""
    bell = BSpline.basis_element([-2.0, -1.0, 0.0, 1.0, 2.0], extrapolate=False)
    total = 0.0
    for at_row in range(math.floor(row) - 2, math.floor(row) + 4):
        for at_col in range(math.floor(col) - 2, math.floor(col) + 4):
            weight = np.nan_to_num(bell(at_col - col)) * np.nan_to_num(bell(at_row - row))
            inside = 0 <= at_row < grid.shape[0] and 0 <= at_col < grid.shape[1]
            p = float(grid[at_row, at_col]) if inside else 0.0
            total += weight * (p if p > 0.0 else unknown)
    return total


def naive_errors(grid, unknown, origin, resolution, points, pose):
    """Return 1 - M_smooth at each point, the scan being at `pose`."""
    cos, sin = math.cos(pose[2]), math.sin(pose[2])
    return np.array(
        [
            1.0
            - naive_smooth_probability(
                grid,
                unknown,
                (pose[0] + cos * x - sin * y - origin[0]) / resolution,
                (pose[1] + sin * x + cos * y - origin[1]) / resolution,
            )
            for x, y in points
        ]
    )


def central_differences(function, at, step):
    """Return the derivatives of a vector function, a column for each argument."""
    columns = []
    for k in range(len(at)):
        forth, back = np.array(at, dtype=np.float64), np.array(at, dtype=np.float64)
        forth[k] += step
        back[k] -= step
        columns.append((np.asarray(function(forth)) - np.asarray(function(back))) / (2 * step))
    return np.stack(columns, axis=-1)
