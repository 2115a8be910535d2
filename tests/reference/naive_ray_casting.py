# SPDX-License-Identifier: Apache-2.0
"""The slow, obvious twin of kernels/ray_casting.py, in exact fractions.

A pixel is [c, c + 1) x [r, r + 1): its left and lower border belong to it. A ray intersects the
pixels along which it has length and those in which it starts and ends. A pixel that it touches
with nothing but its corner, on the way, is not intersected.
"""

from __future__ import annotations

import math
from fractions import Fraction


def _inside(start, step, low):
    """The parameters in [0, 1] at which ``start + t step`` lies in [low, low + 1], or None."""
    if step == 0:
        return (Fraction(0), Fraction(1)) if low <= start <= low + 1 else None
    enters, leaves = sorted(((low - start) / step, (low + 1 - start) / step))
    return max(enters, Fraction(0)), min(leaves, Fraction(1))


def intersects(start, end, col, row):
    """Whether the ray between two points, in pixels, as fractions, intersects a pixel."""
    step = (end[0] - start[0], end[1] - start[1])
    if (col, row) in [(math.floor(x), math.floor(y)) for x, y in (start, end)]:
        return True
    along_x, along_y = _inside(start[0], step[0], col), _inside(start[1], step[1], row)
    if along_x is None or along_y is None:
        return False
    enters, leaves = max(along_x[0], along_y[0]), min(along_x[1], along_y[1])
    if enters >= leaves:
        return False
    middle = (enters + leaves) / 2
    x, y = start[0] + middle * step[0], start[1] + middle * step[1]
    return (math.floor(x), math.floor(y)) == (col, row)


def naive_ray(start, end):
    """Return the set of pixels (col, row) that a ray between two points, in pixels, intersects."""
    start = tuple(map(Fraction, start))
    end = tuple(map(Fraction, end))
    cols = range(math.floor(min(start[0], end[0])), math.floor(max(start[0], end[0])) + 1)
    rows = range(math.floor(min(start[1], end[1])), math.floor(max(start[1], end[1])) + 1)
    return {(col, row) for col in cols for row in rows if intersects(start, end, col, row)}


def certain_end(origin, point, length, share):
    """Return up to where a ray to a return is free for certain."""
    squared_ray = (point[0] - origin[0]) ** 2 + (point[1] - origin[1]) ** 2
    uncertain = length**2 + share**2 * squared_ray
    share = math.sqrt(uncertain / squared_ray) if uncertain < squared_ray else 1.0
    return tuple(x - share * (x - start) for x, start in zip(point, origin, strict=True))


def naive_scan_cells(
    origin, returns, misses, resolution, first_col, first_row, subpixels, uncertain=(0.0, 0.0)
):
    """Return the sets of hits and misses, as lattice cells (col, row)."""

    def pixel(point):
        """The point in pixels from the corner of the first cell, rounded to subpixels."""
        return tuple(
            Fraction(math.floor((coordinate / resolution + 0.5 - first) * subpixels), subpixels)
            for coordinate, first in zip(point, (first_col, first_row), strict=True)
        )

    hits = {tuple(math.floor(x / resolution + 0.5) for x in point) for point in returns}
    crossed = set()
    for end in [*(certain_end(origin, point, *uncertain) for point in returns), *misses]:
        ray = naive_ray(pixel(origin), pixel(end))
        crossed |= {(col + first_col, row + first_row) for col, row in ray}
    return hits, crossed - hits


def naive_update(probability, observed_probability, low, high):
    """Return a cell's probability after an observation, eq. (2) and (3); 0 is never observed."""

    def odds(p):
        return p / (1 - p)

    updated = observed_probability
    if probability > 0:
        product = odds(float(probability)) * odds(observed_probability)
        updated = product / (1 + product)
    return min(max(updated, low), high)
