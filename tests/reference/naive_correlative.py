# SPDX-License-Identifier: Apache-2.0
"""The slow, obvious twin of kernels/correlative.py: every candidate by itself."""

from __future__ import annotations

import math


def nearest_probability(grid, unknown, col, row):
    """Return the probability of a cell; `unknown` where never observed or outside."""
    inside = 0 <= row < grid.shape[0] and 0 <= col < grid.shape[1]
    p = float(grid[row, col]) if inside else 0.0
    return p if p > 0.0 else unknown


def naive_scores(grid, unknown, origin, resolution, points, estimate, half_width, rotations):
    """Return the mean probability of each candidate (x steps, y steps, rotation steps) of eq. (10).

    `rotations` are the angles of the steps: step -> angle relative to the estimate [rad].
    """
    scores = {}
    steps = range(-half_width, half_width + 1)
    for turn, angle in rotations.items():
        cos, sin = math.cos(estimate[2] + angle), math.sin(estimate[2] + angle)
        cells = []
        for px, py in points:
            x = estimate[0] + cos * px - sin * py
            y = estimate[1] + sin * px + cos * py
            cells.append(
                (
                    math.floor((x - origin[0]) / resolution + 0.5),
                    math.floor((y - origin[1]) / resolution + 0.5),
                )
            )
        for dy in steps:
            for dx in steps:
                values = [nearest_probability(grid, unknown, c + dx, r + dy) for c, r in cells]
                scores[dx, dy, turn] = sum(values) / len(values)
    return scores
