# SPDX-License-Identifier: Apache-2.0
"""How far the clock of another sensor is off that of the scans, from when both turn."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cartoloop.sensor.pose import FloatArray

OFFSETS_S: FloatArray = np.arange(-20.0, 61.0) * 0.02
"""Clock offsets tried [s]; positive: the reading is newer than the scan of the same stamp."""

MIN_TURN_RAD = 0.02
"""Steps that turn by less tell nothing of the offset."""


def clock_offset(
    times: FloatArray,
    turns: FloatArray,
    turning: NDArray[np.bool_],
    reading_times: FloatArray,
    heading: FloatArray,
    max_unexplained: float = 0.9,
) -> float | None:
    """Return the offset [s] at which a sensor turns when the scans do; None if at none it does.

    Parameters
    ----------
    times : of the scans, shape (n,).
    turns, turning : rotation of each step between them [rad], and whether it is one to go by.
    reading_times, heading : of the sensor, shape (k,), heading unwrapped [rad].
    max_unexplained : share of the turns that the sensor may miss or add, at the best offset.
    """
    costs = np.array(
        [
            np.abs(turns - np.diff(np.interp(times - offset, reading_times, heading)))[
                turning
            ].mean()
            for offset in OFFSETS_S
        ]
    )
    best = int(np.argmin(costs))
    if costs[best] > max_unexplained * np.abs(turns[turning]).mean():
        return None
    return _refined_minimum(OFFSETS_S, costs, best)


def _refined_minimum(grid: FloatArray, costs: FloatArray, best: int) -> float:
    """Return where a parabola through the lowest cost and its neighbours is lowest."""
    if not 0 < best < len(grid) - 1:
        return float(grid[best])
    left, middle, right = costs[best - 1 : best + 2]
    curvature = left - 2.0 * middle + right
    shift = 0.5 * (left - right) / curvature if curvature > 0.0 else 0.0
    return float(grid[best] + shift * (grid[1] - grid[0]))
