# SPDX-License-Identifier: Apache-2.0
"""The reduced normal equations: blocks of the vertices that are not eliminated.

Kept are the submaps, and the nodes with constraints to other nodes or to the map frame; the other
nodes have been eliminated, see :mod:`cartoloop.kernels.pose_adjustment.elimination`. Blocks are
3 x 3, row by row. Number k of the first `num_kept` is the diagonal block of vertex k, upper half
only; number `num_kept` collects what falls on fixed vertices, and is never read; the others are
blocks (k, l), k < l.
"""

from __future__ import annotations

import math

from cartoloop._jit import kernel
from cartoloop.arrays import FloatArray, IntArray
from cartoloop.kernels.pose_adjustment.layout import LANES, DirectConstraints, Layout

_W = LANES


@kernel
def rotations_of(poses: FloatArray, vertices: IntArray, out_rotations: FloatArray) -> None:
    """Write cosine and sine of the angles of `vertices` into rows of `out_rotations` (n, 2)."""
    for i in range(vertices.size):
        v = vertices[i]
        out_rotations[v, 0] = math.cos(poses[v, 2])
        out_rotations[v, 1] = math.sin(poses[v, 2])


@kernel
def sum_windows(
    layout: Layout,
    slot_blocks: IntArray,
    slots: FloatArray,
    out_blocks: FloatArray,
    out_gradient: FloatArray,
) -> None:
    """Add what windows leave on their submaps to `out_blocks` and `out_gradient`.

    Parameters
    ----------
    slot_blocks : int64, shape (num_slots,), the block of each slot.
    slots : float64, shape (num_slots, 9), of :func:`linearize_windows`.
    out_blocks : float64, shape (num_blocks, 9).
    out_gradient : float64, shape (num_kept + 1, 3).
    """
    windows, slot_ends = layout.windows, layout.slot_ends
    for w in range(windows.shape[0]):
        for s in range(windows[w, 2], windows[w, 3]):
            block = slot_blocks[s]
            if slot_ends[s, 0] != slot_ends[s, 1]:
                for c in range(9):
                    out_blocks[block, c] += slots[s, c]
                continue
            out_blocks[block, 0] += slots[s, 0]
            out_blocks[block, 1] += slots[s, 1]
            out_blocks[block, 2] += slots[s, 2]
            out_blocks[block, 4] += slots[s, 3]
            out_blocks[block, 5] += slots[s, 4]
            out_blocks[block, 8] += slots[s, 5]
            for c in range(3):
                out_gradient[block, c] += slots[s, 6 + c]


@kernel
def add_direct(
    direct: DirectConstraints,
    row_of_vertex: IntArray,
    edge_blocks: IntArray,
    out_blocks: FloatArray,
    out_gradient: FloatArray,
) -> None:
    """Add the models of the direct constraints to `out_blocks` and `out_gradient`.

    Parameters
    ----------
    row_of_vertex : int64, shape (num_vertices,), row in the reduced system.
    edge_blocks : int64, shape (n,), the block between the two ends of each.
    out_blocks : float64, shape (num_blocks, 9).
    out_gradient : float64, shape (num_kept + 1, 3).
    """
    vertex_a, vertex_b, linear = direct.vertex_a, direct.vertex_b, direct.linear
    for e in range(vertex_a.size):
        a, b = row_of_vertex[vertex_a[e]], row_of_vertex[vertex_b[e]]
        slot = edge_blocks[e]
        m, i = linear[e // _W], e % _W
        dx, dy = m[i], m[_W + i]
        bx, by, bt = m[2 * _W + i], m[3 * _W + i], m[4 * _W + i]
        xx, xy, xt = m[5 * _W + i], m[6 * _W + i], m[7 * _W + i]
        yy, yt, tt = m[8 * _W + i], m[9 * _W + i], m[10 * _W + i]
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
