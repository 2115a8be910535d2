# SPDX-License-Identifier: Apache-2.0
"""Agreement of a scan with a map, beam by beam."""

from __future__ import annotations

import math

import numpy as np


def fit(cells, marks, origin, resolution, limits, points, beam_origin, pose):
    """Return the numbers of returns as `count_fit` writes them for a scan."""
    margin = max(limits.off_wall, 1)
    walls = np.argwhere(cells >= limits.wall)
    counts = [0, 0, 0, 0, 0]
    start = _cell(beam_origin, pose, origin, resolution)
    for point in points:
        if math.hypot(*point) > limits.max_range:
            continue
        end = _cell(point, pose, origin, resolution)
        col, row = (math.floor(each + 0.5) for each in end)
        is_inside = (
            margin <= col < cells.shape[1] - margin and margin <= row < cells.shape[0] - margin
        )
        distances = [math.hypot(row - r, col - c) for r, c in walls]
        apart = min(distances, default=math.inf)
        if any(marks[place] < 2 for place in _walls_between(cells, limits, start, end)):
            counts[2] += 1
            counts[4] += is_inside and apart <= limits.on_wall
            continue
        if not is_inside:
            continue
        around = cells[row - 1 : row + 2, col - 1 : col + 2]
        if apart <= limits.on_wall:
            counts[0] += 1
            counts[3] += int(marks[tuple(walls[int(np.argmin(distances))])] % 2)
        elif apart > limits.off_wall and np.all((around > 0) & (around <= limits.floor)):
            counts[1] += 1
    return counts


def _cell(point, pose, origin, resolution):
    cos, sin = math.cos(pose[2]), math.sin(pose[2])
    x = pose[0] + cos * point[0] - sin * point[1]
    y = pose[1] + sin * point[0] + cos * point[1]
    return (x - origin[0]) / resolution, (y - origin[1]) / resolution


def passes(cells, origin, resolution, limits, points, beam_origin, pose):
    """Return the number of beams that pass through each wall."""
    counts = np.zeros(cells.shape, dtype=np.int64)
    start = _cell(beam_origin, pose, origin, resolution)
    for point in points:
        if math.hypot(*point) <= limits.max_range:
            end = _cell(point, pose, origin, resolution)
            for place in set(_walls_between(cells, limits, start, end)):
                counts[place] += 1
    return counts


def _walls_between(cells, limits, start, end):
    """Return the cells of walls that a beam passes through, away from its ends."""
    length = math.dist(start, end)
    steps = [
        k for k in range(int(length) + 1) if limits.clearance <= k <= length - limits.clearance
    ]
    walls = []
    for k in steps:
        col, row = (
            math.floor(a + k / length * (b - a) + 0.5) for a, b in zip(start, end, strict=True)
        )
        inside = 0 <= col < cells.shape[1] and 0 <= row < cells.shape[0]
        if inside and cells[row, col] >= limits.wall:
            walls.append((row, col))
    return walls
