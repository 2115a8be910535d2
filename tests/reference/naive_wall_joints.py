# SPDX-License-Identifier: Apache-2.0
"""The slow, obvious twin of kernels/wall_joints.py."""

from __future__ import annotations

import math


def naive_wall_joints(returns, max_gap, max_bend, spacing):
    """Return the points on straight walls between neighbouring returns, as (x, y)."""
    joints = []
    for k in range(1, len(returns) - 2):
        before, start, end, after = returns[k - 1 : k + 3]
        lines = [(before, start), (start, end), (end, after)]
        length = math.dist(start, end)
        is_wall = all(math.dist(*line) <= max_gap for line in lines)
        bends = [bend(lines[0], lines[1]), bend(lines[1], lines[2])]
        if length > spacing and is_wall and max(bends) <= max_bend:
            parts = math.ceil(length / spacing)
            for i in range(1, parts):
                share = i / parts
                joints.append(
                    (
                        start[0] + share * (end[0] - start[0]),
                        start[1] + share * (end[1] - start[1]),
                    )
                )
    return joints


def bend(line, following):
    """Return the angle between two lines; 0 where one of them is a point."""
    (ax, ay), (bx, by) = (
        (end[0] - start[0], end[1] - start[1]) for start, end in (line, following)
    )
    if not (ax or ay) or not (bx or by):
        return 0.0
    return abs(math.atan2(ax * by - ay * bx, ax * bx + ay * by))
