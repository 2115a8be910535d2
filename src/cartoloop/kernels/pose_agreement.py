# SPDX-License-Identifier: Apache-2.0
"""Which of many poses, each known in two frames, lie alike in both."""

from __future__ import annotations

import math

import numpy as np

from cartoloop._jit import kernel
from cartoloop.arrays import BoolArray, FloatArray


@kernel
def lie_alike(
    one: FloatArray,
    other: FloatArray,
    max_error: float,
    error_growth: float,
    max_turn: float,
    turn_growth: float,
) -> BoolArray:
    """Return which pairs of poses have the same relative pose in two frames, shape (n, n).

    Of a pair, it is seen from either of the two: headings that differ a little make a difference
    there. The result is symmetric, and true on its diagonal.

    Parameters
    ----------
    one, other : float64, shape (n, 3), the poses in either frame [m, m, rad].
    max_error, error_growth : how far the relative positions may be apart [m], and by how much more
        for each metre between the two poses.
    max_turn, turn_growth : the same for the relative headings [rad, rad/m].
    """
    count = len(one)
    alike = np.ones((count, count), dtype=np.bool_)
    turns, cos, sin = np.empty(count), np.empty(count), np.empty(count)
    for i in range(count):
        turns[i] = one[i, 2] - other[i, 2]
        cos[i], sin[i] = math.cos(turns[i]), math.sin(turns[i])
    for i in range(count):
        for j in range(i):
            x, y = other[j, 0] - other[i, 0], other[j, 1] - other[i, 1]
            between = math.sqrt(x * x + y * y)
            turn = turns[j] - turns[i]
            turn = abs(turn - math.tau * math.floor(turn / math.tau + 0.5))
            is_alike = turn <= max_turn + turn_growth * between
            if is_alike:
                limit = max_error + error_growth * between
                dx, dy = one[j, 0] - one[i, 0], one[j, 1] - one[i, 1]
                for k in (i, j):
                    off_x = dx - (cos[k] * x - sin[k] * y)
                    off_y = dy - (sin[k] * x + cos[k] * y)
                    is_alike = is_alike and off_x * off_x + off_y * off_y <= limit * limit
            alike[i, j] = alike[j, i] = is_alike
    return alike
