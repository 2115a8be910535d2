# SPDX-License-Identifier: Apache-2.0
"""Algorithm 1 of the paper, the naive one: every candidate of the window, one after the other."""

from __future__ import annotations

import math

import numpy as np

P_MIN, P_MAX = 0.1, 0.9


def angular_step(points, resolution, max_range=math.inf):
    """Return delta_theta, eq. (6) and (7); points within half a pixel count as that far away."""
    d_max = min(max(math.hypot(x, y) for x, y in points), max_range)
    cosine = 1.0 - resolution**2 / (2.0 * max(d_max, resolution / 2.0) ** 2)
    return math.acos(max(cosine, -1.0))


def num_steps(window, step):
    """Return w of eq. (8); a whole number of steps needs no further one for rounding."""
    return math.ceil(window / step - 1e-9)


def naive_sums(cells, origin, resolution, points, estimate, half_cols, half_rows, half_turns, step):
    """Return the sum of cell values of each candidate, by its steps (x, y, rotation), eq. (9)."""
    num_rows, num_cols = cells.shape
    sums = {}
    for turn in range(-half_turns, half_turns + 1):
        theta = estimate[2] + turn * step
        cos, sin = math.cos(theta), math.sin(theta)
        cols, rows = [], []
        for px, py in points:
            x = estimate[0] + (cos * px - sin * py) - origin[0]
            y = estimate[1] + (sin * px + cos * py) - origin[1]
            cols.append(math.floor(x / resolution + 0.5))
            rows.append(math.floor(y / resolution + 0.5))
        cols, rows = np.array(cols), np.array(rows)
        for dy in range(-half_rows, half_rows + 1):
            for dx in range(-half_cols, half_cols + 1):
                c, r = cols + dx, rows + dy
                inside = (c >= 0) & (c < num_cols) & (r >= 0) & (r < num_rows)
                sums[dx, dy, turn] = int(cells[r[inside], c[inside]].sum(dtype=np.int64))
    return sums


def naive_best(sums):
    """Return the best candidate: of equal sums the one of the fewest steps, then the first one."""

    def rank(candidate):
        dx, dy, turn = candidate
        return (-sums[candidate], dx * dx + dy * dy + turn * turn, turn, dy, dx)

    return min(sums, key=rank)


def naive_runner_up(sums, best, resolution, step, distance, angle):
    """Return the largest sum farther from the best candidate, or turned by more; -1 without one."""
    found = -1
    for (dx, dy, turn), total in sums.items():
        away = math.hypot(dx - best[0], dy - best[1]) * resolution > distance + 1e-9
        turned = abs(turn - best[2]) * step > angle + 1e-9
        if (away or turned) and total > found:
            found = total
    return found


def score(total, num_points):
    """Return the mean probability that a sum of cell values stands for."""
    return P_MIN + (total / num_points - 1.0) * (P_MAX - P_MIN) / 254.0


def naive_boxes(cells, stride, edge, margin, num_rows, num_cols):
    """Return the maxima over boxes of `edge` strides that begin every `stride` cells."""
    maxima = np.zeros((num_rows, num_cols), dtype=np.uint8)
    for row in range(num_rows):
        for col in range(num_cols):
            top, left = (row - margin) * stride, (col - margin) * stride
            box = cells[
                max(top, 0) : max(top + edge * stride, 0),
                max(left, 0) : max(left + edge * stride, 0),
            ]
            maxima[row, col] = box.max() if box.size else 0
    return maxima
