# SPDX-License-Identifier: Apache-2.0
"""Walls at a slant, which return nothing: they are no free space.

A wall along which the robot drives is seen up to some angle only, if it is dark or shiny. The beams
beyond have no return, though the wall continues: as free space they would clear it, until the robot
is near enough to see it.
"""

from __future__ import annotations

import math

import numpy as np

from cartoloop.arrays import FloatArray
from cartoloop.kernels.slanting_walls import hide_beyond_slanting_walls

BASE_RAD = math.radians(3.0)
"""Angle over which the direction of a wall is measured [rad]: on less of it, noise is too large."""

MIN_SLANT = 1.0
"""Tangent of the angle to a wall's normal from which it slants: 45 degrees. Surfaces seen more
straight on return something, and what is beside them is an opening."""

MAX_BEND = 0.1
"""Share of the range by which three returns of a straight wall may be off a line."""


def without_hidden(
    ranges: FloatArray,
    step: float,
    min_range: float,
    no_return_range: float,
    free_ray_length: float,
) -> FloatArray:
    """Return the ranges of a scan, NaN where a slanting wall may have returned nothing.

    Parameters
    ----------
    ranges : float64, shape (num_beams,) [m].
    step : angle between two beams [rad].
    min_range, no_return_range : a range in [min_range, no_return_range) is a return [m].
    free_ray_length : a beam without a return clears no space beyond [m].
    """
    step = abs(step)
    if not 0.0 < step < BASE_RAD or free_ray_length == 0.0:
        return ranges
    hidden = np.empty(len(ranges))
    num_beams = max(math.ceil(BASE_RAD / step), 2)
    num_hidden = hide_beyond_slanting_walls(
        ranges, step, min_range, no_return_range, free_ray_length, num_beams, MIN_SLANT, MAX_BEND,
        hidden,
    )  # fmt: skip
    return hidden if num_hidden else ranges
