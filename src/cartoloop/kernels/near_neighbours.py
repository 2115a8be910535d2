# SPDX-License-Identifier: Apache-2.0
"""Which returns of a scan have a neighbour by angle near."""

from __future__ import annotations

import math

import numpy as np

from cartoloop._jit import kernel
from cartoloop.arrays import FloatArray, IntArray
from cartoloop.kernels.order_statistics import quantile_of, sort_indices

_MOST = np.iinfo(np.int64).max


@kernel
def with_near_neighbour(points: FloatArray, near: float, spacings: float) -> FloatArray:
    """Return the points that have one of the two beside them by angle near, in their order.

    Parameters
    ----------
    points : float64, shape (n, 2), around the sensor [m]; n > 1.
    near, spacings : near are points within the first [m] and the second times the distance of two
        neighbouring beams, by their median angle, at the range of the point.
    """
    count = points.shape[0]
    angles, order = np.empty(count), np.empty(count, dtype=np.int64)
    for k in range(count):
        angles[k] = math.atan2(points[k, 1], points[k, 0])
    sort_indices(angles, order)
    steps = np.empty(count - 1)
    for k in range(count - 1):
        steps[k] = angles[order[k + 1]] - angles[order[k]]
    slope = spacings * quantile_of(steps, 0.5)
    is_near = np.zeros(count, dtype=np.bool_)
    before = math.inf
    for k in range(count):
        i, after = order[k], math.inf
        x, y = points[i, 0], points[i, 1]
        if k + 1 < count:
            j = order[k + 1]
            after = (points[j, 0] - x) ** 2 + (points[j, 1] - y) ** 2
        limit = near + slope * math.sqrt(x * x + y * y)
        is_near[i] = min(before, after) <= limit * limit
        before = after
    kept = np.empty((count, 2))
    num_kept = 0
    for k in range(count):
        if is_near[k]:
            kept[num_kept, 0], kept[num_kept, 1] = points[k, 0], points[k, 1]
            num_kept += 1
    return kept[:num_kept].copy()  # a view would keep the memory of all


@kernel
def count_near_neighbours(
    ranges: FloatArray,
    min_range: float,
    end_range: float,
    near: float,
    slope: float,
    counts: IntArray,
) -> None:
    """Count for each beam the returns that have a return of a beam beside it near.

    Parameters
    ----------
    ranges : float64, shape (n,) [m]; NaN is no return.
    min_range, end_range : a range in [min_range, end_range) is a return [m].
    near, slope : returns of two beams are near if their ranges differ by no more than the first [m]
        and the second times the range of the first of the two.
    counts : int64, shape (n,), of each beam; the counts are added.
    """
    was_near = False
    for k in range(len(ranges)):
        is_near = False
        if k + 1 < len(ranges) and _is_within(ranges[k], min_range, end_range):
            following = ranges[k + 1]
            limit = near + slope * ranges[k]
            is_near = (
                _is_within(following, min_range, end_range) and abs(following - ranges[k]) <= limit
            )
        if is_near or was_near:
            counts[k] += 1
        was_near = is_near


@kernel
def count_and_hide(
    ranges: FloatArray,
    min_range: float,
    end_range: float,
    near: float,
    slope: float,
    most: float,
    counts: IntArray,
    out_ranges: FloatArray,
) -> int:
    """Count the returns of a scan, see :func:`count_near_neighbours`, then :func:`hide_blocked`."""
    count_near_neighbours(ranges, min_range, end_range, near, slope, counts)
    return hide_blocked(ranges, min_range, end_range, counts, most, out_ranges)


@kernel
def hide_blocked(
    ranges: FloatArray,
    min_range: float,
    end_range: float,
    counts: IntArray,
    most: float,
    out_ranges: FloatArray,
) -> int:
    """Write the ranges of a scan, NaN where blocked beams have no return; return the least count.

    Parameters
    ----------
    ranges : float64, shape (n,) [m].
    min_range, end_range : a range in [min_range, end_range) is a return [m].
    counts : int64, shape (n,), returns of each beam so far.
    most : beams with no more are blocked.
    out_ranges : float64, shape (n,) [m].
    """
    least = _MOST
    for k in range(ranges.shape[0]):
        least = min(least, counts[k])
        is_hidden = counts[k] <= most and not _is_within(ranges[k], min_range, end_range)
        out_ranges[k] = np.nan if is_hidden else ranges[k]
    return least


@kernel
def _is_within(value: float, first: float, end: float) -> bool:
    return first <= value < end
