# SPDX-License-Identifier: Apache-2.0
"""The offset between the clocks of another sensor and of the scans, from when both turn."""

from __future__ import annotations

import numpy as np

from cartoloop.arrays import BoolArray, FloatArray

OFFSETS_S: FloatArray = np.arange(-20.0, 61.0) * 0.02
"""Clock offsets tried [s], in steps of a tenth of the usual time between scans; positive: the
reading is newer than the scan of the same stamp. Radish logs have 0.14 to 0.64 s."""

MIN_TURN_RAD = 0.02
"""Steps that turn by less do not contribute to the offset [rad]: the noise of a match."""

FIRST_ESTIMATE = 50
"""Number of scans before the first estimate of a calibration: some ten seconds."""


def next_estimate(num_scans: int) -> int:
    """Return after how many scans a calibration is estimated again: later as it settles."""
    return num_scans + max(FIRST_ESTIMATE, min(num_scans // 4, 10 * FIRST_ESTIMATE))


def clock_offset(
    times: FloatArray,
    turns: FloatArray,
    turning: BoolArray,
    reading_times: FloatArray,
    heading: FloatArray,
    max_unexplained: float = 0.9,
) -> float | None:
    """Return the offset [s] at which a sensor turns when the scans do; None without agreement.

    Parameters
    ----------
    times : of the scans, shape (n,).
    turns, turning : rotation of each step between them [rad], and whether it is used.
    reading_times, heading : of the sensor, shape (k,), heading unwrapped [rad].
    max_unexplained : largest share of the turns that may differ at the best offset.
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
    """Return the minimum of a parabola through the lowest cost and its neighbours."""
    if not 0 < best < len(grid) - 1:
        return float(grid[best])
    left, middle, right = costs[best - 1 : best + 2]
    curvature = left - 2.0 * middle + right
    shift = 0.5 * (left - right) / curvature if curvature > 0.0 else 0.0
    return float(grid[best] + shift * (grid[1] - grid[0]))
