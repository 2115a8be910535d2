# SPDX-License-Identifier: Apache-2.0
"""Search windows, eq. (6) to (10): what candidates of a window are, in steps and in metres.

Candidates are counted from the window's first one: columns and rows in cells, rotations in steps of
eq. (7). The candidate (half_cols, half_rows, half_rotations) is the estimate itself.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from cartoloop._jit import kernel
from cartoloop.arrays import FloatArray

ROUNDING = 1e-9
"""An excess over a whole number of steps up to this is a rounding error [steps]."""


class SearchFrame(NamedTuple):
    """Where the candidates of a window are in the submap.

    Attributes
    ----------
    x, y, theta : the estimate, which is the window's centre [m], [m], [rad], submap frame.
    origin_x, origin_y : centre of the submap's cell (0, 0) [m, submap frame].
    resolution : edge of a cell [m].
    step : delta_theta of eq. (7) [rad].
    """

    x: float
    y: float
    theta: float
    origin_x: float
    origin_y: float
    resolution: float
    step: float


class SearchWindow(NamedTuple):
    """How far a window reaches to each side of the estimate: w_x, w_y and w_theta of eq. (8).

    Attributes
    ----------
    half_cols, half_rows : [cells].
    half_rotations : [rotation steps].
    """

    half_cols: int
    half_rows: int
    half_rotations: int


class ScanExtent(NamedTuple):
    """How far the points of a scan are from its origin [m], or [cells] where stated.

    Attributes
    ----------
    mean : mean distance.
    farthest : largest distance, d_max of eq. (6).
    """

    mean: float
    farthest: float


@kernel
def scan_extent(points: FloatArray) -> ScanExtent:
    """Return the mean and the maximum, eq. (6), of the points' distances from the scan's origin.

    Parameters
    ----------
    points : float64, shape (n, 2), tracking frame [m]; n > 0.
    """
    total, largest = 0.0, 0.0
    for k in range(points.shape[0]):
        distance = math.sqrt(points[k, 0] ** 2 + points[k, 1] ** 2)
        total += distance
        largest = max(largest, distance)
    return ScanExtent(total / points.shape[0], largest)


@kernel
def rotation_step(max_range: float, resolution: float, min_range: float) -> float:
    """Return delta_theta of eq. (7) [rad]: points up to a range move by at most a cell.

    Parameters
    ----------
    max_range : d_max of eq. (6) [m].
    resolution : edge of a cell [m].
    min_range : nearer points count as this far away [m]; at least half the resolution, where a
        point on the other side of the origin is a cell away.
    """
    return math.acos(1.0 - 0.5 * (resolution / max(max_range, min_range)) ** 2)
