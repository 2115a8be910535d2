# SPDX-License-Identifier: Apache-2.0
"""Ranges of single rays among straight walls, for simulated scanners that move during a sweep."""

from __future__ import annotations

import numpy as np

from cartoloop._jit import kernel
from cartoloop.arrays import FloatArray
from cartoloop.kernels.wall_ranges import CORNER_TOLERANCE


@kernel
def ray_ranges(
    walls: FloatArray, rays: FloatArray, range_max: float, out_ranges: FloatArray
) -> None:
    """Write the distance along each ray to the nearest wall into `out_ranges`.

    Parameters
    ----------
    walls : float64, shape (num_walls, 4), segments x1, y1, x2, y2 [m], world frame.
    rays : float64, shape (n, 4): start x, y [m] and direction x, y, a unit vector, world frame.
    range_max : walls beyond are not measured [m].
    out_ranges : float64, shape (n,) [m]; inf where a ray meets no wall.

    Notes
    -----
    O(n num_walls). A ray exactly along a wall does not hit it.
    """
    for k in range(rays.shape[0]):
        x, y, dx, dy = rays[k, 0], rays[k, 1], rays[k, 2], rays[k, 3]
        nearest = np.inf
        for wall in range(walls.shape[0]):
            ax, ay = walls[wall, 0] - x, walls[wall, 1] - y
            sx, sy = walls[wall, 2] - walls[wall, 0], walls[wall, 3] - walls[wall, 1]
            across = dx * sy - dy * sx
            if across == 0.0:
                continue
            distance = (ax * sy - ay * sx) / across
            if distance < 0.0 or distance >= nearest:
                continue
            along = (ax * dy - ay * dx) / across
            if -CORNER_TOLERANCE <= along <= 1.0 + CORNER_TOLERANCE:
                nearest = distance
        out_ranges[k] = nearest if nearest <= range_max else np.inf
