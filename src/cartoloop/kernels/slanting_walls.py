# SPDX-License-Identifier: Apache-2.0
"""Beams without a return that would meet the continuation of a wall seen at a slant."""

from __future__ import annotations

import math

import numpy as np

from cartoloop._jit import kernel
from cartoloop.arrays import FloatArray


@kernel
def is_missing(measured: float, no_return_range: float) -> bool:
    """Return whether a range means that there was no return; NaN does not."""
    return measured >= no_return_range or measured == np.inf


@kernel
def slant_of_wall(
    ranges: FloatArray,
    last: int,
    towards: int,
    num_beams: int,
    step: float,
    min_range: float,
    no_return_range: float,
    max_bend: float,
) -> float:
    """Return the tangent of the angle at which the last beam of a wall meets it, NaN of no wall.

    It is positive if the wall leads away from the sensor.

    Parameters
    ----------
    ranges : float64, shape (n,) [m].
    last : beam with a return, beside the first one without.
    towards : 1 or -1, from the one to the other.
    num_beams : length of wall, in steps from beam to beam; more than 1. It is up to twice as long
        where beams on it have no return.
    step : angle between two beams [rad], positive.
    min_range, no_return_range : a range in [min_range, no_return_range) is a return [m].
    max_bend : share of its range by which a return between may be off a straight wall.

    Notes
    -----
    On a straight wall the reciprocal u of the range is a sinusoid of the angle: at an angle d from
    the last beam u(d) = u(0) (cos d - slant sin d).
    """
    first = last - towards * num_beams
    for _ in range(num_beams):
        if not 0 <= first < ranges.shape[0] or not is_missing(ranges[first], no_return_range):
            break
        first -= towards
    if not 0 <= first < ranges.shape[0] or is_missing(ranges[first], no_return_range):
        return np.nan
    angle = abs(last - first) * step
    slant = float(ranges[last] / ranges[first] - math.cos(angle)) / math.sin(angle)
    for beam in range(first, last + towards, towards):
        if is_missing(ranges[beam], no_return_range):
            continue
        angle = abs(last - beam) * step
        expected = math.cos(angle) + slant * math.sin(angle)
        # NaN is no return of the wall
        off = abs(ranges[last] / ranges[beam] - expected)
        if not (ranges[beam] >= min_range and off <= max_bend * expected):
            return np.nan
    return slant


@kernel
def hide_beyond_slanting_walls(
    ranges: FloatArray,
    step: float,
    min_range: float,
    no_return_range: float,
    length: float,
    num_beams: int,
    min_slant: float,
    max_bend: float,
    out: FloatArray,
) -> int:
    """Write the ranges into `out`, NaN for what slanting walls may hide; return how many are.

    That are beams without a return that would meet a wall, seen at a slant beside them, if it
    continued.

    Parameters
    ----------
    ranges, step, min_range, no_return_range, num_beams, max_bend : see :func:`slant_of_wall`.
    length : walls that would be met farther away do not count [m].
    min_slant : tangent of the angle to the normal of a wall from which it slants; positive.
    out : float64, shape (n,).
    """
    size = ranges.shape[0]
    out[:] = ranges
    num_hidden = 0
    for towards in (1, -1):
        beam = 1 if towards > 0 else size - 2
        while 0 <= beam < size:
            last = beam - towards
            if not is_missing(ranges[beam], no_return_range) or is_missing(
                ranges[last], no_return_range
            ):
                beam += towards
                continue
            slant = slant_of_wall(
                ranges, last, towards, num_beams, step, min_range, no_return_range, max_bend
            )
            angle = step
            while slant >= min_slant and 0 <= beam < size:
                nearness = (math.cos(angle) - slant * math.sin(angle)) / ranges[last]
                if not is_missing(ranges[beam], no_return_range) or nearness * length <= 1.0:
                    break
                if not np.isnan(out[beam]):
                    num_hidden += 1
                out[beam] = np.nan
                angle += step
                beam += towards
            beam += towards
    return num_hidden
