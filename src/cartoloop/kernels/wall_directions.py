# SPDX-License-Identifier: Apache-2.0
"""The directions of the straight walls that the points of a scan lie on."""

from __future__ import annotations

import math

from cartoloop._jit import borrowing_kernel
from cartoloop.arrays import FloatArray

REACH_M = 0.4
"""A wall is fitted to the points within this distance [m]: long enough for its direction to be
known to some degrees in spite of the ranges' noise, and short enough to leave door frames out."""

SPARSE_REACH_M, MAX_SPACING_RATIO = 4.0, 2.5
"""The next points on both sides count up to this distance [m] where it is about the same on both
sides: far points are sparse. The larger over the smaller is more next to a door frame."""

MAX_OFFSET_M = 0.03
"""Largest root mean square of the points' distances from the line, and largest distance of the
point itself [m]: walls and the noise of scanners."""


@borrowing_kernel
def wall_directions(points: FloatArray, out_directions: FloatArray) -> None:
    """Write the direction of the straight wall at each point into `out_directions`.

    A point lies on a straight wall if the points before and after it in the scan lie on a line with
    it. Next to corners, door frames, ends of walls and things that are not straight it does not.

    Parameters
    ----------
    points : float64, shape (n, 2), in the order of the beams [m].
    out_directions : float64, shape (2, n): cosine and sine of twice the angle of the wall; 0 where
        there is no straight wall. A direction and its opposite are one.

    Notes
    -----
    O(n points within reach). The line is the main axis of the points' scatter, whose double angle
    needs no trigonometry.
    """
    num_points = points.shape[0]
    for k in range(num_points):
        out_directions[0, k] = out_directions[1, k] = 0.0
        first, end = _neighbours(points, k)
        if end == k + 1:
            continue
        scale = 1.0 / (end - first)
        x = y = xx = xy = yy = 0.0
        for j in range(first, end):
            dx, dy = points[j, 0] - points[k, 0], points[j, 1] - points[k, 1]
            x += dx
            y += dy
            xx += dx * dx
            xy += dx * dy
            yy += dy * dy
        x, y = scale * x, scale * y
        xx, xy, yy = scale * xx - x * x, scale * xy - x * y, scale * yy - y * y
        length = math.sqrt((xx - yy) ** 2 + 4.0 * xy * xy)
        if not length > 0.0:
            continue
        cos, sin = (xx - yy) / length, 2.0 * xy / length
        variance = 0.5 * (xx + yy - length)
        offset = 0.5 * ((1.0 - cos) * x * x - 2.0 * sin * x * y + (1.0 + cos) * y * y)
        if variance <= MAX_OFFSET_M**2 and offset <= MAX_OFFSET_M**2:
            out_directions[0, k] = cos
            out_directions[1, k] = sin


@borrowing_kernel
def _neighbours(points: FloatArray, k: int) -> tuple[int, int]:
    """Return the first of the points around point k, and the one after the last; k, k + 1: none."""
    if k == 0 or k + 1 == points.shape[0]:
        return k, k + 1
    before, after = _square(points, k, k - 1), _square(points, k, k + 1)
    reach = min(max(MAX_SPACING_RATIO**2 * min(before, after), REACH_M**2), SPARSE_REACH_M**2)
    if before > reach or after > reach:
        return k, k + 1
    first, end = k - 1, k + 2
    while first > 0 and _square(points, k, first - 1) <= REACH_M**2:
        first -= 1
    while end < points.shape[0] and _square(points, k, end) <= REACH_M**2:
        end += 1
    return first, end


@borrowing_kernel
def _square(points: FloatArray, k: int, j: int) -> float:
    """Return the squared distance of two points [m^2]."""
    dx, dy = points[j, 0] - points[k, 0], points[j, 1] - points[k, 1]
    return float(dx * dx + dy * dy)
