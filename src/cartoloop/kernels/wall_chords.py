# SPDX-License-Identifier: Apache-2.0
"""Chords along the walls that a scan sees."""

from __future__ import annotations

import math

import numpy as np

from cartoloop._jit import kernel
from cartoloop.arrays import FloatArray, IntArray


@kernel
def chord_ends(
    returns: FloatArray, min_length: float, max_returns: int, max_gap: float
) -> IntArray:
    """Return the index of the return in which a chord from each return ends; 0 of those without.

    That is the first one after it that is far enough away, with no gap between them.

    Parameters
    ----------
    returns : float64, shape (n, 2), in the order of their angles [m].
    min_length : of a chord [m].
    max_returns : a chord ends fewer returns after its first.
    max_gap : neighbouring returns of a wall are closer to each other [m].

    Returns
    -------
    int64, shape (n,).
    """
    count = returns.shape[0]
    ends = np.zeros(count, dtype=np.int64)
    is_joined = np.zeros(count, dtype=np.bool_)  # each to the next one
    for k in range(count - 1):
        x, y = returns[k + 1, 0] - returns[k, 0], returns[k + 1, 1] - returns[k, 1]
        is_joined[k] = math.hypot(x, y) < max_gap
    for k in range(count):
        for end in range(k + 1, min(k + max_returns, count)):
            if not is_joined[end - 1]:
                break
            x, y = returns[end, 0] - returns[k, 0], returns[end, 1] - returns[k, 1]
            if math.hypot(x, y) >= min_length:
                ends[k] = end
                break
    return ends
