# SPDX-License-Identifier: Apache-2.0
"""Elimination of the nodes from the normal equations of sparse pose adjustment (section V-A).

Most nodes have constraints to submaps only. Given the poses of the submaps they do not depend on
each other, so that each can be eliminated by itself (Schur complement); a system in the submaps
remains. With d, T, e' of :mod:`cartoloop.kernels.pose_adjustment.residuals`, A_i = w_i I_i the
weighted information of constraint i of a node and b_i = A_i e'_i,

    L L^T = sum_i A_i        P_i = L^-1 A_i T_i        v = L^-1 sum_i b_i
    H_ij += (i == j) T_i^T A_i T_i - P_i^T P_j         g_i += T_i^T b_i - P_i^T v

and, once the steps s_i of the submaps are known, the step of the node is
L^-T (v + L^-1 sum_i A_i T_i s_i).

The models of constraints are not kept from one pass to the next: linearising again is cheaper.
How the nodes lie in memory, see :mod:`cartoloop.kernels.pose_adjustment.layout`.
"""

from __future__ import annotations

import math

import numpy as np

from cartoloop._jit import kernel
from cartoloop.arrays import FloatArray, IntArray
from cartoloop.kernels.pose_adjustment.layout import (
    LANES,
    LINEAR,
    Elimination,
    GroupLosses,
    Layout,
)
from cartoloop.kernels.pose_adjustment.linearization import linearize_rows, weigh_rows
from cartoloop.kernels.sparse_cholesky.numeric import LEAST_DIAGONAL, PIVOT_TOLERANCE

_W = LANES


@kernel
def _place_submaps(
    poses: FloatArray, rotations: FloatArray, layout: Layout, w: int, out: FloatArray
) -> None:
    """Write x, y, theta, cosine and sine of the submaps of a window's diagonal slots into `out`."""
    windows, slot_ends = layout.windows, layout.slot_ends
    for slot in range(windows[w, 2], windows[w, 3]):
        a = slot_ends[slot, 0]
        if a == slot_ends[slot, 1]:
            out[slot, 0] = poses[a, 0]
            out[slot, 1] = poses[a, 1]
            out[slot, 2] = poses[a, 2]
            out[slot, 3] = rotations[a, 0]
            out[slot, 4] = rotations[a, 1]


@kernel
def _place_nodes(
    poses: FloatArray, num_submaps: int, nodes: IntArray, b: int, out: FloatArray
) -> None:
    """Write x, y, theta of the nodes of block b into `out` (24,)."""
    for i in range(_W):
        vertex = num_submaps + nodes[b, i]
        for c in range(3):
            out[c * _W + i] = poses[vertex, c]


@kernel
def _factor(
    linear: FloatArray, num_rows: int, damping: float, total: FloatArray, out: FloatArray, b: int
) -> bool:
    """Write L and v of eight nodes into `out[b, b]`; return whether all could be factored.

    `total` (72,) is scratch. `damping` is the share of the diagonal that is added to it.
    """
    lanes = total.size // 9
    for j in range(9 * lanes):
        total[j] = linear[0, 2 * _W + j]
    for k in range(1, num_rows):
        for j in range(9 * lanes):
            total[j] += linear[k, 2 * _W + j]
    for i in range(lanes):
        d0 = total[3 * _W + i] + damping * max(total[3 * _W + i], LEAST_DIAGONAL)
        d1 = total[6 * _W + i] + damping * max(total[6 * _W + i], LEAST_DIAGONAL)
        d2 = total[8 * _W + i] + damping * max(total[8 * _W + i], LEAST_DIAGONAL)
        i0 = 1.0 / math.sqrt(d0) if d0 > 0.0 else 0.0
        l1, l2 = total[4 * _W + i] * i0, total[5 * _W + i] * i0
        pivot = d1 - l1 * l1
        i1 = 1.0 / math.sqrt(pivot) if pivot > PIVOT_TOLERANCE * d1 else 0.0
        l21 = (total[7 * _W + i] - l2 * l1) * i1
        pivot = d2 - l2 * l2 - l21 * l21
        i2 = 1.0 / math.sqrt(pivot) if pivot > PIVOT_TOLERANCE * d2 else 0.0
        v0 = total[i] * i0
        v1 = (total[_W + i] - l1 * v0) * i1
        out[b, i] = i0
        out[b, _W + i] = l1
        out[b, 2 * _W + i] = l2
        out[b, 3 * _W + i] = i1
        out[b, 4 * _W + i] = l21
        out[b, 5 * _W + i] = i2
        out[b, 6 * _W + i] = v0
        out[b, 7 * _W + i] = v1
        out[b, 8 * _W + i] = (total[2 * _W + i] - l2 * v0 - l21 * v1) * i2
    for i in range(_W):
        if not (out[b, i] > 0.0 and out[b, 3 * _W + i] > 0.0 and out[b, 5 * _W + i] > 0.0):
            return False
    return True


