# SPDX-License-Identifier: Apache-2.0
"""The outline of a scan: lines that connect the ends of neighbouring beams, found by direction."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cartoloop._jit import borrowing_kernel, inlined_kernel, kernel
from cartoloop.arrays import FloatArray

SHORTEST_M = 1e-300
"""Two ends at the same place make a line of this length [m], so that nothing is divided by zero."""

MIN_SECTORS, SECTORS_A_POINT = 1024, 4
"""All directions are divided into this many sectors at least, and into some for each point."""


class Outline(NamedTuple):
    """The lines of an outline, and where they are in the order of bearings.

    Attributes
    ----------
    lines : float64, (n + 1, 4), x, y of the first end, and unit vector; NaN where there is no line:
        so in the first row, which is before all points, and in the last, which is after them.
    sectors : uint32, (number of sectors + 1,), the row of the last point before each sector.
    """

    lines: FloatArray
    sectors: NDArray[np.uint32]


@kernel
def lines_of(bearings: FloatArray, ends: FloatArray, max_gap: float) -> FloatArray:
    """Return the lines of an outline, see :class:`Outline`."""
    count = bearings.shape[0]
    lines = np.empty((count + 1, 4))
    lines[0] = math.nan
    for k in range(count):
        lines[k + 1, 0], lines[k + 1, 1] = ends[k, 0], ends[k, 1]
        lines[k + 1, 2] = lines[k + 1, 3] = math.nan
        if k + 1 < count and bearings[k + 1] - bearings[k] < max_gap:
            x, y = ends[k + 1, 0] - ends[k, 0], ends[k + 1, 1] - ends[k, 1]
            length = max(math.sqrt(x * x + y * y), SHORTEST_M)
            lines[k + 1, 2], lines[k + 1, 3] = x / length, y / length
    return lines


@inlined_kernel
def _sector_of(x: float, y: float, count: int) -> np.uint64:
    """Return the sector of a direction, of `count`: ascending with bearings, similarly wide."""
    share = y / max(abs(x) + abs(y), SHORTEST_M)
    if x < 0.0:
        share = math.copysign(2.0, y) - share
    return min(np.uint64((share + 2.0) * (0.25 * count)), np.uint64(count - 1))


@kernel
def places_in_sectors(ends: FloatArray) -> NDArray[np.uint32]:
    """Return the row of the last point before each sector, see :class:`Outline`."""
    count = max(MIN_SECTORS, SECTORS_A_POINT * ends.shape[0])
    sectors = np.empty(count + 1, dtype=np.uint32)
    filled = 0
    for k in range(ends.shape[0]):
        sector = _sector_of(ends[k, 0], ends[k, 1], count)
        while filled <= sector:
            sectors[filled] = k
            filled += 1
    sectors[filled:] = ends.shape[0]
    return sectors


@borrowing_kernel
def trace_outline(
    points: FloatArray,
    tf_sensor_points: tuple[float, float, float],
    out_bearings: FloatArray,
    out_ends: FloatArray,
) -> bool:
    """Write points in the frame of a scanner, and where they are seen from there.

    Parameters
    ----------
    points : float64, shape (n, 2) [m].
    tf_sensor_points : x, y [m] and theta [rad].
    out_bearings : float64, shape (n,), directions from the scanner [rad].
    out_ends : float64, shape (n, 2), scanner frame [m].

    Returns
    -------
    whether the bearings ascend, as they do where beams are in order.
    """
    origin_x, origin_y, theta = tf_sensor_points
    cos, sin = math.cos(theta), math.sin(theta)
    ascends = True
    for k in range(points.shape[0]):
        x = origin_x + cos * points[k, 0] - sin * points[k, 1]
        y = origin_y + sin * points[k, 0] + cos * points[k, 1]
        out_ends[k, 0], out_ends[k, 1] = x, y
        out_bearings[k] = math.atan2(y, x)
        if k > 0 and not out_bearings[k] >= out_bearings[k - 1]:
            ascends = False
    return ascends


@inlined_kernel
def line_towards(outline: Outline, x: float, y: float) -> np.uint64:
    """Return the row of the last outline point whose bearing is not above that of (x, y)."""
    lines = outline.lines
    sector = _sector_of(x, y, outline.sectors.shape[0] - 1)
    one = np.uint64(1)  # Indices without a sign: negative ones would count from the end.
    line = np.uint64(outline.sectors[sector])
    last = np.uint64(outline.sectors[sector + one])
    if last - line > one:
        while line < last and lines[line + one, 0] * y - lines[line + one, 1] * x >= 0.0:
            line += one
        return line
    # Without a branch: which one is taken could not be predicted.
    after = line + np.uint64(line < last)
    return after if lines[after, 0] * y - lines[after, 1] * x >= 0.0 else line
