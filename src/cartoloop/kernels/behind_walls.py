# SPDX-License-Identifier: Apache-2.0
"""Points behind the walls that a scan sees, as far behind them as the scan sees in front."""

from __future__ import annotations

import math

import numpy as np

from cartoloop._jit import borrowing_kernel, kernel
from cartoloop.arrays import FloatArray

MAX_BEAMS = 24
"""Number of beams to either side over which the direction of a wall is measured."""


@kernel
def points_behind_walls(
    origin_x: float,
    origin_y: float,
    returns: FloatArray,
    reach: float,
    min_straightness: float,
    depth: float,
) -> FloatArray:
    """Return, for each return on a straight wall, the point behind it, perpendicular to the wall.

    The direction of a wall is that of the line between the first returns on either side that are
    at least `reach` away, or the last of `MAX_BEAMS` beams. It is straight if the lines from the
    one and to the other go on in nearly the same direction, and neither is longer than `3 reach`.

    Parameters
    ----------
    origin_x, origin_y : where the beams start [m].
    returns : float64, shape (n, 2), in the order of the beams, same frame [m].
    reach : [m].
    min_straightness : least cosine of the angle between the two lines.
    depth : distance behind the wall [m].

    Returns
    -------
    float64, shape (k, 2) [m], in the order of the beams.
    """
    count = returns.shape[0]
    behind = np.empty((count, 2))
    num_behind, longest = 0, (3.0 * reach) ** 2
    for k in range(1, count - 1):
        first, last = _end_of_wall(returns, k, -1, reach), _end_of_wall(returns, k, 1, reach)
        before_x, before_y = returns[k, 0] - returns[first, 0], returns[k, 1] - returns[first, 1]
        after_x, after_y = returns[last, 0] - returns[k, 0], returns[last, 1] - returns[k, 1]
        before, after = before_x**2 + before_y**2, after_x**2 + after_y**2
        if not (0.0 < before <= longest and 0.0 < after <= longest):
            continue
        product = math.sqrt(before * after)
        if before_x * after_x + before_y * after_y < min_straightness * product:
            continue
        along_x, along_y = before_x + after_x, before_y + after_y
        # the side of the wall on which the origin is not
        facing = along_x * (returns[k, 1] - origin_y) - along_y * (returns[k, 0] - origin_x)
        shift = math.copysign(depth, facing) / math.sqrt(along_x**2 + along_y**2)
        behind[num_behind, 0] = returns[k, 0] - shift * along_y
        behind[num_behind, 1] = returns[k, 1] + shift * along_x
        num_behind += 1
    return behind[:num_behind]


@borrowing_kernel
def _end_of_wall(returns: FloatArray, k: int, step: int, reach: float) -> int:
    """Return the first return from `k` on, in steps of 1 or -1, that is at least `reach` away."""
    at_x, at_y = returns[k, 0], returns[k, 1]
    farthest = min(max(k + MAX_BEAMS * step, 0), returns.shape[0] - 1)
    end = k + step
    while end != farthest:
        x, y = returns[end, 0] - at_x, returns[end, 1] - at_y
        if x * x + y * y >= reach * reach:
            break
        end += step
    return end
