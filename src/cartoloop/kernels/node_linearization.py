# SPDX-License-Identifier: Apache-2.0
"""Constraints of nodes as quadratic models, eight nodes at a time (section V-A, eq. SPA).

Number c of eight nodes or constraints is at 8 c to 8 c + 7 of a row of numbers, its *lanes*, see
:mod:`cartoloop.kernels.node_packing`. The compiler turns loops over lanes into vector instructions,
unless it sees that there are only eight turns, and unrolls them: that is why they read the number
of lanes off the size of an array, here and in :mod:`cartoloop.kernels.node_elimination`.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from cartoloop._jit import kernel
from cartoloop.kernels.node_packing import LANES
from cartoloop.kernels.pose_residuals import GIVEN, robust_loss

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

LINEAR = 12 * LANES
"""Numbers of a row of models: d_x, d_y; b (3); A (xx, xy, xt, yy, yt, tt); E^2."""

_TURN = 2.0 * math.pi
_W = LANES


@kernel
def place_submaps(
    poses: FloatArray,
    rotations: FloatArray,
    slot_ends: IntArray,
    first: int,
    last: int,
    out: FloatArray,
) -> None:
    """Write x, y, theta, cosine and sine of the submaps of diagonal slots into rows of `out`."""
    for slot in range(first, last):
        a = slot_ends[slot, 0]
        if a == slot_ends[slot, 1]:
            out[slot, 0] = poses[a, 0]
            out[slot, 1] = poses[a, 1]
            out[slot, 2] = poses[a, 2]
            out[slot, 3] = rotations[a, 0]
            out[slot, 4] = rotations[a, 1]


@kernel
def linearize_block(
    poses: FloatArray,
    num_submaps: int,
    slot_poses: FloatArray,
    blocks: IntArray,
    block_nodes: IntArray,
    b: int,
    slots: IntArray,
    measured: FloatArray,
    node: FloatArray,
    seen_from: FloatArray,
    out_linear: FloatArray,
) -> None:
    """Write the models of the constraints of block b into rows of `out_linear`, the loss left out.

    Parameters
    ----------
    slot_poses : float64, shape (num_slots, 5), of submaps: x, y, theta, cosine and sine of theta.
    node, seen_from : float64, shape (24,), (40,), scratch.
    out_linear : float64, shape (most rows of a block, 96).
    others : see :func:`linearize_windows`.
    """
    for i in range(_W):
        vertex = num_submaps + block_nodes[b, i]
        for c in range(3):
            node[c * _W + i] = poses[vertex, c]
    for k in range(blocks[b, 1]):
        row = blocks[b, 0] + k
        for i in range(_W):
            slot = slots[row, i]
            for c in range(5):
                seen_from[c * _W + i] = slot_poses[slot, c]
        for i in range(node.size // 3):
            cos_a, sin_a = seen_from[3 * _W + i], seen_from[4 * _W + i]
            dx, dy = node[i] - seen_from[i], node[_W + i] - seen_from[_W + i]
            et = measured[row, 2 * _W + i] - (node[2 * _W + i] - seen_from[2 * _W + i])
            et -= _TURN * np.floor((et + math.pi) * (1.0 / _TURN))
            ex = cos_a * measured[row, i] - sin_a * measured[row, _W + i] - dx
            ey = sin_a * measured[row, i] + cos_a * measured[row, _W + i] - dy
            ixx, ixy = measured[row, 3 * _W + i], measured[row, 4 * _W + i]
            ixt, iyy = measured[row, 5 * _W + i], measured[row, 6 * _W + i]
            iyt, tt = measured[row, 7 * _W + i], measured[row, 8 * _W + i]
            cos2, sin2, cross = cos_a * cos_a, sin_a * sin_a, cos_a * sin_a
            xx = cos2 * ixx + sin2 * iyy - 2.0 * cross * ixy
            xy = cross * (ixx - iyy) + (cos2 - sin2) * ixy
            xt = cos_a * ixt - sin_a * iyt
            yy = sin2 * ixx + cos2 * iyy + 2.0 * cross * ixy
            yt = sin_a * ixt + cos_a * iyt
            bx = xx * ex + xy * ey + xt * et
            by = xy * ex + yy * ey + yt * et
            bt = xt * ex + yt * ey + tt * et
            out_linear[k, i] = dx
            out_linear[k, _W + i] = dy
            out_linear[k, 2 * _W + i] = bx
            out_linear[k, 3 * _W + i] = by
            out_linear[k, 4 * _W + i] = bt
            out_linear[k, 5 * _W + i] = xx
            out_linear[k, 6 * _W + i] = xy
            out_linear[k, 7 * _W + i] = xt
            out_linear[k, 8 * _W + i] = yy
            out_linear[k, 9 * _W + i] = yt
            out_linear[k, 10 * _W + i] = tt
            out_linear[k, 11 * _W + i] = ex * bx + ey * by + et * bt


@kernel
def weigh_block(
    blocks: IntArray,
    b: int,
    kinds: IntArray,
    loss_of_kind: IntArray,
    scale: float,
    weights: FloatArray,
    linear: FloatArray,
) -> float:
    """Let the loss act on the models of block b; return their cost.

    `weights` are written, save where they are given. Lanes that only fill up are left alone.
    """
    cost = 0.0
    for k in range(blocks[b, 1]):
        row = blocks[b, 0] + k
        for i in range(blocks[b, 2]):
            loss, squared = loss_of_kind[kinds[row, i]], max(linear[k, 11 * _W + i], 0.0)
            if loss == GIVEN:
                rho, weight = weights[row, i] * squared, weights[row, i]
            else:
                rho, weight = robust_loss(loss, scale, squared)
            weights[row, i] = weight
            cost += 0.5 * rho
            if weight != 1.0:
                for c in range(2, 11):
                    linear[k, c * _W + i] *= weight
    return cost
