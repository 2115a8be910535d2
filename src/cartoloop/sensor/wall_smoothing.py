# SPDX-License-Identifier: Apache-2.0
"""Averages the noise of dense scans: many beams meet the same few centimetres of a wall.

Thinned for matching, a scan keeps one return of each voxel, with all of its noise, and those on
either side of a wall are kept rather than the many between them; in submaps they thicken it. A line
through the returns beside each other has less noise. Scans whose beams are further apart stay as
they are: too few returns lie within the length of a detail, such as a door frame.
"""

from __future__ import annotations

import math

from cartoloop.arrays import FloatArray
from cartoloop.kernels.wall_smoothing import second_differences, smooth_on_walls
from cartoloop.sensor.median import median

MAX_STEP_RAD = math.radians(0.4)
"""Angle between two beams up to which scans are dense [rad]."""

HALF_LENGTH_M, MAX_HALF, MIN_RETURNS = 0.1, 10, 5
"""Length of wall to either side of a return that is averaged [m], the number of beams to either
side at most, and the number of returns at least."""

SHORTEST_M = 0.1
"""Shorter ranges stay as they are [m]: all beams meet there."""

MIN_NOISE_M, MAX_NOISE_M = 0.007, 0.05
"""With less noise there is nothing to gain, and more is none of walls [m]. A scanner for safety has
2 to 5 mm, a good one for mapping 7 to 10 mm."""

MEDIAN_OF_NORMAL = 0.6745
"""Median of the absolute value of a normal variable with a standard deviation of 1."""

MAX_RESIDUAL = 1.0
"""Returns whose distances from a line are larger than the noise by this factor are not averaged:
there is a corner, or a door frame, which alone shows the distance along a corridor."""


def smoothed(
    ranges: FloatArray, step: float, min_range: float, no_return_range: float
) -> FloatArray:
    """Return the ranges of a scan with less noise on walls, if its beams are dense.

    Parameters
    ----------
    ranges : float64, shape (num_beams,) [m].
    step : angle between two beams [rad].
    min_range, no_return_range : a range in [min_range, no_return_range) is a return [m].
    """
    step = abs(step)
    if not 0.0 < step <= MAX_STEP_RAD:
        return ranges
    min_range = max(min_range, SHORTEST_M)
    noise = range_noise(ranges, min_range, no_return_range)
    if not MIN_NOISE_M <= noise <= MAX_NOISE_M:
        return ranges
    return smooth_on_walls(
        ranges, step, min_range, no_return_range,
        HALF_LENGTH_M, MAX_HALF, MIN_RETURNS, MAX_RESIDUAL * noise,
    )  # fmt: skip


def range_noise(ranges: FloatArray, min_range: float, no_return_range: float) -> float:
    """Return the standard deviation of the ranges of one scan on walls, NaN of none [m].

    It is that of the median second difference of neighbours: the second difference of a straight
    wall is small where beams are dense.

    Parameters
    ----------
    ranges, min_range, no_return_range : as for :func:`smoothed`.
    """
    differences = second_differences(ranges, min_range, no_return_range)
    if not len(differences):
        return math.nan
    return median(differences) / (MEDIAN_OF_NORMAL * math.sqrt(6.0))
