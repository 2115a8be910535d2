# SPDX-License-Identifier: Apache-2.0
"""Deskewing: beams of a tilted, moving scanner to points of the plane (section IV)."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from cartoloop._jit import kernel
from cartoloop.arrays import FloatArray
from cartoloop.kernels.range_projection import Position, RangeLimits, is_clear


class SweepMotion(NamedTuple):
    """The motion of the robot during a sweep, sampled at equal time steps.

    Attributes
    ----------
    start : time of the first knot, relative to the time of the scan [s].
    step : time between knots [s], positive.
    knots : float64, shape (k, 5), k > 0: pose of the robot at each knot, relative to its pose at
        the time of the scan, x, y [m], theta [rad]; and its roll and pitch [rad].
    """

    start: float
    step: float
    knots: FloatArray


class Heights(NamedTuple):
    """Heights of the ends of beams that are used, level frame of the robot [m]."""

    min_z: float
    max_z: float


@kernel
def place_upright(
    x: float, y: float, z: float, time: float, motion: SweepMotion
) -> tuple[float, float, float]:
    """Return a point of the tilted, moving tracking frame in the level frame of the scan's time.

    Parameters
    ----------
    x, y, z : the point as measured, tracking frame [m].
    time : when it was measured, relative to the time of the scan [s].
    motion : of the robot during the sweep.

    Notes
    -----
    The motion is interpolated linearly between knots, and constant before and after them. The
    point is rotated by Rz(theta) Ry(pitch) Rx(roll) and translated by (x, y).
    """
    knots = motion.knots
    at = min(max((time - motion.start) / motion.step, 0.0), knots.shape[0] - 1.0)
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
    origin: Position,
    time_increment: float,
    motion: SweepMotion,
    limits: RangeLimits,
    heights: Heights,
    out_returns: FloatArray,
    out_misses: FloatArray,
) -> tuple[int, int]:
    """Write the ends of a sweep's beams into `out_returns` and `out_misses`; return their numbers.

    Parameters
    ----------
    ranges : float64, shape (num_beams,) [m]; may hold NaN, inf and negative values.
    directions : float64, shape (num_beams, 3), unit vectors of the beams, tracking frame.
    origin : position of the sensor.
    time_increment : time between beams [s]; the first is measured at the time of the scan.
    motion : of the robot during the sweep.
    limits, heights : which beams are hits.
    out_returns, out_misses : float64, shape (num_beams, 2), end points, level frame of the robot at
        the time of the scan [m].

    Notes
    -----
    Ranges are interpreted as by `cartoloop.kernels.range_projection.project_ranges`. Beams that end
    below `min_z` or above `max_z` have hit the floor or the ceiling, and are ignored.
    """
    num_returns = 0
    num_misses = 0
    for k in range(ranges.shape[0]):
        r = ranges[k]
        if not r >= limits.min_range or r <= 0.0:
            continue
        is_hit = r <= limits.max_range and r < limits.no_return_range
        if not is_hit:
            if not (r < limits.no_return_range or limits.no_return_is_free or r == np.inf):
                continue
            if r >= limits.no_return_range and not is_clear(ranges, k, limits):
                continue
            r = min(r, limits.free_ray_length)
            if r <= 0.0:
                continue
        x, y, z = place_upright(
            origin.x + r * directions[k, 0],
            origin.y + r * directions[k, 1],
            origin.z + r * directions[k, 2],
            k * time_increment,
            motion,
        )
        if z < heights.min_z or z > heights.max_z:
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
