# SPDX-License-Identifier: Apache-2.0
"""Ranges to points (section IV-A): the ends of hits, and of beams that only clear free space."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cartoloop._jit import kernel
from cartoloop.arrays import FloatArray
from cartoloop.kernels.voxel_filter import voxel_filter


class Position(NamedTuple):
    """Coordinates in the tracking frame [m]."""

    x: float
    y: float
    z: float


class RangeLimits(NamedTuple):
    """Which beams are hits, and which clear free space.

    Attributes
    ----------
    min_range, max_range : a return in [min_range, max_range] is a hit [m]; beyond, its beam clears
        free space only.
    no_return_range : ranges from here on are no measurements [m].
    no_return_is_free : whether such a range means that there is no obstacle; otherwise it is
        ignored (+inf itself always counts as free, REP 117).
    free_ray_length : free space cleared by a beam without a hit [m]; 0 clears nothing.
    num_agreeing : number of beams on each side that must agree that this space is free where a
        beam has no return.
    """

    min_range: float
    max_range: float
    no_return_range: float
    no_return_is_free: bool
    free_ray_length: float
    num_agreeing: int


@kernel
def is_clear(
    ranges: FloatArray, beam: int, limits: tuple[float, float, float, bool, float, int]
) -> bool:
    """Return whether the beams on both sides agree that there is nothing near along a beam.

    Dark, shiny and slanting surfaces return nothing either. A beam agrees if it has no return, or
    if its range is at least the length of a free ray; beyond the first and the last beam there is
    nothing that disagrees.

    Parameters
    ----------
    ranges : float64, shape (num_beams,) [m].
    beam : index of the beam.
    limits : fields of `RangeLimits`.
    """
    min_range, max_range, no_return_range, no_return_is_free, free_ray_length, num_agreeing = limits
    first = max(beam - num_agreeing, 0)
    last = min(beam + num_agreeing, ranges.shape[0] - 1)
    for k in range(first, last + 1):
        r = ranges[k]
        if not r >= min(free_ray_length, max_range, no_return_range) or not r >= min_range:
            return False
        if r >= no_return_range and not (no_return_is_free or r == np.inf):
            return False
    return True


@kernel
def project_ranges(
    ranges: FloatArray,
    directions: FloatArray,
    origin: tuple[float, float, float],
    limits: tuple[float, float, float, bool, float, int],
    out_returns: FloatArray,
    out_misses: FloatArray,
) -> tuple[int, int]:
    """Write the ends of a scan's beams into `out_returns` and `out_misses`; return their numbers.

    Parameters
    ----------
    ranges : float64, shape (num_beams,) [m]; may hold NaN, inf and negative values.
    directions : float64, shape (num_beams, 2), unit vectors of the beams, tracking frame.
    origin : fields of the `Position` of the sensor; its height is not used.
    limits : fields of `RangeLimits`: which beams are hits. Plain tuples, because a NamedTuple costs
        a microsecond more in each call from Python.
    out_returns, out_misses : float64, shape (num_beams, 2), end points, tracking frame [m].

    Notes
    -----
    NaN, -inf, negative and too short ranges are ignored: neither hit nor free. A beam without a
    return clears space only if its neighbours agree (`is_clear`).
    """
    min_range, max_range, no_return_range, no_return_is_free, free_ray_length, _ = limits
    origin_x, origin_y, _ = origin
    num_returns = 0
    num_misses = 0
    for k in range(ranges.shape[0]):
        r = ranges[k]
        if not r >= min_range or r <= 0.0:
            continue
        if r <= max_range and r < no_return_range:
            out_returns[num_returns, 0] = origin_x + r * directions[k, 0]
            out_returns[num_returns, 1] = origin_y + r * directions[k, 1]
            num_returns += 1
        elif free_ray_length > 0.0 and (r < no_return_range or no_return_is_free or r == np.inf):
            if r >= no_return_range and not is_clear(ranges, k, limits):
                continue
            length = min(r, free_ray_length)
            out_misses[num_misses, 0] = origin_x + length * directions[k, 0]
            out_misses[num_misses, 1] = origin_y + length * directions[k, 1]
            num_misses += 1
    return num_returns, num_misses


@kernel
def project_and_thin(
    ranges: FloatArray,
    directions: FloatArray,
    origin: tuple[float, float, float],
    limits: tuple[float, float, float, bool, float, int],
    edge: float,
    out_returns: FloatArray,
    out_misses: FloatArray,
) -> tuple[int, int]:
    """Write the ends of a scan's beams as :func:`project_ranges` does, one of each voxel.

    One call from Python, as each costs as much as what it does.

    Parameters
    ----------
    ranges, directions, origin, limits, out_returns, out_misses : see :func:`project_ranges`.
    edge : of the voxels [m].
    """
    num_returns, num_misses = project_ranges(
        ranges, directions, origin, limits, out_returns, out_misses
    )
    return (
        voxel_filter(out_returns, num_returns, edge, out_returns),
        voxel_filter(out_misses, num_misses, edge, out_misses),
    )
