# SPDX-License-Identifier: Apache-2.0
"""Which returns of a scan are on narrow objects that stand free."""

from __future__ import annotations

import math

import numpy as np

from cartoloop._jit import kernel
from cartoloop.arrays import BoolArray, FloatArray, IntArray


@kernel
def mark_free_standing(
    points: FloatArray,
    bearings: FloatArray,
    order: IntArray,
    jump: float,
    widest: float,
    edge_angle: float,
    also_hidden: bool,
    are_free: BoolArray,
) -> None:
    """Mark the returns of objects that are narrow and nearer than what is seen beside them.

    Objects end where the range of the next return by bearing differs.

    Parameters
    ----------
    points : float64, shape (n, 2), frame of the scanner [m].
    bearings : float64, shape (n,) [rad].
    order : int64, shape (n,), indices of the points by their bearings.
    jump : least difference of the ranges of two objects [m].
    widest : objects at least as wide are not narrow [m].
    edge_angle : the view ends at the largest angle between neighbours, if that is larger [rad].
    also_hidden : whether one side may be hidden by an object that is marked.
    are_free : bool, shape (n,): set at the returns of marked objects.
    """
    count = len(order)
    edge = _end_of_view(bearings, order, edge_angle)
    ranges = np.empty(count)
    for k in range(count):
        ranges[k] = math.hypot(points[order[k], 0], points[order[k], 1])
    lasts, num_objects = np.empty(count, dtype=np.int64), 0
    for k in range(count):
        if k == edge or abs(ranges[(k + 1) % count] - ranges[k]) > jump:
            lasts[num_objects] = k
            num_objects += 1
    lasts = lasts[:num_objects]
    # By how much farther is what is seen before and after each object: inf at the end of the view.
    before, after = np.empty(num_objects), np.empty(num_objects)
    is_narrow = np.empty(num_objects, dtype=np.bool_)
    for i in range(num_objects):
        first, last = (lasts[i - 1] + 1) % count, lasts[i]
        left = first - 1 if first > 0 else count - 1
        before[i] = math.inf if left == edge else ranges[left] - ranges[first]
        after[i] = math.inf if last == edge else ranges[(last + 1) % count] - ranges[last]
        wide_x = points[order[last], 0] - points[order[first], 0]
        wide_y = points[order[last], 1] - points[order[first], 1]
        is_narrow[i] = math.hypot(wide_x, wide_y) < widest
    nearer = np.minimum(before, after)
    is_whole = is_narrow & (nearer > 0.0) & (nearer < math.inf)
    for i in range(num_objects):
        is_free = is_whole[i]
        if also_hidden and is_narrow[i]:
            is_free |= 0.0 < after[i] < math.inf and is_whole[i - 1]
            is_free |= 0.0 < before[i] < math.inf and is_whole[(i + 1) % num_objects]
        if is_free:
            _mark(order, (lasts[i - 1] + 1) % count, lasts[i], are_free)


@kernel
def _end_of_view(bearings: FloatArray, order: IntArray, edge_angle: float) -> int:
    """Return after which return in order the largest angle comes, -1 if it is not larger."""
    count, edge, largest = len(order), -1, edge_angle
    for k in range(count):
        if k + 1 < count:
            angle = bearings[order[k + 1]] - bearings[order[k]]
        else:
            angle = bearings[order[0]] + math.tau - bearings[order[k]]
        if angle > largest:
            edge, largest = k, angle
    return edge


@kernel
def _mark(order: IntArray, first: int, last: int, are_free: BoolArray) -> None:
    k = first
    while k != last:
        are_free[order[k]] = True
        k = (k + 1) % len(order)
    are_free[order[last]] = True