@kernel
def _couple_block(
    linear: FloatArray,
    layout: Layout,
    b: int,
    factors: FloatArray,
    out_own: FloatArray,
    out_coupling: FloatArray,
    out_slots: FloatArray,
) -> None:
    """Add to `out_slots` what the constraints of block b leave on their own submaps.

    P is written into rows of `out_coupling`; `out_own` (72,) is scratch.
    """
    blocks, slots = layout.blocks, layout.slots
    for k in range(blocks[b, 1]):
        for i in range(out_own.size // 9):
            dx, dy, bx, by = (
                linear[k, i],
                linear[k, _W + i],
                linear[k, 2 * _W + i],
                linear[k, 3 * _W + i],
            )
            xx, xy, xt = linear[k, 5 * _W + i], linear[k, 6 * _W + i], linear[k, 7 * _W + i]
            yy, yt = linear[k, 8 * _W + i], linear[k, 9 * _W + i]
            i0, l1, l2 = factors[b, i], factors[b, _W + i], factors[b, 2 * _W + i]
            i1, l21, i2 = factors[b, 3 * _W + i], factors[b, 4 * _W + i], factors[b, 5 * _W + i]
            v0, v1, v2 = factors[b, 6 * _W + i], factors[b, 7 * _W + i], factors[b, 8 * _W + i]
            axt = dx * xy - dy * xx + xt
            ayt = dx * yy - dy * xy + yt
            att = dx * yt - dy * xt + linear[k, 10 * _W + i]
            p0, p1, p2 = xx * i0, xy * i0, axt * i0
            p3, p4, p5 = (xy - l1 * p0) * i1, (yy - l1 * p1) * i1, (ayt - l1 * p2) * i1
            p6 = (xt - l2 * p0 - l21 * p3) * i2
            p7 = (yt - l2 * p1 - l21 * p4) * i2
            p8 = (att - l2 * p2 - l21 * p5) * i2
            out_coupling[k, i] = p0
            out_coupling[k, _W + i] = p1
            out_coupling[k, 2 * _W + i] = p2
            out_coupling[k, 3 * _W + i] = p3
            out_coupling[k, 4 * _W + i] = p4
            out_coupling[k, 5 * _W + i] = p5
            out_coupling[k, 6 * _W + i] = p6
            out_coupling[k, 7 * _W + i] = p7
            out_coupling[k, 8 * _W + i] = p8
            out_own[i] = xx - (p0 * p0 + p3 * p3 + p6 * p6)
            out_own[_W + i] = xy - (p0 * p1 + p3 * p4 + p6 * p7)
            out_own[2 * _W + i] = axt - (p0 * p2 + p3 * p5 + p6 * p8)
            out_own[3 * _W + i] = yy - (p1 * p1 + p4 * p4 + p7 * p7)
            out_own[4 * _W + i] = ayt - (p1 * p2 + p4 * p5 + p7 * p8)
            out_own[5 * _W + i] = dx * ayt - dy * axt + att - (p2 * p2 + p5 * p5 + p8 * p8)
            out_own[6 * _W + i] = bx - (p0 * v0 + p3 * v1 + p6 * v2)
            out_own[7 * _W + i] = by - (p1 * v0 + p4 * v1 + p7 * v2)
            turn = dx * by - dy * bx + linear[k, 4 * _W + i]
            out_own[8 * _W + i] = turn - (p2 * v0 + p5 * v1 + p8 * v2)
        row = blocks[b, 0] + k
        for i in range(blocks[b, 2]):
            slot = slots[row, i]
            for c in range(9):
                out_slots[slot, c] += out_own[c * _W + i]


@kernel
def _cross_block(
    couplings: FloatArray, layout: Layout, b: int, numbers: FloatArray, out_slots: FloatArray
) -> None:
    """Subtract P_f^T P_e of the pairs of constraints of block b from `out_slots`.

    Where one submap saw a node twice, the block and its transpose belong to the submap's own slot.
    `numbers` (72,) is scratch.
    """
    blocks, pair_slots = layout.blocks, layout.pair_slots
    pair = blocks[b, 3]
    for e in range(blocks[b, 1]):
        for f in range(e):
            for i in range(numbers.size // 9):
                for r in range(3):
                    q0, q1 = couplings[f, r * _W + i], couplings[f, (r + 3) * _W + i]
                    q2 = couplings[f, (r + 6) * _W + i]
                    for c in range(3):
                        numbers[(3 * r + c) * _W + i] = -(
                            q0 * couplings[e, c * _W + i]
                            + q1 * couplings[e, (c + 3) * _W + i]
                            + q2 * couplings[e, (c + 6) * _W + i]
                        )
            for i in range(blocks[b, 2]):
                slot = pair_slots[pair, i]
                if slot >= 0:
                    for c in range(9):
                        out_slots[slot, c] += numbers[c * _W + i]
                    continue
                slot = -1 - slot
                out_slots[slot, 0] += 2.0 * numbers[i]
                out_slots[slot, 1] += numbers[_W + i] + numbers[3 * _W + i]
                out_slots[slot, 2] += numbers[2 * _W + i] + numbers[6 * _W + i]
                out_slots[slot, 3] += 2.0 * numbers[4 * _W + i]
                out_slots[slot, 4] += numbers[5 * _W + i] + numbers[7 * _W + i]
                out_slots[slot, 5] += 2.0 * numbers[8 * _W + i]
            pair += 1


@kernel
def linearize_windows(
    poses: FloatArray,
    rotations: FloatArray,
    num_submaps: int,
    layout: Layout,
    losses: GroupLosses,
    damping: float,
    eliminate: bool,
    out: Elimination,
) -> tuple[float, float, bool]:
    """Return the cost of the packed constraints; eliminate their nodes if asked to.

    Parameters
    ----------
    poses : float64, shape (num_vertices, 3) [m, m, rad], submaps first.
    rotations : float64, shape (num_vertices, 2), cosine and sine of the angles of the submaps.
    damping : float64, share of a node's diagonal that is added to it (Marquardt).
    eliminate : bool; False: only the cost and the weights are computed.

    Returns
    -------
    cost : float64.
    decrease : float64, of the quadratic model by moving the nodes alone.
    definite : bool, False if a node's block cannot be factored: more damping is needed.
    """
    windows, blocks, rows = layout.windows, layout.blocks, layout.rows
    nodes, slots, measured = layout.nodes, layout.slots, layout.rows.measured
    factors, sums, slot_poses = out.factors, out.sums, out.slot_poses
    most = 1
    for b in range(blocks.shape[0]):
        most = max(most, blocks[b, 1])
    lanes = layout.nodes.shape[1]
    linear, couplings = np.empty((most, LINEAR)), np.empty((most, 9 * _W))
    seen_from, node, numbers = np.empty(5 * lanes), np.empty(3 * lanes), np.empty(9 * lanes)
    cost = decrease = 0.0
    definite = True
    for w in range(windows.shape[0]):
        _place_submaps(poses, rotations, layout, w, slot_poses)
        for slot in range(windows[w, 2], windows[w, 3]):
            for c in range(9):
                sums[slot, c] = 0.0
        for b in range(windows[w, 0], windows[w, 1]):
            first, num_rows = blocks[b, 0], blocks[b, 1]
            _place_nodes(poses, num_submaps, nodes, b, node)
            linearize_rows(node, slot_poses, slots, measured, first, num_rows, seen_from, linear, 0)
            cost += weigh_rows(rows, first, num_rows, blocks[b, 2], losses, linear, 0)
            if not (eliminate and definite):
                continue
            if not _factor(linear, num_rows, damping, numbers, factors, b):
                definite = False
                continue
            for i in range(blocks[b, 2]):
                for c in range(6, 9):
                    decrease += 0.5 * factors[b, c * _W + i] ** 2
            _couple_block(linear, layout, b, factors, numbers, couplings, sums)
            _cross_block(couplings, layout, b, numbers, sums)
    return cost, decrease, definite
