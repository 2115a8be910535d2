# SPDX-License-Identifier: Apache-2.0
"""The median and other quantiles of a few hundred numbers, in a fraction of the time of NumPy's."""

from __future__ import annotations

import numpy as np

from cartoloop.arrays import FloatArray


def median(values: FloatArray) -> float:
    """Return the median of numbers, none of them NaN, as NumPy does, shape (n,); n > 0."""
    last = len(values) // 2
    if len(values) % 2:
        return float(np.partition(values, last)[last])
    middle = np.partition(values, (last - 1, last))[last - 1 : last + 1]
    return 0.5 * float(middle[0] + middle[1])


def quantile(values: FloatArray, share: float) -> float:
    """Return a quantile of numbers, none of them NaN, as NumPy does, shape (n,); n > 0.

    Parameters
    ----------
    share : of the numbers that are smaller, 0 to 1; linear between two of them.
    """
    place = share * (len(values) - 1)
    below = int(place)
    above = min(below + 1, len(values) - 1)
    part = np.partition(values, (below, above))
    low, high, weight = float(part[below]), float(part[above]), place - below
    # The end that is nearer is exact.
    if weight < 0.5:
        return low + (high - low) * weight
    return high - (high - low) * (1.0 - weight)
