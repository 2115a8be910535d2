# SPDX-License-Identifier: Apache-2.0
"""Matches of many scans to one grid by (CS); those that cannot fit are told from a part of them."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from cartoloop._jit import kernel
from cartoloop.kernels.scan_residuals import match_least_squares, smooth_probability

FloatArray = NDArray[np.float64]


@kernel
def sum_of_squares(
    grid: NDArray[np.float32],
    unknown: float,
    origin_x: float,
    origin_y: float,
    resolution: float,
    points: FloatArray,
    x: float,
    y: float,
    theta: float,
    limit: float,
) -> float:
    """Return the sum of (1 - M_smooth)^2 over the points, or a part of it that is beyond `limit`.

    Parameters
    ----------
    grid, unknown, origin_x, origin_y, resolution, points, x, y, theta : as
        :func:`cartoloop.kernels.scan_residuals.accumulate_match`.
    limit : once the sum is larger, no more points are looked at.
    """
    c = math.cos(theta)
    s = math.sin(theta)
    scale = 1.0 / resolution
    total = 0.0
    for k in range(points.shape[0]):
        hx = c * points[k, 0] - s * points[k, 1]
        hy = s * points[k, 0] + c * points[k, 1]
        value, _, _ = smooth_probability(
            grid, unknown, (x + hx - origin_x) * scale, (y + hy - origin_y) * scale
        )
        error = 1.0 - value
        total += error * error
        if total > limit:
            break
    return total


@kernel
def match_all_least_squares(
    grid: NDArray[np.float32],
    unknown: float,
    origin_x: float,
    origin_y: float,
    resolution: float,
    points: FloatArray,
    first_points: NDArray[np.int64],
    starts: FloatArray,
    prior_information: FloatArray,
    prior_scale: float,
    point_weight: float,
    max_num_iterations: int,
    max_start_residual: float,
    out_matches: FloatArray,
) -> None:
    """Write the matches of many scans to one grid into `out_matches`.

    Parameters
    ----------
    points : float64, shape (n, 2), the points of all scans, one scan after the other [m].
    first_points : int64, shape (k + 1,): scan i has the points from ``first_points[i]`` on.
    starts : float64, shape (k, 3), poses to start from, and that the matches are held to.
    max_start_residual : a scan whose root mean square of 1 - M_smooth is larger where it starts is
        left there, its sum of squares infinite, its curvature 0.
    out_matches : float64, shape (k, 11), each as :func:`match_least_squares` leaves it.

    Notes
    -----
    All other parameters as in :func:`match_least_squares`.
    """
    for i in range(starts.shape[0]):
        scan = points[first_points[i] : first_points[i + 1]]
        limit = max_start_residual**2 * scan.shape[0]
        squares = sum_of_squares(
            grid,
            unknown,
            origin_x,
            origin_y,
            resolution,
            scan,
            starts[i, 0],
            starts[i, 1],
            starts[i, 2],
            limit,
        )
        if squares > limit:
            for k in range(3):
                out_matches[i, k] = starts[i, k]
            out_matches[i, 3:9] = 0.0
            out_matches[i, 9:] = np.inf
            continue
        match_least_squares(
            grid,
            unknown,
            origin_x,
            origin_y,
            resolution,
            scan,
            starts[i],
            starts[i],
            prior_information,
            prior_scale,
            point_weight,
            max_num_iterations,
            out_matches[i],
        )
