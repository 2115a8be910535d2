# SPDX-License-Identifier: Apache-2.0
"""The pixels that rays from one point intersect, without tracing pixels near the point repeatedly.

A ray is traced row by row: in each row it intersects one span of pixels. Neighbouring rays are
closer together than a pixel for many rows. No pixel fits between them there, so that they and all
rays between them intersect one span, and only the outermost rays have to be traced. So a ray is
traced inwards only to the row up to which both of its neighbours are that close.

Coordinates are in subpixels: whole numbers, so that borders and corners are met exactly.
"""

from __future__ import annotations

import math

import numpy as np

from cartoloop._jit import kernel
from cartoloop.arrays import IntArray
from cartoloop.kernels.pixel_rows import PixelRows, add_span

_SHIFT = 11
"""Bits of a subpixel: products of a ray's components stay below 2**63 in the largest submap."""

SUBPIXELS = 1 << _SHIFT
"""Ray ends are rounded to this fraction of a pixel, so that the traversal is exact in integers."""

CLOSE = 0.999 * SUBPIXELS
"""Distance of rays below which no pixel fits between them [subpixels], less a rounding error."""


@kernel
def mark_rays(start_x: int, start_y: int, ends: IntArray, out_marked: PixelRows) -> int:
    """Mark the pixels that rays from one point intersect; return the number of spans.

    Parameters
    ----------
    start_x, start_y : common start of the rays, subpixels from the corner of pixel (0, 0).
    ends : int64, shape (n, 2), their ends x, y, likewise. The result does not depend on the order;
        it is fastest where neighbouring rays follow each other.
    out_marked : as in :mod:`~cartoloop.kernels.pixel_rows`; large enough for all rays.

    Notes
    -----
    A ray intersects the pixels along which it has length, and those in which it starts and ends;
    a pixel has its left and lower border. So a ray through a corner common to four pixels passes
    from one to the opposite one.
    """
    num_rays: int = ends.shape[0]
    if num_rays == 0:
        return 0
    add_span(out_marked, start_y >> _SHIFT, start_x >> _SHIFT, start_x >> _SHIFT)
    for k in range(num_rays):
        end_x, end_y = ends[k, 0], ends[k, 1]
        other_x = start_x if end_y == start_y else end_x
        first_x, last_x = min(end_x, other_x), max(end_x, other_x)
        add_span(out_marked, end_y >> _SHIFT, first_x >> _SHIFT, last_x >> _SHIFT)
    num_spans = 1 + num_rays
    for upwards in (1, -1):
        num_spans += _mark_side(start_x, start_y, ends, upwards, out_marked)
    return num_spans


@kernel
def _mark_side(
    start_x: int, start_y: int, ends: IntArray, upwards: int, out_marked: PixelRows
) -> int:
    """Mark the pixels along the rays that go up (1) or down (-1); return the number of spans.

    A ray goes by `run` along x and by `rise` > 0 up or down; rows count from its first one.
    """
    start_row = start_y >> _SHIFT if upwards > 0 else (start_y - 1) >> _SHIFT
    border = start_row + 1 if upwards > 0 else start_row
    first_rise = upwards * (border * SUBPIXELS - start_y)
    runs = np.empty(ends.shape[0], dtype=np.int64)
    rises = np.empty(ends.shape[0], dtype=np.int64)
    num_rays = 0
    for k in range(ends.shape[0]):
        rise = upwards * (ends[k, 1] - start_y)
        if rise > 0:
            runs[num_rays] = ends[k, 0] - start_x
            rises[num_rays] = rise
            num_rays += 1
    close = np.empty(num_rays + 1, dtype=np.int64)
    _find_close_rows(runs, rises, first_rise, close)
    open_spans = np.empty((out_marked.shape[0], 2), dtype=np.int64)
    num_spans = 0
    for k in range(num_rays):
        num_spans += _mark_ray(
            start_x,
            start_row,
            upwards,
            first_rise,
            runs[k],
            rises[k],
            close[k],
            close[k + 1],
            open_spans,
            out_marked,
        )
    return num_spans


