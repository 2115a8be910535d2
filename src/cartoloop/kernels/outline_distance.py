# SPDX-License-Identifier: Apache-2.0
"""How far points are from an outline."""

from __future__ import annotations

from cartoloop._jit import kernel
from cartoloop.arrays import FloatArray


@kernel
def count_apart(points: FloatArray, starts: FloatArray, ends: FloatArray, limit: float) -> int:
    """Return how many points are farther from all edges of an outline than a limit.

    Parameters
    ----------
    points : float64, shape (n, 2) [m].
    starts, ends : float64, shapes (k, 2), of the edges, none of them without a length [m].
    limit : not negative [m].
    """
    count = 0
    for i in range(len(points)):
        is_apart = True
        for k in range(len(starts)):
            along_x, along_y = ends[k, 0] - starts[k, 0], ends[k, 1] - starts[k, 1]
            x, y = points[i, 0] - starts[k, 0], points[i, 1] - starts[k, 1]
            share = (x * along_x + y * along_y) / (along_x * along_x + along_y * along_y)
            share = min(max(share, 0.0), 1.0)
            x, y = x - share * along_x, y - share * along_y
            if x * x + y * y <= limit * limit:
                is_apart = False
                break
        count += is_apart
    return count
