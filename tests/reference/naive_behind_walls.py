# SPDX-License-Identifier: Apache-2.0
"""Points behind walls, beam by beam."""

from __future__ import annotations

import math


def naive_points_behind_walls(origin, returns, reach, min_straightness, depth, max_beams):
    """Return the point `depth` behind each return on a straight wall."""
    behind = []
    for k in range(1, len(returns) - 1):
        ends = []
        for others in (range(k - 1, -1, -1), range(k + 1, len(returns))):
            nearby = list(others)[:max_beams]
            far = [i for i in nearby if math.dist(returns[i], returns[k]) >= reach]
            ends.append(returns[far[0] if far else nearby[-1]])
        before = vector(ends[0], returns[k])
        after = vector(returns[k], ends[1])
        lengths = math.hypot(*before), math.hypot(*after)
        if min(lengths) == 0.0 or max(lengths) > 3.0 * reach:
            continue
        if dot(before, after) < min_straightness * lengths[0] * lengths[1]:
            continue
        along = vector(ends[0], ends[1])
        normal = -along[1] / math.hypot(*along), along[0] / math.hypot(*along)
        if dot(normal, vector(origin, returns[k])) < 0.0:
            normal = -normal[0], -normal[1]
        behind.append(tuple(x + depth * n for x, n in zip(returns[k], normal, strict=True)))
    return behind


def vector(start, end):
    """Return the vector from one point to another."""
    return end[0] - start[0], end[1] - start[1]


def dot(one, other):
    """Return the scalar product."""
    return one[0] * other[0] + one[1] * other[1]
