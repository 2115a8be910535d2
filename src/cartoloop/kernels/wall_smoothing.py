# SPDX-License-Identifier: Apache-2.0
"""Ranges on walls, each averaged with those of the beams beside it."""

from __future__ import annotations

import math

import numpy as np

from cartoloop._jit import kernel
from cartoloop.arrays import FloatArray

MAX_SLOPE = 3.0
"""Lines that meet the beam at a smaller angle lead from one thing to another behind it."""

MAX_SHIFT = 2.0
"""Largest distance of a return from the line, as a multiple of the largest residual."""


@kernel
def second_differences(ranges: FloatArray, min_range: float, end_range: float) -> FloatArray:
    """Return the absolute second differences of neighbouring returns, shape (k,) [m].

    Parameters
    ----------
    ranges : float64, shape (n,), in the order of the beams [m].
    min_range, end_range : a range in [min_range, end_range) is a return [m].
    """
    differences = np.empty(len(ranges))
    count = 0
    for k in range(1, len(ranges) - 1):
        before, middle, after = ranges[k - 1], ranges[k], ranges[k + 1]
        if (
            min_range <= before < end_range
            and min_range <= middle < end_range
            and min_range <= after < end_range
        ):
            differences[count] = abs(before + after - 2.0 * middle)
            count += 1
    return differences[:count]


@kernel
def smooth_on_walls(
    ranges: FloatArray,
    step: float,
    min_range: float,
    end_range: float,
    half_length: float,
    max_half: int,
    min_returns: int,
    max_residual: float,
) -> FloatArray:
    """Return the ranges, those on straight pieces of wall where a line through them meets the beam.

    The line is that of least squares through the returns within `half_length` along the wall, as
    it would be perpendicular to the beam, to both sides; of half of that, and again of half, where
    they are not in one line, as in corners.

    Parameters
    ----------
    ranges : float64, shape (n,), in the order of the beams [m].
    step : angle between two beams [rad].
    min_range, end_range : a range in [min_range, end_range) is a return [m]; others stay.
    half_length : [m].
    max_half : beams to either side, at most.
    min_returns : that a line needs.
    max_residual : root mean square of the distances from the line, at most [m].
    """
    smoothed = ranges.copy()
    cosines, sines = np.empty(max_half + 1), np.empty(max_half + 1)
    for k in range(max_half + 1):
        cosines[k], sines[k] = math.cos(k * step), math.sin(k * step)
    for i in range(len(ranges)):
        if not min_range <= ranges[i] < end_range:
            continue
        half = min(int(half_length / (ranges[i] * step)), max_half)
        while 2 * half + 1 >= min_returns:
            found = _on_line(
                ranges, i, half, cosines, sines, min_range, end_range, min_returns, max_residual
            )
            if found > 0.0:
                smoothed[i] = found
                break
            half //= 2
    return smoothed


@kernel
def _on_line(
    ranges: FloatArray,
    i: int,
    half: int,
    cosines: FloatArray,
    sines: FloatArray,
    min_range: float,
    end_range: float,
    min_returns: int,
    max_residual: float,
) -> float:
    """Return where the line through the returns around beam `i` meets it [m], 0 for none."""
    count = 0
    sum_x = sum_y = sum_xx = sum_xy = sum_yy = 0.0
    for k in range(max(i - half, 0), min(i + half + 1, len(ranges))):
        if not min_range <= ranges[k] < end_range:
            continue
        # In the frame of the beam: x along it.
        x = ranges[k] * cosines[abs(k - i)] - ranges[i]
        y = math.copysign(ranges[k] * sines[abs(k - i)], k - i)
        count += 1
        sum_x, sum_y = sum_x + x, sum_y + y
        sum_xx, sum_xy, sum_yy = sum_xx + x * x, sum_xy + x * y, sum_yy + y * y
    if count < min_returns:
        return 0.0
    mean_x, mean_y = sum_x / count, sum_y / count
    var_xx, var_yy = sum_xx / count - mean_x**2, sum_yy / count - mean_y**2
    var_xy = sum_xy / count - mean_x * mean_y
    if var_yy <= 0.0:
        return 0.0
    slope = var_xy / var_yy
    shift = mean_x - slope * mean_y
    squares = max(var_xx - slope * var_xy, 0.0) * count / (count - 2)
    limit = max_residual**2 * (1.0 + slope**2)
    if abs(slope) > MAX_SLOPE or squares > limit or shift**2 > MAX_SHIFT**2 * limit:
        return 0.0
    return float(max(ranges[i] + shift, 0.0))
