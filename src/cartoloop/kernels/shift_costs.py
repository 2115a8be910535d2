# SPDX-License-Identifier: Apache-2.0
"""How well scans fit a submap after each of some shifts along a direction, as of a corridor."""

from __future__ import annotations

import math

import numpy as np

from cartoloop._jit import kernel
from cartoloop.arrays import FloatArray, IntArray
from cartoloop.kernels.scan_batch import ScanBatch
from cartoloop.kernels.smooth_map import SmoothMap, smooth_value
from cartoloop.kernels.wall_directions import wall_directions


@kernel
def add_shift_costs(
    smooth_map: SmoothMap,
    unknown: float,
    scans: ScanBatch,
    poses: FloatArray,
    groups: IntArray,
    directions: FloatArray,
    shifts: FloatArray,
    max_parallel: float,
    out_costs: FloatArray,
    out_counts: IntArray,
) -> None:
    """Add the squares of (CS) of groups of scans after each shift to `out_costs`.

    Points on straight walls along the direction fit wherever the wall is. They are left out: where
    their squares change, the wall was observed more or less often, or ends.

    Parameters
    ----------
    smooth_map, unknown : as in :func:`match_least_squares`.
    scans : k of them.
    poses : float64, shape (k, 3), tf_submap_scan.
    groups : int64, shape (k,), the group of each scan.
    directions : float64, shape (g, 2), of the shifts of each group, unit vectors, submap axes.
    shifts : float64, shape (m,) [m].
    max_parallel : points are left out where the cosine of twice the angle between their wall and
        the direction is larger; not negative.
    out_costs : float64, shape (g, m); added to.
    out_counts : int64, shape (g,), number of points; added to.

    Notes
    -----
    O(points shifts).
    """
    for i in range(poses.shape[0]):
        points = scans.points[scans.firsts[i] : scans.ends[i]]
        walls = np.empty((2, points.shape[0]))
        wall_directions(points, walls)
        x, y, theta = poses[i, 0], poses[i, 1], poses[i, 2]
        group = groups[i]
        along_x, along_y = directions[group, 0], directions[group, 1]
        cos, sin = math.cos(theta), math.sin(theta)
        # Of twice the angle of the direction, in the scan's axes.
        ahead, aside = cos * along_x + sin * along_y, cos * along_y - sin * along_x
        double_cos, double_sin = ahead * ahead - aside * aside, 2.0 * ahead * aside
        for k in range(points.shape[0]):
            if walls[0, k] * double_cos + walls[1, k] * double_sin > max_parallel:
                continue
            out_counts[group] += 1
            point_x = x + cos * points[k, 0] - sin * points[k, 1]
            point_y = y + sin * points[k, 0] + cos * points[k, 1]
            for j in range(shifts.shape[0]):
                value = smooth_value(
                    smooth_map,
                    unknown,
                    point_x + shifts[j] * along_x,
                    point_y + shifts[j] * along_y,
                )
                out_costs[group, j] += (1.0 - value) ** 2
