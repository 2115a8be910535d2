# SPDX-License-Identifier: Apache-2.0
"""Costs of shifts against an outline, one point and one line after the other."""

from __future__ import annotations

import math


def naive_costs(bearings, ends, max_gap, points, shift, fit, unseen_costs):
    """Return the costs of points, all moved by `shift`, against an outline.

    `unseen_costs` has what each point costs beyond the ends of a gap, and beside all points.
    """
    sigma, max_distance, outside_share, _, _ = fit
    limit = 0.5 * (max_distance / sigma) ** 2
    costs = []
    for point, (beyond, beside) in zip(points, unseen_costs, strict=True):
        x, y = point[0] + shift[0], point[1] + shift[1]
        bearing = math.atan2(y, x)
        line = max((k for k in range(len(bearings)) if bearings[k] <= bearing), default=-1)
        if not 0 <= line < len(bearings) - 1:
            costs.append(beside)
            continue
        (ax, ay), (bx, by) = ends[line], ends[line + 1]
        if bearings[line + 1] - bearings[line] >= max_gap:
            is_beyond = math.hypot(x, y) > min(math.hypot(ax, ay), math.hypot(bx, by))
            costs.append(beyond if is_beyond else outside_share * limit)
            continue
        distance = ((x - ax) * (by - ay) - (y - ay) * (bx - ax)) / math.hypot(bx - ax, by - ay)
        costs.append(min(0.5 * (distance / sigma) ** 2, limit))
    return costs


def naive_unseen_costs(bearings, ends, max_gap, points, fit):
    """Return what points cost that leave the outline's view: as much as where they are."""
    limit = 0.5 * (fit[1] / fit[0]) ** 2
    unseen = [(math.inf, math.inf)] * len(points)
    costs = naive_costs(bearings, ends, max_gap, points, (0.0, 0.0), fit, unseen)
    fitting = [cost for cost in costs if cost < limit]
    mean = sum(fitting) / max(len(fitting), 1)
    return [cost if cost < limit else mean for cost in costs]


def naive_loss(points, before, after, stretch_m):
    """Return by how much more stretches of consecutive points cost after than before, in all."""
    stretches, length = [[]], 0.0
    for k, (less, more) in enumerate(zip(before, after, strict=True)):
        if k > 0:
            length += math.dist(points[k - 1], points[k])
        if length > stretch_m:
            stretches.append([])
            length = 0.0
        stretches[-1].append(more - less)
    return sum(max(sum(stretch), 0.0) for stretch in stretches)


def naive_open_direction(bearings, ends, max_gap):
    """Return the ratio of the information along and across walls, and the direction along them."""
    information = [[0.0, 0.0], [0.0, 0.0]]
    for k in range(len(bearings) - 1):
        if bearings[k + 1] - bearings[k] >= max_gap:
            continue
        x, y = ends[k + 1][0] - ends[k][0], ends[k + 1][1] - ends[k][1]
        length = math.hypot(x, y)
        normal = -y / length, x / length
        for i in range(2):
            for j in range(2):
                information[i][j] += min(length, 1.0) * normal[i] * normal[j]
    (xx, xy), (_, yy) = information
    low = 0.5 * (xx + yy) - math.hypot(0.5 * (xx - yy), xy)
    high = 0.5 * (xx + yy) + math.hypot(0.5 * (xx - yy), xy)
    return low / high, 0.5 * math.atan2(2.0 * xy, xx - yy) + 0.5 * math.pi
