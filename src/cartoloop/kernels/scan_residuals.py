# SPDX-License-Identifier: Apache-2.0
"""The least-squares scan matcher (CS), section IV-C: smooth map, gradient, damped Gauss-Newton."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from cartoloop._jit import kernel

FloatArray = NDArray[np.float64]

MIN_DAMPING = 0.7
"""On the ridge of a wall the cost curves up to twice as much as J^T J tells: steps overshoot."""

SMALL_DECREASE = 1e-5
"""The search ends when a step promises to lower the cost by no more than this share of it."""


@kernel
def smooth_probability(
    grid: NDArray[np.float32], unknown: float, col: float, row: float
) -> tuple[float, float, float]:
    """Return M_smooth at a point and its derivatives along columns and rows.

    Parameters
    ----------
    grid : shape (num_rows, num_cols), probabilities; 0 where never observed.
    unknown : the value of cells never observed or outside of the grid.
    col, row : the point in cells, cell centres at whole numbers.

    Notes
    -----
    Bicubic (Catmull-Rom) interpolation over 4 x 4 cells: continuous first derivatives.
    """
    col0 = np.int64(np.floor(col))
    row0 = np.int64(np.floor(row))
    num_rows, num_cols = grid.shape
    if col0 < -2 or row0 < -2 or col0 > num_cols or row0 > num_rows:
        return unknown, 0.0, 0.0
    u = col - col0
    v = row - row0
    # Catmull-Rom weights and their derivatives.
    wu0 = ((-0.5 * u + 1.0) * u - 0.5) * u
    wu1 = (1.5 * u - 2.5) * u * u + 1.0
    wu2 = ((-1.5 * u + 2.0) * u + 0.5) * u
    wu3 = (0.5 * u - 0.5) * u * u
    du0 = (-1.5 * u + 2.0) * u - 0.5
    du1 = (4.5 * u - 5.0) * u
    du2 = (-4.5 * u + 4.0) * u + 0.5
    du3 = (1.5 * u - 1.0) * u
    value = 0.0
    d_col = 0.0
    d_row = 0.0
    inside = col0 >= 1 and row0 >= 1 and col0 + 2 < num_cols and row0 + 2 < num_rows
    for i in range(4):
        r = row0 - 1 + i
        p0 = p1 = p2 = p3 = 0.0
        if inside:
            p0 = np.float64(grid[r, col0 - 1])
            p1 = np.float64(grid[r, col0])
            p2 = np.float64(grid[r, col0 + 1])
            p3 = np.float64(grid[r, col0 + 2])
        else:
            if 0 <= r < num_rows:
                if 0 <= col0 - 1 < num_cols:
                    p0 = np.float64(grid[r, col0 - 1])
                if 0 <= col0 < num_cols:
                    p1 = np.float64(grid[r, col0])
                if 0 <= col0 + 1 < num_cols:
                    p2 = np.float64(grid[r, col0 + 1])
                if 0 <= col0 + 2 < num_cols:
                    p3 = np.float64(grid[r, col0 + 2])
        p0 = p0 if p0 > 0.0 else unknown
        p1 = p1 if p1 > 0.0 else unknown
        p2 = p2 if p2 > 0.0 else unknown
        p3 = p3 if p3 > 0.0 else unknown
        along = wu0 * p0 + wu1 * p1 + wu2 * p2 + wu3 * p3
        slope = du0 * p0 + du1 * p1 + du2 * p2 + du3 * p3
        if i == 0:
            w = ((-0.5 * v + 1.0) * v - 0.5) * v
            d = (-1.5 * v + 2.0) * v - 0.5
        elif i == 1:
            w = (1.5 * v - 2.5) * v * v + 1.0
            d = (4.5 * v - 5.0) * v
        elif i == 2:
            w = ((-1.5 * v + 2.0) * v + 0.5) * v
            d = (-4.5 * v + 4.0) * v + 0.5
        else:
            w = (0.5 * v - 0.5) * v * v
            d = (1.5 * v - 1.0) * v
        value += w * along
        d_col += w * slope
        d_row += d * along
    return value, d_col, d_row


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
    out_system : float64, shape (9,): upper triangle of J^T J (xx, xy, xt, yy, yt, tt), then J^T e.
    """
    c = math.cos(theta)
    s = math.sin(theta)
    scale = 1.0 / resolution
    xx = xy = xt = yy = yt = tt = bx = by = bt = total = 0.0
    for k in range(points.shape[0]):
        hx = c * points[k, 0] - s * points[k, 1]
        hy = s * points[k, 0] + c * points[k, 1]
        value, d_col, d_row = smooth_probability(
            grid, unknown, (x + hx - origin_x) * scale, (y + hy - origin_y) * scale
        )
        error = 1.0 - value
        jx = -d_col * scale
        jy = -d_row * scale
        jt = -jx * hy + jy * hx
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
            points_system,
        )
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
