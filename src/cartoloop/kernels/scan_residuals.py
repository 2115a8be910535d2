# SPDX-License-Identifier: Apache-2.0
"""The least-squares scan matcher (CS), section IV-C: residuals, damped Gauss-Newton."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from cartoloop._jit import kernel
from cartoloop.kernels.smooth_map import (
    ARM_X,
    ARM_Y,
    D_COL,
    D_ROW,
    NUM_ROWS,
    PATCH_CELLS,
    VALUE,
    sample_smooth_map,
)

FloatArray = NDArray[np.float64]

MIN_DAMPING = 0.7
"""On the ridge of a wall the cost curves up to twice as much as J^T J tells: steps overshoot."""

SMALL_DECREASE = 1e-5
"""The search ends when a step promises to lower the cost by no more than this share of it."""


@kernel
def accumulate_match(
    grid: NDArray[np.float32],
    unknown: float,
    origin_x: float,
    origin_y: float,
    resolution: float,
    points: FloatArray,
    x: float,
    y: float,
    theta: float,
    cells: NDArray[np.int64],
    patches: NDArray[np.float32],
    samples: FloatArray,
    out_system: FloatArray,
) -> float:
    """Write the normal equations of (CS) at a pose into `out_system`; return the sum of squares.

    Parameters
    ----------
    grid : shape (num_rows, num_cols), probabilities; 0 where never observed.
    unknown : the value of cells never observed.
    origin_x, origin_y, resolution : centre of cell (0, 0) and pixel edge [m].
    points : float64, shape (n, 2), scan frame [m].
    x, y, theta : pose of the scan in the grid's frame.
    cells, patches, samples : scratch, see :func:`smooth_map.sample_smooth_map`.
    out_system : float64, shape (9,): upper triangle of J^T J (xx, xy, xt, yy, yt, tt), then J^T e.
    """
    sample_smooth_map(
        grid, unknown, origin_x, origin_y, resolution, points, x, y, theta, cells, patches, samples
    )
    scale = 1.0 / resolution
    xx = xy = xt = yy = yt = tt = bx = by = bt = total = 0.0
    for k in range(points.shape[0]):
        error = 1.0 - samples[VALUE, k]
        jx = -samples[D_COL, k] * scale
        jy = -samples[D_ROW, k] * scale
        jt = -jx * samples[ARM_Y, k] + jy * samples[ARM_X, k]
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


@kernel
def solve_3x3(system: FloatArray, damping: float, out_step: FloatArray) -> bool:
    """Write the solution of the damped normal equations into `out_step`; return if there is one.

    `system` as :func:`accumulate_match` leaves it; the diagonal is scaled by 1 + `damping`.
    """
    a00 = system[0] * (1.0 + damping)
    a11 = system[3] * (1.0 + damping)
    a22 = system[5] * (1.0 + damping)
    if not a00 > 0.0:
        return False
    l10 = system[1] / a00
    l20 = system[2] / a00
    d1 = a11 - l10 * system[1]
    if not d1 > 1e-12 * a11:
        return False
    l21 = (system[4] - l20 * system[1]) / d1
    d2 = a22 - l20 * system[2] - l21 * (system[4] - l20 * system[1])
    if not d2 > 1e-12 * a22:
        return False
    y0 = -system[6]
    y1 = -system[7] - l10 * y0
    y2 = -system[8] - l20 * y0 - l21 * y1
    out_step[2] = y2 / d2
    out_step[1] = y1 / d1 - l21 * out_step[2]
    out_step[0] = y0 / a00 - l10 * out_step[1] - l20 * out_step[2]
    return True


@kernel
def match_least_squares(
    grid: NDArray[np.float32],
    unknown: float,
    origin_x: float,
    origin_y: float,
    resolution: float,
    points: FloatArray,
    start: FloatArray,
    prior: FloatArray,
    prior_information: FloatArray,
    prior_scale: float,
    point_weight: float,
    max_num_iterations: int,
    max_start_squares: float,
    out_match: FloatArray,
) -> int:
    """Write the minimum of (CS) plus the pull towards `prior` into `out_match`; return iterations.

    Parameters
    ----------
    grid, unknown, origin_x, origin_y, resolution, points : as :func:`accumulate_match`.
    start : float64, shape (3,), pose to start from; angle within pi of the prior's, not wrapped.
    prior : float64, shape (3,), the predicted pose.
    prior_information : float64, shape (6,), upper triangle of its information matrix.
    prior_scale : from so many standard deviations on the pull wanes: predictions fail now and then.
    point_weight : factor of the sum of squares of the points.
    max_num_iterations : evaluations at the most.
    max_start_squares : where the points' sum of squares is larger at the start, the scan is left
        there, its curvature 0, sum of squares and cost infinite.
    out_match : float64, shape (11,): pose, upper triangle of J^T J of the points alone at it
        (unweighted), sum of squares of the points, total cost.

    Notes
    -----
    Minimises ``point_weight * sum (1 - M)^2 + s^2 log(1 + d^T information d / s^2)``, with d =
    pose - prior and s the scale (Cauchy's loss); damped Gauss-Newton (Levenberg and Marquardt),
    analytic derivatives.
    """
    pose_x = start[0]
    pose_y = start[1]
    pose_t = start[2]
    cells = np.empty((2, points.shape[0]), dtype=np.int64)
    patches = np.empty((PATCH_CELLS, points.shape[0]), dtype=np.float32)
    samples = np.empty((NUM_ROWS, points.shape[0]))
    points_system = np.empty(9)
    system = np.empty(9)
    step = np.zeros(3)
    damping = MIN_DAMPING
    predicted = 0.0
    best_cost = np.inf
    iterations = 0
    try_x = pose_x
    try_y = pose_y
    try_t = pose_t
    while iterations < max_num_iterations:
        iterations += 1
        squares = accumulate_match(
            grid,
            unknown,
            origin_x,
            origin_y,
            resolution,
            points,
            try_x,
            try_y,
            try_t,
            cells,
            patches,
            samples,
            points_system,
        )
        if iterations == 1 and squares > max_start_squares:
            for k in range(3):
                out_match[k] = start[k]
            out_match[3:9] = 0.0
            out_match[9:] = np.inf
            return iterations
        dx = try_x - prior[0]
        dy = try_y - prior[1]
        dt = try_t - prior[2]
        pull_x = prior_information[0] * dx + prior_information[1] * dy + prior_information[2] * dt
        pull_y = prior_information[1] * dx + prior_information[3] * dy + prior_information[4] * dt
        pull_t = prior_information[2] * dx + prior_information[4] * dy + prior_information[5] * dt
        distance = (dx * pull_x + dy * pull_y + dt * pull_t) / prior_scale**2
        trust = 1.0 / (1.0 + distance)
        cost = point_weight * squares + prior_scale**2 * math.log1p(distance)
        if cost < best_cost:
            damping = max(0.3 * damping, MIN_DAMPING)
            pose_x = try_x
            pose_y = try_y
            pose_t = try_t
            best_cost = cost
            out_match[9] = squares
            for k in range(6):
                out_match[3 + k] = points_system[k]
                system[k] = point_weight * points_system[k] + trust * prior_information[k]
            system[6] = point_weight * points_system[6] + trust * pull_x
            system[7] = point_weight * points_system[7] + trust * pull_y
            system[8] = point_weight * points_system[8] + trust * pull_t
        else:
            damping *= 4.0
        if not solve_3x3(system, damping, step):
            break
        # The decrease of the cost that the damped model promises; half the gradient: `system[6:9]`.
        predicted = -(step[0] * system[6] + step[1] * system[7] + step[2] * system[8])
        predicted += damping * (
            system[0] * step[0] ** 2 + system[3] * step[1] ** 2 + system[5] * step[2] ** 2
        )
        if predicted < SMALL_DECREASE * best_cost:
            break
        try_x = pose_x + step[0]
        try_y = pose_y + step[1]
        try_t = pose_t + step[2]
    out_match[0] = pose_x
    out_match[1] = pose_y
    out_match[2] = pose_t
    out_match[10] = best_cost
    return iterations
