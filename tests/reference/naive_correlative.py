# SPDX-License-Identifier: Apache-2.0
"""The slow, obvious twin of kernels/correlative.py: every candidate by itself."""

from __future__ import annotations

import math

import numpy as np


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


def exhaustive_match(
    grid,
    unknown,
    origin,
    resolution,
    points,
    estimate,
    half_width,
    half_turns,
    step,
    weights,
):
    """Return the first best pose of the window and its score, looking at every candidate in turn.

    Each score is summed in float32, point after point, as the kernel does it: equal to the bit.
    """
    width = 2 * half_width + 1
    best, best_score, best_pose = -1.0, 0.0, None
    known = np.maximum(grid, np.float32(unknown))
    for turn in range(-half_turns, half_turns + 1):
        theta = estimate[2] + turn * step
        cos, sin = math.cos(theta), math.sin(theta)
        sums = np.zeros((width, width), dtype=np.float32)
        for px, py in points:
            x = estimate[0] + cos * px - sin * py
            y = estimate[1] + sin * px + cos * py
            col = math.floor((x - origin[0]) / resolution + 0.5) - half_width
            row = math.floor((y - origin[1]) / resolution + 0.5) - half_width
            window = np.full((width, width), unknown, dtype=np.float32)
            rows = [r for r in range(width) if 0 <= row + r < grid.shape[0]]
            cols = [c for c in range(width) if 0 <= col + c < grid.shape[1]]
            for r in rows:
                for c in cols:
                    window[r, c] = known[row + r, col + c]
            sums += window
        for dy in range(-half_width, half_width + 1):
            for dx in range(-half_width, half_width + 1):
                score = float(sums[dy + half_width, dx + half_width]) / len(points)
                # The C library's: Python's own math.hypot() rounds differently.
                distance = resolution * float(np.hypot(dx, dy))
                delta = weights[0] * distance + weights[1] * abs(turn * step)
                weighted = score * math.exp(-delta * delta)
                if weighted > best:
                    best, best_score = weighted, score
                    best_pose = (
                        estimate[0] + dx * resolution,
                        estimate[1] + dy * resolution,
                        theta,
                    )
    return best_pose, best_score
