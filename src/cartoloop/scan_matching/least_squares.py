# SPDX-License-Identifier: Apache-2.0
"""Least-squares matching of a scan to a grid, (CS) in section IV-C of the paper."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cartoloop.kernels.match_batch import match_all_least_squares
from cartoloop.kernels.scan_residuals import match_least_squares
from cartoloop.sensor.pose import FloatArray, Pose, wrap_angle
from cartoloop.sensor.scan_points import ScanPoints
from cartoloop.submaps.finished_grid import MIN_PROBABILITY

TRUSTED = 1e3
"""Scale of a pull that does not wane."""


class SmoothMap(NamedTuple):
    """What M_smooth interpolates: probabilities, 0: never observed; centre of cell (0, 0), edge."""

    cells: NDArray[np.float32]
    origin_x: float
    origin_y: float
    resolution: float


class LeastSquaresMatch(NamedTuple):
    """Where the scan fits best.

    Attributes
    ----------
    tf_submap_scan : the pose found.
    information : float64, shape (3, 3): J^T J of the points' residuals at it, per unit of variance
        of a residual, in the grid's axes: [1/m^2, 1/(m rad), 1/rad^2].
    residual : root mean square of 1 - M_smooth at the points.
    cost : what was minimised, with the pull towards the prediction.
    iterations : evaluations of the residuals.
    """

    tf_submap_scan: Pose
    information: FloatArray
    residual: float
    cost: float
    iterations: int


def match(
    smooth_map: SmoothMap,
    points: FloatArray,
    start: Pose,
    prior: Pose,
    prior_information: FloatArray,
    point_weight: float,
    max_num_iterations: int,
    prior_scale: float = TRUSTED,
) -> LeastSquaresMatch:
    """Return the minimum of ``point_weight * sum (1 - M)^2`` plus the pull towards `prior`.

    Parameters
    ----------
    points : float64, shape (n, 2), scan frame [m]; n > 0.
    start, prior : tf_submap_scan to start from, and as predicted.
    prior_information : float64, shape (6,), upper triangle of the prediction's information matrix
        (xx, xy, xt, yy, yt, tt), in the grid's axes.
    prior_scale : from so many standard deviations on the pull towards the prediction wanes.
    """
    near_start = prior.theta + wrap_angle(start.theta - prior.theta)
    found = np.empty(11)
    iterations = match_least_squares(
        smooth_map.cells,
        MIN_PROBABILITY,
        smooth_map.origin_x,
        smooth_map.origin_y,
        smooth_map.resolution,
        points,
        np.array((start.x, start.y, near_start)),
        np.array(prior),
        prior_information,
        prior_scale,
        point_weight,
        max_num_iterations,
        math.inf,
        found,
    )
    x, y, theta, xx, xy, xt, yy, yt, tt, squares, cost = found.tolist()
    information = np.array(((xx, xy, xt), (xy, yy, yt), (xt, yt, tt)))
    return LeastSquaresMatch(
        Pose(x, y, wrap_angle(theta)),
        information,
        math.sqrt(squares / len(points)),
        cost,
        iterations,
    )


class LeastSquaresMatches(NamedTuple):
    """Where many scans fit best in one grid.

    Attributes
    ----------
    tf_submap_scan : float64, shape (n, 3), angles not wrapped.
    information : float64, shape (n, 3, 3), as in :class:`LeastSquaresMatch`.
    residual : float64, shape (n,), root mean square of 1 - M_smooth at the points.
    """

    tf_submap_scan: FloatArray
    information: FloatArray
    residual: FloatArray


_UPPER_TRIANGLE = np.array(((3, 4, 5), (4, 6, 7), (5, 7, 8)))


def match_all(
    smooth_map: SmoothMap,
    scans: ScanPoints,
    starts: FloatArray,
    prior_information: FloatArray,
    point_weight: float,
    max_num_iterations: int,
    max_start_residual: float,
) -> LeastSquaresMatches:
    """Return the matches of many scans to one grid, each held to where it starts.

    Parameters
    ----------
    scans : n of them, none without points.
    starts : float64, shape (n, 3), tf_submap_scan of each.
    prior_information : float64, shape (6,), of the pull towards the start.
    max_start_residual : scans that fit worse than this where they start are not matched; their
        residual is infinite.
    """
    found = np.empty((len(scans), 11))
    match_all_least_squares(
        smooth_map.cells,
        MIN_PROBABILITY,
        smooth_map.origin_x,
        smooth_map.origin_y,
        smooth_map.resolution,
        scans.points,
        scans.firsts,
        scans.ends,
        starts,
        prior_information,
        TRUSTED,
        point_weight,
        max_num_iterations,
        max_start_residual,
        found,
    )
    return LeastSquaresMatches(
        found[:, :3], found[:, _UPPER_TRIANGLE], np.sqrt(found[:, 9] / scans.counts)
    )
