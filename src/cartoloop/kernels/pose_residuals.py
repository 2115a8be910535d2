# SPDX-License-Identifier: Apache-2.0
"""Residual, loss and linearisation of one constraint of sparse pose adjustment (eq. SPA, 4, 5).

A constraint is one row of nine numbers: tf_a_b as measured (x, y, theta) and the upper half of its
information matrix in the frame of a (xx, xy, xt, yy, yt, tt). Here constraints are worked through
one by one; those of nodes that hang on submaps alone are, the same way,
eight at a time, in :mod:`cartoloop.kernels.node_elimination`.

Notes
-----
Eq. (5) is printed with its sign the wrong way round in the translation; meant is where b is seen
from a, e = xi_ij - (R_a^-1 (t_b - t_a), theta_b - theta_a). Turned into the map frame it becomes
e' = (R_a z_t - d, z_theta - theta_b + theta_a) with d = t_b - t_a, and its derivatives free of
trigonometry: by the pose of b minus the identity, by the pose of a

    T = [[1, 0, -d_y], [0, 1, d_x], [0, 0, 1]].

E^2 does not change if the information matrix is turned as well.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from cartoloop._jit import kernel

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

NO_LOSS = 0
HUBER = 1
CAUCHY = 2
DYNAMIC_COVARIANCE_SCALING = 3
TRUNCATED = 4
GIVEN = 5
"""No loss: the weight is what the caller has set."""

ROW_SIZE = 9
LINEAR_SIZE = 11

_TURN = 2.0 * math.pi


@kernel
def robust_loss(loss: int, scale: float, squared: float) -> tuple[float, float]:
    """Return rho and its derivative, the weight of the constraint, at s = E^2.

    Parameters
    ----------
    loss : int64, one of the constants of this module.
    scale : float64 > 0, in units of the whitened residual E.
    squared : float64 >= 0, E^2.

    Notes
    -----
    Huber and Cauchy as in Ceres. Dynamic covariance scaling [16] is given there as a weight only,
    (2 phi / (phi + s))^2 from s = phi = scale^2 on; rho is that weight's integral, so that a step
    can be judged by the cost. Truncated least squares: rho = min(s, scale^2).
    """
    if loss == NO_LOSS:
        return squared, 1.0
    phi = scale * scale
    if loss == CAUCHY:
        ratio = squared / phi
        return phi * math.log1p(ratio), 1.0 / (1.0 + ratio)
    if squared <= phi:
        return squared, 1.0
    if loss == HUBER:
        root = math.sqrt(squared)
        return 2.0 * scale * root - phi, scale / root
    if loss == DYNAMIC_COVARIANCE_SCALING:
        switch = 2.0 * phi / (phi + squared)
        return phi * (3.0 - 2.0 * switch), switch * switch
    return phi, 0.0


@kernel
def turned_residual(
    dx: float,
    dy: float,
    turn: float,
    cos_a: float,
    sin_a: float,
    measured_x: float,
    measured_y: float,
    measured_theta: float,
) -> tuple[float, float, float]:
    """Return e' of the module's notes, the residual in the map frame [m, m, rad].

    Its angle is in [-pi, pi).

    Parameters
    ----------
    dx, dy, turn : float64, from a to b [m, m, rad], map frame.
    cos_a, sin_a : float64, of the angle of a.
    measured_x, measured_y, measured_theta : float64, tf_a_b as measured.
    """
    et = measured_theta - turn
    return (
        cos_a * measured_x - sin_a * measured_y - dx,
        sin_a * measured_x + cos_a * measured_y - dy,
        et - _TURN * math.floor((et + math.pi) / _TURN),
    )


@kernel
def turned_information(
    cos_a: float, sin_a: float, xx: float, xy: float, xt: float, yy: float, yt: float
) -> tuple[float, float, float, float, float]:
    """Return xx, xy, xt, yy, yt of an information matrix turned from the frame of a to the map's.

    The last element, tt, stays what it is.
    """
    cos2, sin2, cross = cos_a * cos_a, sin_a * sin_a, cos_a * sin_a
    return (
        cos2 * xx + sin2 * yy - 2.0 * cross * xy,
        cross * (xx - yy) + (cos2 - sin2) * xy,
        cos_a * xt - sin_a * yt,
        sin2 * xx + cos2 * yy + 2.0 * cross * xy,
        sin_a * xt + cos_a * yt,
    )


@kernel
def squared_residuals(
    poses: FloatArray,
    rotations: FloatArray,
    vertex_a: IntArray,
    vertex_b: IntArray,
    rows: FloatArray,
    out_squared: FloatArray,
) -> None:
    """Write E^2 of eq. (4) of every constraint into `out_squared`.

    Parameters
    ----------
    poses : float64, shape (num_vertices, 3) [m, m, rad], map frame.
    rotations : float64, shape (num_vertices, 2), cosine and sine where a constraint starts.
    vertex_a, vertex_b : int64, shape (n,).
    rows : float64, shape (n, 9).
    out_squared : float64, shape (n,).
    """
    for e in range(rows.shape[0]):
        a, b = vertex_a[e], vertex_b[e]
        cos_a, sin_a = rotations[a, 0], rotations[a, 1]
        ex, ey, et = turned_residual(
            poses[b, 0] - poses[a, 0],
            poses[b, 1] - poses[a, 1],
            poses[b, 2] - poses[a, 2],
            cos_a,
            sin_a,
            rows[e, 0],
            rows[e, 1],
            rows[e, 2],
        )
        xx, xy, xt, yy, yt = turned_information(
            cos_a, sin_a, rows[e, 3], rows[e, 4], rows[e, 5], rows[e, 6], rows[e, 7]
        )
        tt = rows[e, 8]
        squared = (
            ex * (xx * ex + 2.0 * (xy * ey + xt * et))
            + ey * (yy * ey + 2.0 * yt * et)
            + tt * et * et
        )
        out_squared[e] = max(squared, 0.0)  # rounding may leave a semidefinite form below it


@kernel
def residual_sizes(
    constraints: IntArray,
    between_nodes: NDArray[np.bool_],
    index_a: IntArray,
    index_b: IntArray,
    relative_poses: FloatArray,
    submap_poses: FloatArray,
    node_poses: FloatArray,
    out_translation: FloatArray,
    out_rotation: FloatArray,
) -> None:
    """Write the lengths of the two parts of e of eq. (5) of some constraints into the outputs (n,).

    Parameters
    ----------
    constraints : int64, shape (n,), which.
    between_nodes : bool, shape (num_constraints,), whether a is a node, not a submap.
    index_a, index_b, relative_poses : of the graph, shapes (num_constraints,) and (.., 3).
    submap_poses, node_poses : float64, shapes (num_submaps, 3), (num_nodes, 3) [m, m, rad].
    """
    submap_rotations = np.empty((submap_poses.shape[0], 2))
    for a in range(submap_poses.shape[0]):
        submap_rotations[a, 0] = math.cos(submap_poses[a, 2])
        submap_rotations[a, 1] = math.sin(submap_poses[a, 2])
    for i in range(constraints.size):
        c = constraints[i]
        a, b = index_a[c], index_b[c]
        if between_nodes[c]:
            ax, ay, at = node_poses[a, 0], node_poses[a, 1], node_poses[a, 2]
            cos_a, sin_a = math.cos(at), math.sin(at)
        else:
            ax, ay, at = submap_poses[a, 0], submap_poses[a, 1], submap_poses[a, 2]
            cos_a, sin_a = submap_rotations[a, 0], submap_rotations[a, 1]
        ex, ey, et = turned_residual(
            node_poses[b, 0] - ax,
            node_poses[b, 1] - ay,
            node_poses[b, 2] - at,
            cos_a,
            sin_a,
            relative_poses[c, 0],
            relative_poses[c, 1],
            relative_poses[c, 2],
        )
        out_translation[i] = math.sqrt(ex * ex + ey * ey)
        out_rotation[i] = abs(et)


@kernel
def linearize_constraints(
    poses: FloatArray,
    rotations: FloatArray,
    vertex_a: IntArray,
    vertex_b: IntArray,
    rows: FloatArray,
    losses: IntArray,
    scale: float,
    out_linear: FloatArray,
    out_weights: FloatArray,
) -> float:
    """Write the quadratic model of every constraint into `out_linear`; return the cost (eq. SPA).

    Parameters
    ----------
    poses, rotations, vertex_a, vertex_b, rows : see :func:`squared_residuals`.
    losses : int64, shape (n,), and scale : float64, see :func:`robust_loss`.
    out_linear : float64, shape (n, 11): d_x, d_y; b = w I e' (3); A = w I (xx, xy, xt, yy, yt, tt),
        with w = rho'(E^2) and I the information matrix in the map frame.
    out_weights : float64, shape (n,), w; where the loss is `GIVEN`, it is read.

    Notes
    -----
    Iteratively reweighted least squares: the Hessian's blocks are H_bb = A, H_ba = -A T,
    H_aa = T^T A T, and the gradient is -b for the pose of b, T^T b for that of a. Where rho is
    concave, as all losses here are, this model is nowhere below the cost, so that its steps are
    safe; the second derivative of rho would save no iteration from a drifted start.
    """
    cost = 0.0
    for e in range(rows.shape[0]):
        a, b = vertex_a[e], vertex_b[e]
        cos_a, sin_a = rotations[a, 0], rotations[a, 1]
        dx, dy = poses[b, 0] - poses[a, 0], poses[b, 1] - poses[a, 1]
        ex, ey, et = turned_residual(
            dx, dy, poses[b, 2] - poses[a, 2], cos_a, sin_a, rows[e, 0], rows[e, 1], rows[e, 2]
        )
        xx, xy, xt, yy, yt = turned_information(
            cos_a, sin_a, rows[e, 3], rows[e, 4], rows[e, 5], rows[e, 6], rows[e, 7]
        )
        tt = rows[e, 8]
        bx = xx * ex + xy * ey + xt * et
        by = xy * ex + yy * ey + yt * et
        bt = xt * ex + yt * ey + tt * et
        squared = max(ex * bx + ey * by + et * bt, 0.0)
        if losses[e] == GIVEN:
            rho, weight = out_weights[e] * squared, out_weights[e]
        else:
            rho, weight = robust_loss(losses[e], scale, squared)
        cost += 0.5 * rho
        out_weights[e] = weight
        out_linear[e, 0] = dx
        out_linear[e, 1] = dy
        out_linear[e, 2] = weight * bx
        out_linear[e, 3] = weight * by
        out_linear[e, 4] = weight * bt
        out_linear[e, 5] = weight * xx
        out_linear[e, 6] = weight * xy
        out_linear[e, 7] = weight * xt
        out_linear[e, 8] = weight * yy
        out_linear[e, 9] = weight * yt
        out_linear[e, 10] = weight * tt
    return cost
