# SPDX-License-Identifier: Apache-2.0
"""How well a scan fits the outline of another one when it is shifted along a direction."""

from __future__ import annotations

import math

import numpy as np

from cartoloop._jit import inlined_kernel, kernel
from cartoloop.arrays import BoolArray, FloatArray


@kernel
def outline_costs(
    bearings: FloatArray,
    ends: FloatArray,
    is_line: BoolArray,
    points: FloatArray,
    along: FloatArray,
    shifts: FloatArray,
    sigma: float,
    max_distance: float,
    outside_cost: float,
    out_costs: FloatArray,
) -> None:
    """Write the cost of each shift: half the sum of squared distances from the lines, in sigmas.

    Parameters
    ----------
    bearings : float64, shape (n,), directions of the outline's points from the scanner, ascending
        [rad].
    ends : float64, shape (n, 2), the outline's points [m], scanner frame; n > 1.
    is_line : bool, shape (n - 1,), whether two neighbouring points are the ends of a line.
    points : float64, shape (m, 2), the other scan [m], scanner frame.
    along : float64, shape (2,), unit vector of the shifts.
    shifts : float64, shape (k,) [m].
    sigma : standard deviation of a distance [m].
    max_distance : larger distances cost as much as this one [m].
    outside_cost : share of that which a point costs in whose direction there is no line.
    out_costs : float64, shape (k,).

    Notes
    -----
    As a point is shifted, its direction changes little, so that its line is found from the last.
    """
    out_costs[:] = 0.0
    limit = 0.5 * (max_distance / sigma) ** 2
    num_lines = is_line.shape[0]
    lengths = np.empty((num_lines, 2))
    for line in range(num_lines):
        x, y = ends[line + 1, 0] - ends[line, 0], ends[line + 1, 1] - ends[line, 1]
        length = max(math.hypot(x, y), 1e-300)
        lengths[line, 0], lengths[line, 1] = x / length, y / length
    for point in range(points.shape[0]):
        line = -1
        for k in range(shifts.shape[0]):
            x = points[point, 0] + shifts[k] * along[0]
            y = points[point, 1] + shifts[k] * along[1]
            line = _line_towards(bearings, ends, x, y, line)
            if line < 0 or line >= num_lines or not is_line[line]:
                out_costs[k] += outside_cost * limit
                continue
            distance = (x - ends[line, 0]) * lengths[line, 1] - (y - ends[line, 1]) * lengths[
                line, 0
            ]
            out_costs[k] += min(0.5 * (distance / sigma) ** 2, limit)


@inlined_kernel
def _line_towards(bearings: FloatArray, ends: FloatArray, x: float, y: float, line: int) -> int:
    """Return the last outline point whose bearing is not above that of (x, y), -1 without any.

    `line` is a guess; one next to the answer saves time.
    """
    last = bearings.shape[0] - 1
    # Cross products compare directions that are less than half a turn apart.
    if 0 <= line < last and ends[line, 0] * x + ends[line, 1] * y > 0.0:
        while line >= 0 and ends[line, 0] * y - ends[line, 1] * x < 0.0:
            line -= 1
        if line >= 0:
            while line < last and ends[line + 1, 0] * y - ends[line + 1, 1] * x >= 0.0:
                line += 1
        if 0 <= line < last:
            return line
    return int(np.searchsorted(bearings, math.atan2(y, x), side="right")) - 1
