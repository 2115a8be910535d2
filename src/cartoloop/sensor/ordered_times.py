# SPDX-License-Identifier: Apache-2.0
"""Times in order: repeated ones spread, those out of order left out or raised."""

from __future__ import annotations

from bisect import bisect_right

import numpy as np

from cartoloop.arrays import FloatArray, IntArray


def spread_repeats(stamps: FloatArray, period: float) -> FloatArray:
    """Return increasing times for stamps in order, equal ones spread towards the next.

    Parameters
    ----------
    stamps : float64, shape (n,), none smaller than the one before [s].
    period : the widest spacing among equal stamps [s].
    """
    firsts = np.flatnonzero(np.concatenate(([True], np.diff(stamps) > 0.0)))[: len(stamps)]
    if len(firsts) == len(stamps):
        return stamps.copy()
    counts = np.diff(np.append(firsts, len(stamps)))
    values = stamps[firsts]
    room = np.append(np.diff(values), np.inf) / counts
    rank = np.arange(len(stamps)) - np.repeat(firsts, counts)
    spacing = np.minimum(room, period)
    spread: FloatArray = stamps + rank * np.repeat(spacing, counts)
    return strictly_increasing(spread)


def longest_ordered(values: FloatArray) -> IntArray:
    """Return the indices of a longest subsequence that never decreases. O(n log n)."""
    tails: list[float] = []
    tail_indices: list[int] = []
    previous = np.full(len(values), -1, dtype=np.int64)
    for i, value in enumerate(values.tolist()):
        length = bisect_right(tails, value)
        if length == len(tails):
            tails.append(value)
            tail_indices.append(i)
        else:
            tails[length] = value
            tail_indices[length] = i
        previous[i] = tail_indices[length - 1] if length else -1
    chain = []
    i = tail_indices[-1] if tail_indices else -1
    while i >= 0:
        chain.append(i)
        i = int(previous[i])
    return np.array(chain[::-1], dtype=np.int64)


def strictly_increasing(times: FloatArray) -> FloatArray:
    """Return the times, raised as little as possible where they do not increase."""
    if len(times) < 2 or (np.diff(times) > 0.0).all():
        return times
    # A ramp of a few rounding errors keeps the running maximum from being flat.
    tiny = 4.0 * np.spacing(np.abs(times).max())
    ramp = tiny * np.arange(len(times))
    reached = np.maximum.accumulate(times - ramp)
    lifted: FloatArray = np.where(reached > times - ramp, reached + ramp, times)
    return lifted
