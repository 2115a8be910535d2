# SPDX-License-Identifier: Apache-2.0
"""Matches of many scans to one grid by (CS)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cartoloop._jit import kernel
from cartoloop.kernels.scan_residuals import match_least_squares

FloatArray = NDArray[np.float64]


@kernel
def match_all_least_squares(
    grid: NDArray[np.float32],
    unknown: float,
    origin_x: float,
    origin_y: float,
    resolution: float,
    points: FloatArray,
    firsts: NDArray[np.int64],
    ends: NDArray[np.int64],
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
    points : float64, shape (n, 2), the points of all scans [m].
    firsts, ends : int64, shape (k,): scan i has ``points[firsts[i] : ends[i]]``.
    starts : float64, shape (k, 3), poses to start from, and that the matches are held to.
    max_start_residual : a scan whose root mean square of 1 - M_smooth is larger where it starts is
        left there, its sum of squares infinite, its curvature 0.
    out_matches : float64, shape (k, 11), each as :func:`match_least_squares` leaves it.

    Notes
    -----
    All other parameters as in :func:`match_least_squares`.
    """
    for i in range(starts.shape[0]):
        scan = points[firsts[i] : ends[i]]
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
            max_start_residual**2 * scan.shape[0],
            out_matches[i],
        )
