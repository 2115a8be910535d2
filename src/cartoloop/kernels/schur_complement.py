# SPDX-License-Identifier: Apache-2.0
"""Elimination of the nodes from the normal equations of sparse pose adjustment (section V-A).

Most nodes hang on submaps alone. Given the submaps' poses they do not depend on each other, so that
each can be eliminated by itself (Schur complement), and what remains is a system in the few kept
vertices: the submaps, and the nodes that are tied to other nodes. With the notation of
:func:`cartoloop.kernels.pose_residuals.linearize_constraints`, for one node with constraints i:

    L L^T = sum_i A_i        P_i = L^-1 A_i T_i        v = L^-1 sum_i b_i
    H_ij += (i == j) T_i^T A_i T_i - P_i^T P_j         g_i += T_i^T b_i - P_i^T v

and, once the steps s_i of the kept vertices are known, the node's own is
L^-T (v + L^-1 sum_i A_i T_i s_i).

Blocks of the reduced Hessian are 3 x 3, row by row. Slot k of the first `num_kept` is the diagonal
block of vertex k, upper half only; slot `num_kept` belongs to the vertices that are held, and is
never read; the others are blocks (k, l), k < l.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from cartoloop._jit import kernel

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_LEAST_DIAGONAL = 1e-6
_PIVOT_TOLERANCE = 1e-13


@kernel
def rotations_of(poses: FloatArray, vertices: IntArray, out_rotations: FloatArray) -> None:
    """Write cosine and sine of the angles of `vertices` into rows of `out_rotations` (n, 2)."""
    for i in range(vertices.size):
        v = vertices[i]
        out_rotations[v, 0] = math.cos(poses[v, 2])
        out_rotations[v, 1] = math.sin(poses[v, 2])


@kernel
def add_kept_constraints(
    kept_a: IntArray,
    kept_b: IntArray,
    linear: FloatArray,
    slots: IntArray,
    out_blocks: FloatArray,
    out_gradient: FloatArray,
) -> None:
    """Add the constraints between kept vertices to `out_blocks` and `out_gradient`.

    Parameters
    ----------
    kept_a, kept_b : int64, shape (n,), rows in the reduced system.
    linear : float64, shape (n, 11), see :func:`linearize_constraints`.
    slots : int64, shape (n,), of the block between the two ends.
    out_blocks : float64, shape (num_slots, 9).
    out_gradient : float64, shape (num_kept + 1, 3).
    """
    for e in range(linear.shape[0]):
        a, b, slot = kept_a[e], kept_b[e], slots[e]
        dx, dy = linear[e, 0], linear[e, 1]
        bx, by, bt = linear[e, 2], linear[e, 3], linear[e, 4]
        xx, xy, xt = linear[e, 5], linear[e, 6], linear[e, 7]
        yy, yt, tt = linear[e, 8], linear[e, 9], linear[e, 10]
        # last column of A T
        axt = dx * xy - dy * xx + xt
        ayt = dx * yy - dy * xy + yt
        att = dx * yt - dy * xt + tt
        out_gradient[a, 0] += bx
        out_gradient[a, 1] += by
        out_gradient[a, 2] += dx * by - dy * bx + bt
        out_gradient[b, 0] -= bx
        out_gradient[b, 1] -= by
        out_gradient[b, 2] -= bt
        out_blocks[a, 0] += xx
        out_blocks[a, 1] += xy
        out_blocks[a, 2] += axt
        out_blocks[a, 4] += yy
        out_blocks[a, 5] += ayt
        out_blocks[a, 8] += dx * ayt - dy * axt + att
        out_blocks[b, 0] += xx
        out_blocks[b, 1] += xy
        out_blocks[b, 2] += xt
        out_blocks[b, 4] += yy
        out_blocks[b, 5] += yt
        out_blocks[b, 8] += tt
        # -A T is block (b, a), its transpose block (a, b): the earlier vertex is the row
        row_x, row_y, column_x, column_y = (axt, ayt, xt, yt) if b < a else (xt, yt, axt, ayt)
        out_blocks[slot, 0] -= xx
        out_blocks[slot, 1] -= xy
        out_blocks[slot, 2] -= row_x
        out_blocks[slot, 3] -= xy
        out_blocks[slot, 4] -= yy
        out_blocks[slot, 5] -= row_y
        out_blocks[slot, 6] -= column_x
        out_blocks[slot, 7] -= column_y
        out_blocks[slot, 8] -= att


@kernel
def _factor_node(
    xx: float, xy: float, xt: float, yy: float, yt: float, tt: float, damping: float
) -> tuple[float, float, float, float, float, float]:
    """Return the Cholesky factor of a damped 3 x 3 block.

    These are 1 / l_00, l_10, l_20, 1 / l_11, l_21, 1 / l_22.
    `damping` is the share of the diagonal that is added to it. Where a pivot vanishes, the last
    number returned is 0.
    """
    d0 = xx + damping * max(xx, _LEAST_DIAGONAL)
    d1 = yy + damping * max(yy, _LEAST_DIAGONAL)
    d2 = tt + damping * max(tt, _LEAST_DIAGONAL)
    if not d0 > 0.0:
        return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    i0 = 1.0 / math.sqrt(d0)
    l1, l2 = xy * i0, xt * i0
    pivot = d1 - l1 * l1
    if not pivot > _PIVOT_TOLERANCE * d1:
        return i0, l1, l2, 0.0, 0.0, 0.0
    i1 = 1.0 / math.sqrt(pivot)
    l21 = (yt - l2 * l1) * i1
    pivot = d2 - l2 * l2 - l21 * l21
    if not pivot > _PIVOT_TOLERANCE * d2:
        return i0, l1, l2, i1, l21, 0.0
    return i0, l1, l2, i1, l21, 1.0 / math.sqrt(pivot)


@kernel
def eliminate_nodes(
    begin: IntArray,
    kept_a: IntArray,
    linear: FloatArray,
    damping: float,
    slots: IntArray,
    couplings: FloatArray,
    out_blocks: FloatArray,
    out_gradient: FloatArray,
    out_factors: FloatArray,
) -> tuple[float, bool]:
    """Add what the nodes leave on the kept vertices to `out_blocks` and `out_gradient`.

    Parameters
    ----------
    begin : int64, shape (n + 1,), constraints begin[i] to begin[i + 1] are those of node i.
    kept_a : int64, shape (num_constraints,), their submaps, ascending within a node.
    linear : float64, shape (num_constraints, 11), see :func:`linearize_constraints`.
    damping : float64, share of a node's diagonal that is added to it (Marquardt).
    slots : int64, one for each pair of a node's constraints: (0, 1), (0, 2), (1, 2), (0, 3), ...
    couplings : float64, shape (max_constraints_of_a_node, 9), scratch.
    out_blocks, out_gradient : as in :func:`add_kept_constraints`.
    out_factors : float64, shape (n, 9): L as in :func:`_factor_node`, then v.

    Returns
    -------
    decrease : float64, of the quadratic model by moving the nodes alone.
    definite : bool, False if a node's block cannot be factored: more damping is needed.
    """
    decrease = 0.0
    pair = 0
    for n in range(begin.size - 1):
        first, last = begin[n], begin[n + 1]
        bx = by = bt = xx = xy = xt = yy = yt = tt = 0.0
        for e in range(first, last):
            bx += linear[e, 2]
            by += linear[e, 3]
            bt += linear[e, 4]
            xx += linear[e, 5]
            xy += linear[e, 6]
            xt += linear[e, 7]
            yy += linear[e, 8]
            yt += linear[e, 9]
            tt += linear[e, 10]
        i0, l1, l2, i1, l21, i2 = _factor_node(xx, xy, xt, yy, yt, tt, damping)
        if i2 == 0.0:
            return decrease, False
        v0 = bx * i0
        v1 = (by - l1 * v0) * i1
        v2 = (bt - l2 * v0 - l21 * v1) * i2
        decrease += 0.5 * (v0 * v0 + v1 * v1 + v2 * v2)
        out_factors[n, 0] = i0
        out_factors[n, 1] = l1
        out_factors[n, 2] = l2
        out_factors[n, 3] = i1
        out_factors[n, 4] = l21
        out_factors[n, 5] = i2
        out_factors[n, 6] = v0
        out_factors[n, 7] = v1
        out_factors[n, 8] = v2
        for e in range(first, last):
            dx, dy, bx, by = linear[e, 0], linear[e, 1], linear[e, 2], linear[e, 3]
            xx, xy, xt = linear[e, 5], linear[e, 6], linear[e, 7]
            yy, yt = linear[e, 8], linear[e, 9]
            axt = dx * xy - dy * xx + xt
            ayt = dx * yy - dy * xy + yt
            att = dx * yt - dy * xt + linear[e, 10]
            p0, p1, p2 = xx * i0, xy * i0, axt * i0
            p3, p4, p5 = (xy - l1 * p0) * i1, (yy - l1 * p1) * i1, (ayt - l1 * p2) * i1
            p6 = (xt - l2 * p0 - l21 * p3) * i2
            p7 = (yt - l2 * p1 - l21 * p4) * i2
            p8 = (att - l2 * p2 - l21 * p5) * i2
            kept = kept_a[e]
            out_gradient[kept, 0] += bx - (p0 * v0 + p3 * v1 + p6 * v2)
            out_gradient[kept, 1] += by - (p1 * v0 + p4 * v1 + p7 * v2)
            out_gradient[kept, 2] += (
                dx * by - dy * bx + linear[e, 4] - (p2 * v0 + p5 * v1 + p8 * v2)
            )
            out_blocks[kept, 0] += xx - (p0 * p0 + p3 * p3 + p6 * p6)
            out_blocks[kept, 1] += xy - (p0 * p1 + p3 * p4 + p6 * p7)
            out_blocks[kept, 2] += axt - (p0 * p2 + p3 * p5 + p6 * p8)
            out_blocks[kept, 4] += yy - (p1 * p1 + p4 * p4 + p7 * p7)
            out_blocks[kept, 5] += ayt - (p1 * p2 + p4 * p5 + p7 * p8)
            out_blocks[kept, 8] += dx * ayt - dy * axt + att - (p2 * p2 + p5 * p5 + p8 * p8)
            for f in range(first, e):
                i = f - first
                slot = slots[pair]
                pair += 1
                for r in range(3):
                    q0, q1, q2 = couplings[i, r], couplings[i, r + 3], couplings[i, r + 6]
                    out_blocks[slot, 3 * r] -= q0 * p0 + q1 * p3 + q2 * p6
                    out_blocks[slot, 3 * r + 1] -= q0 * p1 + q1 * p4 + q2 * p7
                    out_blocks[slot, 3 * r + 2] -= q0 * p2 + q1 * p5 + q2 * p8
                if kept_a[f] == kept:  # one submap saw the node twice: add the transpose, too
                    for r in range(3):
                        q0, q1, q2 = couplings[i, r], couplings[i, r + 3], couplings[i, r + 6]
                        out_blocks[slot, r] -= q0 * p0 + q1 * p3 + q2 * p6
                        out_blocks[slot, r + 3] -= q0 * p1 + q1 * p4 + q2 * p7
                        out_blocks[slot, r + 6] -= q0 * p2 + q1 * p5 + q2 * p8
            i = e - first
            couplings[i, 0], couplings[i, 1], couplings[i, 2] = p0, p1, p2
            couplings[i, 3], couplings[i, 4], couplings[i, 5] = p3, p4, p5
            couplings[i, 6], couplings[i, 7], couplings[i, 8] = p6, p7, p8
    return decrease, True


@kernel
def move_vertices(
    poses: FloatArray,
    kept_vertices: IntArray,
    kept_steps: FloatArray,
    nodes: IntArray,
    begin: IntArray,
    kept_a: IntArray,
    linear: FloatArray,
    factors: FloatArray,
    out_poses: FloatArray,
) -> None:
    """Write the poses after a step into `out_poses`; nodes take the step that follows.

    Parameters
    ----------
    poses : float64, shape (num_vertices, 3) [m, m, rad].
    kept_vertices : int64, shape (num_kept,).
    kept_steps : float64, shape (num_kept + 1, 3), the last of them zero: of vertices that are held.
    nodes : int64, shape (n,), vertices that were eliminated.
    begin, kept_a, linear, factors : of :func:`eliminate_nodes`.
    out_poses : float64, shape (num_vertices, 3); vertices that are held keep what they had there.
    """
    for k in range(kept_vertices.size):
        v = kept_vertices[k]
        for c in range(3):
            out_poses[v, c] = poses[v, c] + kept_steps[k, c]
    for n in range(nodes.size):
        px = py = pt = 0.0
        for e in range(begin[n], begin[n + 1]):
            k = kept_a[e]
            st = kept_steps[k, 2]
            sx = kept_steps[k, 0] - linear[e, 1] * st
            sy = kept_steps[k, 1] + linear[e, 0] * st
            px += linear[e, 5] * sx + linear[e, 6] * sy + linear[e, 7] * st
            py += linear[e, 6] * sx + linear[e, 8] * sy + linear[e, 9] * st
            pt += linear[e, 7] * sx + linear[e, 9] * sy + linear[e, 10] * st
        i0, l1, l2 = factors[n, 0], factors[n, 1], factors[n, 2]
        i1, l21, i2 = factors[n, 3], factors[n, 4], factors[n, 5]
        px *= i0
        py = (py - l1 * px) * i1
        pt = (pt - l2 * px - l21 * py) * i2
        st = (pt + factors[n, 8]) * i2
        sy = (py + factors[n, 7] - l21 * st) * i1
        sx = (px + factors[n, 6] - l1 * sy - l2 * st) * i0
        v = nodes[n]
        out_poses[v, 0] = poses[v, 0] + sx
        out_poses[v, 1] = poses[v, 1] + sy
        out_poses[v, 2] = poses[v, 2] + st
