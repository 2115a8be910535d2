# SPDX-License-Identifier: Apache-2.0
"""Constraints as quadratic models: the one linearisation, eight constraints at a time (eq. SPA).

It serves the packed nodes (:mod:`.elimination`) and the direct constraints (below) alike, whatever
the constraint connects: a submap and a node, two nodes, or the map frame and a node.

The compiler turns a loop over lanes into vector instructions, unless it knows that there are eight
turns: then it unrolls the loop. That is why these loops take the number of lanes from the size of
an array, here and in :mod:`cartoloop.kernels.pose_adjustment.elimination`. And arrays are taken out
of a NamedTuple once, before a loop: each access counts a reference.

Notes
-----
Iteratively reweighted least squares. With d, T, e' of
:mod:`cartoloop.kernels.pose_adjustment.residuals`, w = rho'(E^2) and I the information matrix in
the map frame, a constraint adds with A = w I and b = w I e'

    H_bb = A    H_ba = -A T    H_aa = T^T A T    g_b = -b    g_a = T^T b

to the Hessian and the gradient. Where rho is concave in E^2, as all losses here are, this model is
nowhere below the cost, so that its steps are safe; the second derivative of rho would save no
iteration from a drifted start.
"""

from __future__ import annotations

import numpy as np

from cartoloop._jit import kernel
from cartoloop.arrays import FloatArray, IntArray
from cartoloop.kernels.pose_adjustment.layout import LANES, DirectConstraints, GroupLosses, Rows
from cartoloop.kernels.pose_adjustment.losses import FIXED_WEIGHTS
from cartoloop.kernels.pose_adjustment.residuals import information_in_map, residual_in_map
from cartoloop.kernels.pose_adjustment.robust_loss import robust_loss

_W = LANES


@kernel
def linearize_rows(
    at_b: FloatArray,
    places: FloatArray,
    place_of: IntArray,
    measured: FloatArray,
    row: int,
    num_rows: int,
    from_a: FloatArray,
    out: FloatArray,
    k: int,
) -> None:
    """Write the models of constraints into rows of `out` from k on, the loss left out.

    Parameters
    ----------
    at_b : float64, shape (24,): x, y, theta of eight vertices b, the same for all rows.
    places : float64, shape (n, 5): x, y, theta, cosine and sine of theta of vertices a.
    place_of : int64, shape (rows, 8), number in `places` of each constraint's vertex a.
    measured : float64, shape (rows, 72), see `MEASURED`.
    row, num_rows : int64, which rows.
    from_a : float64, shape (40,), scratch.
    out : float64, shape (k + num_rows or more, 96), see `LINEAR`.
    """
    for r in range(num_rows):
        for i in range(_W):
            place = place_of[row + r, i]
            for c in range(5):
                from_a[c * _W + i] = places[place, c]
        for i in range(at_b.size // 3):
            cos_a, sin_a = from_a[3 * _W + i], from_a[4 * _W + i]
            dx, dy = at_b[i] - from_a[i], at_b[_W + i] - from_a[_W + i]
            ex, ey, et = residual_in_map(
                dx,
                dy,
                at_b[2 * _W + i] - from_a[2 * _W + i],
                cos_a,
                sin_a,
                measured[row + r, i],
                measured[row + r, _W + i],
                measured[row + r, 2 * _W + i],
            )
            xx, xy, xt, yy, yt = information_in_map(
                cos_a,
                sin_a,
                measured[row + r, 3 * _W + i],
                measured[row + r, 4 * _W + i],
                measured[row + r, 5 * _W + i],
                measured[row + r, 6 * _W + i],
                measured[row + r, 7 * _W + i],
            )
            tt = measured[row + r, 8 * _W + i]
            bx = xx * ex + xy * ey + xt * et
            by = xy * ex + yy * ey + yt * et
            bt = xt * ex + yt * ey + tt * et
            out[k + r, i] = dx
            out[k + r, _W + i] = dy
            out[k + r, 2 * _W + i] = bx
            out[k + r, 3 * _W + i] = by
            out[k + r, 4 * _W + i] = bt
            out[k + r, 5 * _W + i] = xx
            out[k + r, 6 * _W + i] = xy
            out[k + r, 7 * _W + i] = xt
            out[k + r, 8 * _W + i] = yy
            out[k + r, 9 * _W + i] = yt
            out[k + r, 10 * _W + i] = tt
            out[k + r, 11 * _W + i] = ex * bx + ey * by + et * bt


@kernel
def weigh_rows(
    rows: Rows,
    row: int,
    num_rows: int,
    num_lanes: int,
    losses: GroupLosses,
    linear: FloatArray,
    k: int,
) -> float:
    """Apply the losses to the models from row k of `linear` on, of constraints from `row` on.

    The weights are written, unless the group has `FIXED_WEIGHTS`. Lanes from `num_lanes` on, which
    repeat others, are left alone. Returns the cost.
    """
    groups, weights = rows.groups, rows.weights
    codes, scales = losses.codes, losses.scales
    cost = 0.0
    for r in range(num_rows):
        for i in range(num_lanes):
            group = groups[row + r, i]
            code, squared = codes[group], max(linear[k + r, 11 * _W + i], 0.0)
            if code == FIXED_WEIGHTS:
                rho, weight = weights[row + r, i] * squared, weights[row + r, i]
            else:
                rho, weight = robust_loss(code, scales[group], squared)
            weights[row + r, i] = weight
            cost += 0.5 * rho
            if weight != 1.0:
                for c in range(2, 11):
                    linear[k + r, c * _W + i] *= weight
    return cost


@kernel
def linearize_direct(
    poses: FloatArray, rotations: FloatArray, direct: DirectConstraints, losses: GroupLosses
) -> float:
    """Write the models of the direct constraints into `direct.linear`; return their cost.

    Parameters
    ----------
    poses : float64, shape (num_vertices, 3) [m, m, rad], map frame.
    rotations : float64, shape (num_vertices, 2), cosine and sine of the angles of all vertices a.
    """
    from_a, at_b = np.empty(5 * _W), np.empty(3 * _W)
    rows, place_of, places = direct.rows, direct.place_of, direct.places
    vertex_a, vertex_b, linear = direct.vertex_a, direct.vertex_b, direct.linear
    measured, count = rows.measured, vertex_a.size
    cost = 0.0
    for e in range(count):
        a = vertex_a[e]
        for c in range(3):
            places[e, c] = poses[a, c]
        for c in range(2):
            places[e, 3 + c] = rotations[a, c]
    for row in range(linear.shape[0]):
        for i in range(_W):
            b = vertex_b[place_of[row, i]]
            for c in range(3):
                at_b[c * _W + i] = poses[b, c]
        linearize_rows(at_b, places, place_of, measured, row, 1, from_a, linear, row)
        cost += weigh_rows(rows, row, 1, min(_W, count - row * _W), losses, linear, row)
    return cost
