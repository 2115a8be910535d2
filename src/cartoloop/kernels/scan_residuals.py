# SPDX-License-Identifier: Apache-2.0
"""The least-squares scan matcher (CS), section IV-C: residuals, damped Gauss-Newton."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from cartoloop._jit import borrowing_kernel, kernel
from cartoloop.arrays import FloatArray
from cartoloop.kernels.smooth_map import (
    ARM_X,
    ARM_Y,
    D_COL,
    D_ROW,
    ERROR,
    J_THETA,
    J_X,
    J_Y,
    VALUE,
    PointScratch,
    SmoothMap,
    SmoothMapFields,
    point_scratch,
    sample_smooth_map,
    smooth_value,
)
from cartoloop.kernels.wall_directions import wall_directions

MIN_DAMPING = 0.7
"""Smallest and first damping, as a share of the diagonal of J^T J. On the ridge of a wall the cost
curves up to twice as much as J^T J indicates, and undamped steps overshoot. What is added to it is
equal in all directions: along a corridor J^T J is small, and steps that raise the cost too long."""

DAMPING_DECREASE = 0.3
"""Factor of the damping after a step that lowered the cost."""

DAMPING_INCREASE = 4.0
"""Factor of the damping after a step that did not lower the cost."""

MIN_PIVOT = 1e-12
"""Pivots of the normal equations below this share of their diagonal entry are rounding errors."""

SQUARES, COST = 9, 10
"""Entries of `out_match` after pose and curvature: sum of squares of the points, total cost."""


Place = tuple[float, float, float]
"""A pose as a plain tuple: calls from Python take it faster than an array."""


class MotionPrior(NamedTuple):
    """The predicted pose of a scan and how much it is trusted.

    Attributes
    ----------
    pose : tf_submap_scan as predicted, x, y [m] and theta [rad], or float64, shape (3,).
    information : float64, shape (6,), upper triangle of its information matrix in the submap's
        axes: xx, xy, xt, yy, yt, tt.
    scale : scale of Cauchy's loss on it [standard deviations]: predictions fail occasionally.
    """

    pose: Place | FloatArray
    information: FloatArray
    scale: float


class MatchOptions(NamedTuple):
    """How (CS) is minimised.

    Attributes
    ----------
    point_weight : factor of the sum of squares of the points.
    max_num_iterations : maximum number of evaluations of the residuals.
    tolerance : relative decrease of the cost, as predicted for a step, that ends the iteration.
    """

    point_weight: float
    max_num_iterations: int
    tolerance: float


@borrowing_kernel
def differentiate_residuals(
    resolution: float, walls: FloatArray, theta: float, samples: FloatArray
) -> None:
    """Write the residuals of (CS) and their derivatives into `samples`.

    Along a straight wall the map looks the same everywhere. Where its values change there, they
    show how often it was observed, or where that ends, and would attract the scan to what is known
    best. So the derivatives count across the wall only.

    Parameters
    ----------
    resolution : edge of a cell [m].
    walls : float64, shape (2, n), as :func:`wall_directions` writes it.
    theta : of the scan, submap frame [rad].
    samples : float64, shape (11, n), with M_smooth; the last four rows are written.
    """
    scale = 1.0 / resolution
    cos, sin = math.cos(2.0 * theta), math.sin(2.0 * theta)
    for k in range(samples.shape[1]):
        jx = -samples[D_COL, k] * scale
        jy = -samples[D_ROW, k] * scale
        is_wall = walls[0, k] ** 2 + walls[1, k] ** 2  # 1 or 0
        wall_cos = cos * walls[0, k] - sin * walls[1, k]
        wall_sin = sin * walls[0, k] + cos * walls[1, k]
        along_x = 0.5 * ((is_wall + wall_cos) * jx + wall_sin * jy)
        along_y = 0.5 * (wall_sin * jx + (is_wall - wall_cos) * jy)
        jx -= along_x
        jy -= along_y
        samples[ERROR, k] = 1.0 - samples[VALUE, k]
        samples[J_X, k] = jx
        samples[J_Y, k] = jy
        samples[J_THETA, k] = -jx * samples[ARM_Y, k] + jy * samples[ARM_X, k]


@borrowing_kernel
def accumulate_match(
    smooth_map: SmoothMap,
    unknown: float,
    points: FloatArray,
    walls: FloatArray,
    x: float,
    y: float,
    theta: float,
    scratch: PointScratch,
    out_system: FloatArray,
) -> float:
    """Write the normal equations of (CS) at a pose into `out_system`; return the sum of squares.

    Parameters
    ----------
    smooth_map : the occupancy grid.
    unknown : the value of cells never observed.
    points : float64, shape (n, 2), tracking frame [m].
    walls : float64, shape (2, n), as :func:`wall_directions` writes it.
    x, y, theta : tf_submap_scan.
    scratch : for n points.
    out_system : float64, shape (9,): upper triangle of J^T J (xx, xy, xt, yy, yt, tt), then J^T e.
    """
    samples = scratch.samples
    sample_smooth_map(smooth_map, unknown, points, x, y, theta, scratch)
    differentiate_residuals(smooth_map.resolution, walls, theta, samples)
    xx = xy = xt = yy = yt = tt = bx = by = bt = total = 0.0
    for k in range(points.shape[0]):
        error, jx, jy, jt = samples[ERROR, k], samples[J_X, k], samples[J_Y, k], samples[J_THETA, k]
        xx += jx * jx
        xy += jx * jy
        xt += jx * jt
        yy += jy * jy
        yt += jy * jt
        tt += jt * jt
        bx += jx * error
        by += jy * error
        bt += jt * error
        total += error * error
    out_system[0] = xx
    out_system[1] = xy
    out_system[2] = xt
    out_system[3] = yy
    out_system[4] = yt
    out_system[5] = tt
    out_system[6] = bx
    out_system[7] = by
    out_system[8] = bt
    return total


@borrowing_kernel
def damping_terms(system: FloatArray, damping: float) -> tuple[float, float, float]:
    """Return what damping adds to the diagonal of the normal equations: x, y, theta."""
    own = min(damping, MIN_DAMPING)
    isotropic = 0.5 * (damping - own) * (system[0] + system[3])
    return own * system[0] + isotropic, own * system[3] + isotropic, damping * system[5]


@borrowing_kernel
def solve_3x3(system: FloatArray, damping: float, out_step: FloatArray) -> bool:
    """Write the solution of the damped normal equations into `out_step`; return if it exists.

    `system` as :func:`accumulate_match` leaves it, damped by :func:`damping_terms`.
    """
    d00, d11, d22 = damping_terms(system, damping)
    a00, a11, a22 = system[0] + d00, system[3] + d11, system[5] + d22
    if not a00 > 0.0:
        return False
    l10 = system[1] / a00
    l20 = system[2] / a00
    d1 = a11 - l10 * system[1]
    if not d1 > MIN_PIVOT * a11:
        return False
    l21 = (system[4] - l20 * system[1]) / d1
    d2 = a22 - l20 * system[2] - l21 * (system[4] - l20 * system[1])
    if not d2 > MIN_PIVOT * a22:
        return False
    y0 = -system[6]
    y1 = -system[7] - l10 * y0
    y2 = -system[8] - l20 * y0 - l21 * y1
    out_step[2] = y2 / d2
    out_step[1] = y1 / d1 - l21 * out_step[2]
    out_step[0] = y0 / a00 - l10 * out_step[1] - l20 * out_step[2]
    return True


@borrowing_kernel
def prior_terms(
    prior: MotionPrior, x: float, y: float, theta: float
) -> tuple[float, float, float, float]:
    """Return the squared error of a pose against the motion prior, and half its gradient.

    Returns
    -------
    The squared Mahalanobis distance over the squared scale, and information * (pose - prior).
    """
    information = prior.information
    dx = x - prior.pose[0]
    dy = y - prior.pose[1]
    dt = theta - prior.pose[2]
    gradient_x = information[0] * dx + information[1] * dy + information[2] * dt
    gradient_y = information[1] * dx + information[3] * dy + information[4] * dt
    gradient_t = information[2] * dx + information[4] * dy + information[5] * dt
    distance = (dx * gradient_x + dy * gradient_y + dt * gradient_t) / prior.scale**2
    return distance, gradient_x, gradient_y, gradient_t


@borrowing_kernel
def predicted_decrease(system: FloatArray, damping: float, step: FloatArray) -> float:
    """Return the decrease of the cost that the damped model predicts for a step."""
    # Half the gradient is system[6:9].
    decrease = -(step[0] * system[6] + step[1] * system[7] + step[2] * system[8])
    d00, d11, d22 = damping_terms(system, damping)
    decrease += d00 * step[0] ** 2 + d11 * step[1] ** 2 + d22 * step[2] ** 2
    return float(decrease)


@borrowing_kernel
def exceeds(
    smooth_map: SmoothMap,
    unknown: float,
    points: FloatArray,
    pose: Place | FloatArray,
    max_squares: float,
) -> bool:
    """Return whether the sum of squares of (CS) at a pose is larger than a limit.

    It only grows from point to point, so that the first ones often decide.

    Parameters
    ----------
    smooth_map, unknown, points : as in :func:`accumulate_match`.
    pose : tf_submap_scan.
    max_squares : the limit.
    """
    cos, sin = math.cos(pose[2]), math.sin(pose[2])
    total = 0.0
    for k in range(points.shape[0]):
        arm_x = cos * points[k, 0] - sin * points[k, 1]
        arm_y = sin * points[k, 0] + cos * points[k, 1]
        error = 1.0 - smooth_value(smooth_map, unknown, pose[0] + arm_x, pose[1] + arm_y)
        total += error * error
        if total > max_squares:
            return True
    return False


@kernel
def match_least_squares(
    smooth_map: SmoothMap,
    unknown: float,
    points: FloatArray,
    start: Place | FloatArray,
    prior: MotionPrior,
    options: MatchOptions,
    max_start_squares: float,
    out_match: FloatArray,
) -> int:
    """Write the minimum of (CS) with a motion prior into `out_match`; return iterations.

    Parameters
    ----------
    smooth_map, unknown, points : as in :func:`accumulate_match`.
    start : tf_submap_scan to start from, x, y [m] and theta [rad], or float64, shape (3,); theta
        within pi of the prior's, not wrapped.
    prior : the predicted pose.
    options : weights and limits.
    max_start_squares : if the points' sum of squares is larger at the start, the scan is left
        there, its curvature 0, sum of squares and cost infinite.
    out_match : float64, shape (11,): pose, upper triangle of J^T J of the points alone at it
        (unweighted), sum of squares of the points, total cost.

    Notes
    -----
    Minimises ``point_weight * sum (1 - M)^2 + s^2 log(1 + d^T information d / s^2)``, with d =
    pose - prior and s the scale (Cauchy's loss); damped Gauss-Newton (Levenberg and Marquardt),
    analytic derivatives.
    """
    if max_start_squares < np.inf and exceeds(
        smooth_map, unknown, points, start, max_start_squares
    ):
        out_match[0], out_match[1], out_match[2] = start[0], start[1], start[2]
        out_match[3:SQUARES] = 0.0
        out_match[SQUARES:] = np.inf
        return 1
    point_weight = options.point_weight
    scratch = point_scratch(points.shape[0])
    walls = np.empty((2, points.shape[0]))
    wall_directions(points, walls)
    points_system, system, step = np.empty(9), np.empty(9), np.zeros(3)
    damping, best_cost, iterations = MIN_DAMPING, np.inf, 0
    pose_x, pose_y, pose_t = start[0], start[1], start[2]
    try_x, try_y, try_t = pose_x, pose_y, pose_t
    while iterations < options.max_num_iterations:
        iterations += 1
        squares = accumulate_match(
            smooth_map, unknown, points, walls, try_x, try_y, try_t, scratch, points_system
        )
        distance, gradient_x, gradient_y, gradient_t = prior_terms(prior, try_x, try_y, try_t)
        trust = 1.0 / (1.0 + distance)  # derivative of the loss
        cost = point_weight * squares + prior.scale**2 * math.log1p(distance)
        if cost < best_cost:
            damping = max(DAMPING_DECREASE * damping, MIN_DAMPING)
            pose_x, pose_y, pose_t = try_x, try_y, try_t
            best_cost = cost
            out_match[SQUARES] = squares
            for k in range(6):
                out_match[3 + k] = points_system[k]
                system[k] = point_weight * points_system[k] + trust * prior.information[k]
            system[6] = point_weight * points_system[6] + trust * gradient_x
            system[7] = point_weight * points_system[7] + trust * gradient_y
            system[8] = point_weight * points_system[8] + trust * gradient_t
        else:
            damping *= DAMPING_INCREASE
        if not solve_3x3(system, damping, step):
            break
        if predicted_decrease(system, damping, step) < options.tolerance * best_cost:
            break
        try_x = pose_x + step[0]
        try_y = pose_y + step[1]
        try_t = pose_t + step[2]
    out_match[0], out_match[1], out_match[2] = pose_x, pose_y, pose_t
    out_match[COST] = best_cost
    return iterations


@kernel
def match_scan(
    smooth_map: SmoothMapFields,
    unknown: float,
    points: FloatArray,
    start: Place,
    prior: tuple[Place, FloatArray, float],
    options: tuple[float, int, float],
    out_match: FloatArray,
) -> int:
    """Match one scan, without a limit at its start; see :func:`match_least_squares`.

    Python calls it for each scan, so all inputs are plain tuples.

    Parameters
    ----------
    smooth_map : fields of a `SmoothMap`.
    prior, options : fields of a `MotionPrior` and of `MatchOptions`.
    """
    return match_least_squares(
        SmoothMap(smooth_map[0], smooth_map[1], smooth_map[2], smooth_map[3], smooth_map[4]),
        unknown,
        points,
        start,
        MotionPrior(prior[0], prior[1], prior[2]),
        MatchOptions(options[0], options[1], options[2]),
        np.inf,
        out_match,
    )
