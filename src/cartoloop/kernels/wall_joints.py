# SPDX-License-Identifier: Apache-2.0
"""Where a straight wall is between the returns of neighbouring beams."""

from __future__ import annotations

import math

import numpy as np

from cartoloop._jit import inlined_kernel, kernel
from cartoloop.arrays import FloatArray


@kernel
def wall_joints(
    returns: FloatArray, max_gap: float, min_straightness: float, spacing: float
) -> FloatArray:
    """Return points on straight walls between the returns of neighbouring beams.

    A wall is straight between two returns if the lines from the return before and to the return
    after go on in nearly the same direction, and none of the three lines is long.

    Parameters
    ----------
    returns : float64, shape (n, 2), in the order of the beams [m].
    max_gap : largest distance between two returns in turn that are on one wall [m].
    min_straightness : least cosine of the angle between two lines in turn.
    spacing : largest distance between two points in turn [m].

    Returns
    -------
    float64, shape (k, 2) [m], in the frame of `returns`.
    """
    count = returns.shape[0]
    num_points = np.zeros(max(count - 1, 0), dtype=np.int64)
    lengths = np.empty(max(count - 1, 0))
    for k in range(count - 1):
        x, y = returns[k + 1, 0] - returns[k, 0], returns[k + 1, 1] - returns[k, 1]
        lengths[k] = math.hypot(x, y)
    total = 0
    for k in range(1, count - 2):
        if (
            lengths[k] > spacing
            and _goes_on(returns, lengths, k - 1, max_gap, min_straightness)
            and _goes_on(returns, lengths, k, max_gap, min_straightness)
        ):
            num_points[k] = math.ceil(lengths[k] / spacing) - 1
            total += num_points[k]
    joints = np.empty((total, 2))
    row = 0
    for k in range(count - 1):
        for i in range(num_points[k]):
            share = (i + 1.0) / (num_points[k] + 1.0)
            for axis in range(2):
                start = returns[k, axis]
                joints[row, axis] = start + share * (returns[k + 1, axis] - start)
            row += 1
    return joints


@inlined_kernel
def _goes_on(
    returns: FloatArray, lengths: FloatArray, k: int, max_gap: float, min_straightness: float
) -> bool:
    """Return whether the lines from a return to the next two are one wall."""
    if not max(lengths[k], lengths[k + 1]) <= max_gap:
        return False
    along = 0.0
    for axis in range(2):
        middle = returns[k + 1, axis]
        along += (middle - returns[k, axis]) * (returns[k + 2, axis] - middle)
    return bool(along >= min_straightness * lengths[k] * lengths[k + 1])
