# SPDX-License-Identifier: Apache-2.0
"""Sorting, and single numbers of a sorted sequence: medians and other quantiles."""

from __future__ import annotations

import math

import numpy as np

from cartoloop._jit import borrowing_kernel, kernel
from cartoloop.arrays import FloatArray, IntArray


@borrowing_kernel
def select(values: FloatArray, k: int) -> float:
    """Return the number that would have index k if the numbers were sorted (quickselect).

    Parameters
    ----------
    values : float64, shape (n,), 0 <= k < n, none of them NaN; reordered: no larger ones precede
        index k, no smaller ones follow it.
    """
    first, last = 0, values.shape[0] - 1
    while first < last:
        low, middle, high = values[first], values[(first + last) // 2], values[last]
        pivot = max(min(low, middle), min(max(low, middle), high))
        i, j = first, last
        while i <= j:
            while values[i] < pivot:
                i += 1
            while values[j] > pivot:
                j -= 1
            if i <= j:
                values[i], values[j] = values[j], values[i]
                i += 1
                j -= 1
        if k <= j:
            last = j
        elif k >= i:
            first = i
        else:
            break
    return float(values[k])


@borrowing_kernel
def quantile_of(values: FloatArray, share: float) -> float:
    """Return a quantile of numbers, none of them NaN, linear between two of them.

    Parameters
    ----------
    values : float64, shape (n,), n > 0; reordered.
    share : of the numbers that are smaller, 0 to 1.
    """
    place: float = share * (values.shape[0] - 1)
    below = int(place)
    low = select(values, below)
    weight = place - below
    if weight == 0.0:
        return low
    high = math.inf
    for k in range(below + 1, values.shape[0]):
        high = min(high, values[k])
    # The end that is nearer is exact.
    if weight < 0.5:
        return low + (high - low) * weight
    return high - (high - low) * (1.0 - weight)


@kernel
def distance_quantile(points: FloatArray, share: float) -> float:
    """Return a quantile of the distances of points from the origin [m]; see :func:`quantile_of`.

    Parameters
    ----------
    points : float64, shape (n, 2), n > 0 [m].
    """
    distances = np.empty(points.shape[0])
    for k in range(points.shape[0]):
        distances[k] = math.hypot(points[k, 0], points[k, 1])
    return quantile_of(distances, share)


@borrowing_kernel
def sort_indices(values: FloatArray, order: IntArray) -> None:
    """Write the indices of numbers from the smallest on, of equal ones the first first.

    Shell's sort: fast where the numbers are nearly sorted.

    Parameters
    ----------
    values : float64, shape (n,), none of them NaN.
    order : int64, shape (n,).
    """
    count = values.shape[0]
    for k in range(count):
        order[k] = k
    gap = 1
    while gap < count // 3:
        gap = 3 * gap + 1
    while gap > 0:
        for i in range(gap, count):
            moving = order[i]
            value = values[moving]
            j = i
            while j >= gap:
                other = order[j - gap]
                if values[other] < value or (values[other] == value and other < moving):
                    break
                order[j] = other
                j -= gap
            order[j] = moving
        gap //= 3
