# SPDX-License-Identifier: Apache-2.0
"""Agreement of returns with a submap, and the best shift, cell by cell."""

from __future__ import annotations

import math

import numpy as np


def agreement(cells, origin, resolution, limits, points, pose):
    """Return the numbers of returns on walls and on floor."""
    margin = max(limits.off_wall, 1)
    walls = [(row, col) for row, col in np.argwhere(cells >= limits.wall).tolist()]
    on_wall = on_floor = 0
    for x, y in points:
        if math.hypot(x, y) > limits.max_range:
            continue
        cos, sin = math.cos(pose[2]), math.sin(pose[2])
        col = math.floor((pose[0] + cos * x - sin * y - origin[0]) / resolution + 0.5)
        row = math.floor((pose[1] + sin * x + cos * y - origin[1]) / resolution + 0.5)
        if not (
            margin <= col < cells.shape[1] - margin and margin <= row < cells.shape[0] - margin
        ):
            continue
        # Walls outside the square that a kernel looks at are farther than either limit.
        apart = min((math.hypot(row - r, col - c) for r, c in walls), default=math.inf)
        around = cells[row - 1 : row + 2, col - 1 : col + 2]
        if apart <= limits.on_wall:
            on_wall += 1
        elif apart > limits.off_wall and np.all((around > 0) & (around <= limits.floor)):
            on_floor += 1
    return on_wall, on_floor


def best_shift(cells, origin, resolution, wall, window, points):
    """Return how many points fit near and elsewhere at the best shift, and the shift."""
    centre = points.mean(axis=0)
    near, best = 0, (0, 0.0, 0.0, 0.0)
    for turn in range(-window.turns, window.turns + 1):
        angle = turn * window.turn
        rotation = np.array(
            ((math.cos(angle), -math.sin(angle)), (math.sin(angle), math.cos(angle)))
        )
        turned = centre + (points - centre) @ rotation.T
        cols = np.floor((turned[:, 0] - origin[0]) / resolution).astype(int)
        rows = np.floor((turned[:, 1] - origin[1]) / resolution).astype(int)
        for down in range(-window.steps, window.steps + 1):
            for right in range(-window.steps, window.steps + 1):
                steps = math.hypot(down, right)
                fitting = 0
                for row, col in zip(rows, cols, strict=True):
                    r, c = row + down * window.step_cells, col + right * window.step_cells
                    if 0 <= r < len(cells) - 1 and 0 <= c < cells.shape[1] - 1:
                        fitting += bool(np.any(cells[r : r + 2, c : c + 2] >= wall))
                if steps <= window.near_steps:
                    near = max(near, fitting)
                elif steps >= window.near_steps + 1 and fitting > best[0]:
                    step = window.step_cells * resolution
                    best = (fitting, right * step, down * step, angle)
    return near, *best


def fits_along(cells, origin, resolution, wall, points, direction, shifts):
    """Return how many points fit at each shift along a direction."""
    counts = []
    for shift in shifts:
        fitting = 0
        for x, y in points:
            col = math.floor((x + (shift * direction[0] - origin[0])) / resolution)
            row = math.floor((y + (shift * direction[1] - origin[1])) / resolution)
            if 0 <= row < len(cells) - 1 and 0 <= col < cells.shape[1] - 1:
                fitting += bool(np.any(cells[row : row + 2, col : col + 2] >= wall))
        counts.append(fitting)
    return counts
