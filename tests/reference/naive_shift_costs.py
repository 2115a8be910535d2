# SPDX-License-Identifier: Apache-2.0
"""The slow, obvious twin of kernels/shift_costs.py."""

from __future__ import annotations

import math

import numpy as np

from cartoloop.kernels.smooth_map import smooth_value
from cartoloop.kernels.wall_directions import wall_directions


def naive_shift_costs(smooth_map, unknown, scans, poses, groups, directions, shifts, max_parallel):
    """Return the sums of squares of each group after each shift, and the numbers of points."""
    costs = np.zeros((len(directions), len(shifts)))
    counts = np.zeros(len(directions), dtype=np.int64)
    for points, (x, y, theta), group in zip(scans, poses.tolist(), groups.tolist(), strict=True):
        doubled = np.empty((2, len(points)))
        wall_directions(points, doubled)
        direction = directions[group]
        for point, wall in zip(points, doubled.T, strict=True):
            if wall.any():
                angle = 0.5 * math.atan2(wall[1], wall[0]) + theta
                apart = angle - math.atan2(direction[1], direction[0])
                if math.cos(2.0 * apart) > max_parallel:
                    continue
            counts[group] += 1
            at = (
                x + math.cos(theta) * point[0] - math.sin(theta) * point[1],
                y + math.sin(theta) * point[0] + math.cos(theta) * point[1],
            )
            for number, shift in enumerate(shifts.tolist()):
                place = at + shift * direction
                value = smooth_value(smooth_map, unknown, float(place[0]), float(place[1]))
                costs[group, number] += (1.0 - value) ** 2
    return costs, counts
