# SPDX-License-Identifier: Apache-2.0
"""Least-squares matching of a scan to a grid, (CS) in section IV-C, and its covariance."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from cartoloop.arrays import FloatArray
from cartoloop.kernels.match_batch import match_all_least_squares
from cartoloop.kernels.match_covariance import inverse_covariances
from cartoloop.kernels.scan_batch import ScanBatch
from cartoloop.kernels.scan_residuals import MatchOptions, match_scan
from cartoloop.kernels.smooth_map import SmoothMap
from cartoloop.sensor.pose import Pose, wrap_angle
from cartoloop.sensor.scan_points import ScanPoints
from cartoloop.submaps.finished_grid import MIN_PROBABILITY

__all__ = [
    "LeastSquaresMatch",
    "LeastSquaresMatches",
    "MatchOptions",
    "SmoothMap",
    "match",
    "match_all",
    "match_information",
    "match_informations",
]

TRUSTED = 1e3
"""Scale of the loss on a motion prior that is trusted in full [standard deviations]: no match is
that far from its prior, and for nearer ones the loss is the square."""


class LeastSquaresMatch(NamedTuple):
    """Where the scan fits best.

    Attributes
    ----------
    tf_submap_scan : pose of the tracking frame.
    information : float64, shape (3, 3): J^T J of the points' residuals at it, per unit of variance
        of a residual, in the submap's axes: [1/m^2, 1/(m rad), 1/rad^2].
    residual : root mean square of 1 - M_smooth at the points.
    cost : what was minimised, including the motion prior.
    iterations : number of evaluations of the residuals.
    """

    tf_submap_scan: Pose
    information: FloatArray
    residual: float
    cost: float
    iterations: int


_SYMMETRIC = np.array(((3, 4, 5), (4, 6, 7), (5, 7, 8)))
"""Where :func:`match_scan` writes the upper triangle of an information matrix."""


def match(
    smooth_map: SmoothMap,
    points: FloatArray,
    start: Pose,
    prior: Pose,
    prior_information: FloatArray,
    options: MatchOptions,
    prior_scale: float = TRUSTED,
) -> LeastSquaresMatch:
    """Return the minimum of ``point_weight * sum (1 - M)^2`` plus the cost of the motion prior.

    Parameters
    ----------
    points : float64, shape (n, 2), tracking frame [m]; n > 0.
    start, prior : tf_submap_scan to start from, and as predicted.
    prior_information : float64, shape (6,), upper triangle of the prediction's information matrix
        (xx, xy, xt, yy, yt, tt), in the submap's axes.
    options : weights and limits.
    prior_scale : scale of Cauchy's loss on the motion prior [standard deviations].
    """
    near_start = prior.theta + wrap_angle(start.theta - prior.theta)
    found = np.empty(11)
    iterations = match_scan(
        smooth_map[:],
        MIN_PROBABILITY,
        np.ascontiguousarray(points),  # the only memory layout that the kernel takes
        (start.x, start.y, near_start),
        (prior[:], prior_information, prior_scale),
        options[:],
        found,
    )
    x, y, theta, *_, squares, cost = found.tolist()
    return LeastSquaresMatch(
        Pose(x, y, wrap_angle(theta)),
        found.take(_SYMMETRIC),
        math.sqrt(squares / len(points)),
        cost,
        iterations,
    )


class LeastSquaresMatches(NamedTuple):
    """Where n scans fit best in one submap.

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
    options: MatchOptions,
    max_start_residual: float,
) -> LeastSquaresMatches:
    """Return the matches of n scans to one submap, each with its start as motion prior.

    Parameters
    ----------
    scans : n of them, none without points.
    starts : float64, shape (n, 3), tf_submap_scan of each.
    prior_information : float64, shape (6,), upper triangle of the motion prior's information.
    options : weights and limits.
    max_start_residual : scans with a larger residual at their start are not matched; their residual
        becomes infinite.
    """
    found = np.empty((len(scans), 11))
    match_all_least_squares(
        smooth_map,
        MIN_PROBABILITY,
        ScanBatch(scans.points, scans.firsts, scans.ends),
        starts,
        prior_information,
        TRUSTED,
        options,
        max_start_residual,
        found,
    )
    return LeastSquaresMatches(
        found[:, :3], found[:, _UPPER_TRIANGLE], np.sqrt(found[:, 9] / scans.counts)
    )


MIN_SIGMA_M = 0.01
"""Smallest standard deviation of a match's position [m]: walls are not straighter than this."""

MIN_SIGMA_RAD = math.radians(0.1)
"""Smallest standard deviation of a match's angle [rad]: scanners are not more accurate."""

MIN_RESIDUAL = 0.03
"""Smallest root mean square of 1 - M that is not by chance [probability]: cell values are clamped
to 0.9, so that a residual below 0.1 is due to interpolation."""

OPEN_INFORMATION = 1e-2
"""Information along a degenerate direction [1/m^2], [1/rad^2]: a standard deviation of 10 m or
10 rad, which keeps the matrix invertible."""

_MIN_INFORMATIONS = np.full(3, OPEN_INFORMATION)
_MIN_VARIANCES = np.array((MIN_SIGMA_M, MIN_SIGMA_M, MIN_SIGMA_RAD)) ** 2


def match_information(match: LeastSquaresMatch) -> FloatArray:
    """Return the inverse covariance of a match, shape (3, 3), in the submap's axes."""
    information: FloatArray = match_informations(
        match.information[np.newaxis], np.array((match.residual,))
    )[0]
    return information


def match_informations(curvatures: FloatArray, residuals: FloatArray) -> FloatArray:
    """Return the inverse covariances of matches, shape (n, 3, 3), in the submap's axes.

    Along a corridor, a degenerate direction, the curvature of (CS) and so the information is small.
    The variances of `MIN_SIGMA_M` and `MIN_SIGMA_RAD` are added to the covariance.

    Parameters
    ----------
    curvatures : J^T J of the points' residuals, shape (n, 3, 3).
    residuals : root mean square of the points' residuals, shape (n,).
    """
    informations = np.empty(curvatures.shape)
    inverse_covariances(
        np.ascontiguousarray(curvatures),  # one memory layout, so that only one is compiled
        residuals,
        MIN_RESIDUAL,
        _MIN_INFORMATIONS,
        _MIN_VARIANCES,
        informations,
    )
    return informations
