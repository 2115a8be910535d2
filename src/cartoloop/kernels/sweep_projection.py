# SPDX-License-Identifier: Apache-2.0
"""Beams of a tilted, moving scanner to points of the plane (section IV, "scan projection")."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from cartoloop._jit import kernel

FloatArray = NDArray[np.float64]


@kernel
def place_upright(
    x: float,
    y: float,
    z: float,
    time: float,
    knot_start: float,
    knot_step: float,
    knots: FloatArray,
) -> tuple[float, float, float]:
    """Return a point of the tilted, moving tracking frame in the level one of the reference time.

    Parameters
    ----------
    x, y, z : the point as measured, tracking frame [m].
    time : when it was measured, from the reference time on [s].
    knot_start, knot_step : time of the first knot from the reference time on, and between knots
        [s]; the step is positive.
    knots : float64, shape (num_knots, 5), num_knots > 0: where the robot is at each, seen from
        where it is at the reference time, x, y [m], theta [rad], and its roll and pitch [rad].

    Notes
    -----
    Between the knots the motion is interpolated linearly, before and after them it rests. The
    point is turned by Rz(theta) Ry(pitch) Rx(roll) and shifted by (x, y).
    """
    at = min(max((time - knot_start) / knot_step, 0.0), knots.shape[0] - 1.0)
    before = min(np.int64(np.floor(at)), knots.shape[0] - 1)
    after = min(before + 1, knots.shape[0] - 1)
    part = at - before
    roll = knots[before, 3] + part * (knots[after, 3] - knots[before, 3])
    pitch = knots[before, 4] + part * (knots[after, 4] - knots[before, 4])
    theta = knots[before, 2] + part * (knots[after, 2] - knots[before, 2])
    cos, sin = math.cos(roll), math.sin(roll)
    y, z = cos * y - sin * z, sin * y + cos * z
    cos, sin = math.cos(pitch), math.sin(pitch)
    x, z = cos * x + sin * z, cos * z - sin * x
    cos, sin = math.cos(theta), math.sin(theta)
    x, y = cos * x - sin * y, sin * x + cos * y
    x += knots[before, 0] + part * (knots[after, 0] - knots[before, 0])
    y += knots[before, 1] + part * (knots[after, 1] - knots[before, 1])
    return x, y, z


@kernel
def project_sweep(
    ranges: FloatArray,
    directions: FloatArray,
    origin: FloatArray,
    time_increment: float,
    knot_start: float,
    knot_step: float,
    knots: FloatArray,
    limits: FloatArray,
    no_return_is_free: bool,
    out_returns: FloatArray,
    out_misses: FloatArray,
) -> tuple[int, int]:
    """Write the ends of a sweep's beams into `out_returns` and `out_misses`; return their numbers.

    Parameters
    ----------
    ranges : float64, shape (num_beams,) [m]; may hold NaN, inf and negative values.
    directions : float64, shape (num_beams, 3), unit vectors of the beams, tracking frame.
    origin : float64, shape (3,), where the sensor stands, tracking frame [m].
    time_increment : from beam to beam [s]; the first is measured at the reference time.
    knot_start, knot_step, knots : the motion during the sweep, as `place_upright` takes it.
    limits : float64, shape (6,) [m]: smallest and largest range of a hit, range from which on there
        is no measurement, free space cleared by a beam without a hit, lowest and highest end of a
        beam above the tracking frame.
    no_return_is_free : whether a range without measurement means that the beam met nothing.
    out_returns, out_misses : float64, shape (num_beams, 2), end points, level frame of the robot at
        the reference time [m].

    Notes
    -----
    What ranges mean is as in `cartoloop.kernels.range_projection.project_ranges`. Beams that end
    lower or higher than allowed have met the floor or the ceiling, and say nothing.
    """
    min_range, max_range, no_return_range, free_ray_length = limits[:4]
    num_returns = 0
    num_misses = 0
    for k in range(ranges.shape[0]):
        r = ranges[k]
        if not r >= min_range or r <= 0.0:
            continue
        is_hit = r <= max_range and r < no_return_range
        if not is_hit:
            if not (r < no_return_range or no_return_is_free or r == np.inf):
                continue
            r = min(r, free_ray_length)
            if r <= 0.0:
                continue
        x, y, z = place_upright(
            origin[0] + r * directions[k, 0],
            origin[1] + r * directions[k, 1],
            origin[2] + r * directions[k, 2],
            k * time_increment,
            knot_start,
            knot_step,
            knots,
        )
        if z < limits[4] or z > limits[5]:
            continue
        if is_hit:
            out_returns[num_returns, 0] = x
            out_returns[num_returns, 1] = y
            num_returns += 1
        else:
            out_misses[num_misses, 0] = x
            out_misses[num_misses, 1] = y
            num_misses += 1
    return num_returns, num_misses