@kernel
def _find_close_rows(runs: IntArray, rises: IntArray, first_rise: int, out_close: IntArray) -> None:
    """Write the last row without room for a pixel between each ray and the one before; -1: none.

    Parameters
    ----------
    runs, rises : int64, shape (>= num_rays,), components of the rays along x and y.
    first_rise : the rise at the far border of the row they begin in.
    out_close : int64, shape (num_rays + 1,); the first and the last ray have one neighbour only.

    Notes
    -----
    Up to a distance D, two points between rays that enclose an angle a < 90 degrees are at most
    D sin a apart, perpendicular to one ray; a pixel has a width of one pixel in any direction.
    """
    num_rays = out_close.shape[0] - 1
    out_close[0] = out_close[num_rays] = -1
    turn = 0
    for k in range(1, num_rays):
        out_close[k] = -1
        cross = runs[k - 1] * rises[k] - rises[k - 1] * runs[k]
        # Where the order of the rays reverses, later rays may lie outside of the outermost ones.
        if cross * turn < 0 or runs[k - 1] * runs[k] + rises[k - 1] * rises[k] <= 0:
            turn = 0
            continue
        rise = min(rises[k - 1], rises[k])
        if cross != 0:
            one = rises[k] * math.sqrt(runs[k - 1] * runs[k - 1] + rises[k - 1] * rises[k - 1])
            other = rises[k - 1] * math.sqrt(runs[k] * runs[k] + rises[k] * rises[k])
            rise = min(rise, int(CLOSE * min(one, other) / abs(cross)))
            turn = 1 if cross > 0 else -1
        out_close[k] = (rise - first_rise) >> _SHIFT


@kernel
def _mark_ray(
    start_x: int,
    start_row: int,
    upwards: int,
    first_rise: int,
    run: int,
    rise: int,
    close_before: int,
    close_after: int,
    out_open: IntArray,
    out_marked: PixelRows,
) -> int:
    """Mark the pixels along a ray outside of its close neighbours; return the number of spans.

    Parameters
    ----------
    start_x : x of its start.
    start_row, upwards : its first row, and the direction to the next, 1 or -1.
    first_rise : the rise at the far border of that row.
    run, rise : components of the ray along x and y.
    close_before, close_after : the last row in which the ray before and after it are close,
        counted from `start_row`; -1 if in none.
    out_open : int64, shape (num_rows, 2), by row, the span of the first of the close rays; it is
        marked together with the span of the last of them, and all between.
    """
    low_x, high_x = min(start_x, start_x + run), max(start_x, start_x + run)
    first = min(close_before, close_after) + 1
    last = (rise - 1 - first_rise + SUBPIXELS) >> _SHIFT
    # x where it crosses the borders of rows: whole part, and remainder in units of 1 / rise.
    step = run * SUBPIXELS // rise
    step_rest = run * SUBPIXELS - step * rise
    product = run * (first_rise + (first - 1) * SUBPIXELS)
    x = product // rise
    rest = product - x * rise
    x += start_x
    for k in range(first, last + 1):
        next_x = x + step
        next_rest = rest + step_rest
        if next_rest >= rise:
            next_rest -= rise
            next_x += 1
        if run >= 0:
            left, right = x, next_x + (next_rest > 0)
        else:
            left, right = next_x, x + (rest > 0)
        # In the first and the last row it does not reach the border.
        first_col = max(left, low_x) >> _SHIFT
        last_col = max((min(right, high_x) - 1) >> _SHIFT, first_col)
        row = start_row + upwards * k
        if k <= close_after:
            out_open[row, 0] = first_col
            out_open[row, 1] = last_col
        else:
            if k <= close_before:
                first_col = min(first_col, out_open[row, 0])
                last_col = max(last_col, out_open[row, 1])
            add_span(out_marked, row, first_col, last_col)
        x = next_x
        rest = next_rest
    return max(0, last + 1 - first)
