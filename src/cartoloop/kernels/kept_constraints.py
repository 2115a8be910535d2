# SPDX-License-Identifier: Apache-2.0
"""The normal equations that pose adjustment solves: blocks of the vertices that are kept.

Kept are the submaps, and the nodes that are tied to other nodes; the other nodes have been
eliminated, see :mod:`cartoloop.kernels.node_elimination`. Blocks are 3 x 3, row by row. Number k of
the first `num_kept` is the diagonal block of vertex k, upper half only; number `num_kept` belongs
to the vertices that are held, and is never read; the others are blocks (k, l), k < l.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from cartoloop._jit import kernel

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


@kernel
def rotations_of(poses: FloatArray, vertices: IntArray, out_rotations: FloatArray) -> None:
    """Write cosine and sine of the angles of `vertices` into rows of `out_rotations` (n, 2)."""
    for i in range(vertices.size):
        v = vertices[i]
        out_rotations[v, 0] = math.cos(poses[v, 2])
        out_rotations[v, 1] = math.sin(poses[v, 2])


@kernel
def fill_rows(
    constraints: IntArray,
    relative_poses: FloatArray,
    informations: FloatArray,
    out_rows: FloatArray,
) -> None:
    """Write constraints (n,) of a graph into the rows (n, 9) that the pose kernels read.

    Parameters
    ----------
    relative_poses, informations : float64, shapes (num_constraints, 3), (num_constraints, 9).
    """
    for i in range(constraints.size):
        c = constraints[i]
        for k in range(3):
            out_rows[i, k] = relative_poses[c, k]
            out_rows[i, 3 + k] = informations[c, k]
        out_rows[i, 6] = informations[c, 4]
        out_rows[i, 7] = informations[c, 5]
        out_rows[i, 8] = informations[c, 8]


@kernel
def move_vertices(
    poses: FloatArray, vertices: IntArray, steps: FloatArray, out_poses: FloatArray
) -> None:
    """Write the poses of `vertices` (n,) after `steps` (n or more, 3) into `out_poses`."""
    for k in range(vertices.size):
        for c in range(3):
            out_poses[vertices[k], c] = poses[vertices[k], c] + steps[k, c]


@kernel
def sum_windows(
    windows: IntArray,
    slot_ends: IntArray,
    slot_blocks: IntArray,
    slots: FloatArray,
    out_blocks: FloatArray,
    out_gradient: FloatArray,
) -> None:
    """Add what windows leave on their submaps to `out_blocks` and `out_gradient`.

    Parameters
    ----------
    windows, slot_ends : int64, see :func:`pack_windows`.
    slot_blocks : int64, shape (num_slots,), the block of each slot.
    slots : float64, shape (num_slots, 9), of :func:`linearize_windows`.
    out_blocks : float64, shape (num_blocks, 9).
    out_gradient : float64, shape (num_kept + 1, 3).
    """
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
