# SPDX-License-Identifier: Apache-2.0
"""Least-squares matches, (CS), of many scans to one submap."""

from __future__ import annotations

from cartoloop._jit import kernel
from cartoloop.arrays import FloatArray
from cartoloop.kernels.scan_batch import ScanBatch
from cartoloop.kernels.scan_residuals import MatchOptions, MotionPrior, match_least_squares
from cartoloop.kernels.smooth_map import SmoothMap


@kernel
def match_all_least_squares(
    smooth_map: SmoothMap,
    unknown: float,
    scans: ScanBatch,
    starts: FloatArray,
    prior_information: FloatArray,
    prior_scale: float,
    options: MatchOptions,
    max_start_residual: float,
    out_matches: FloatArray,
) -> None:
    """Write the matches of k scans to one submap into `out_matches`.

    Parameters
    ----------
    smooth_map, unknown, options : as in :func:`match_least_squares`.
    scans : k of them, none without points.
    starts : float64, shape (k, 3), tf_submap_scan to start from, which is also the motion prior.
    prior_information, prior_scale : of the motion prior, see :class:`MotionPrior`.
    max_start_residual : a scan whose root mean square of 1 - M_smooth is larger at its start is
        left there, its sum of squares infinite, its curvature 0.
    out_matches : float64, shape (k, 11), each as :func:`match_least_squares` writes it.
    """
    for i in range(starts.shape[0]):
        points = scans.points[scans.firsts[i] : scans.ends[i]]
        match_least_squares(
            smooth_map,
            unknown,
            points,
            starts[i],
            MotionPrior(starts[i], prior_information, prior_scale),
            options,
            max_start_residual**2 * points.shape[0],
            out_matches[i],
        )
