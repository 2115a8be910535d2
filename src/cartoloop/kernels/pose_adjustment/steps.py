# SPDX-License-Identifier: Apache-2.0
"""Steps of the vertices: of the eliminated nodes once those of the submaps are known (V-A).

With the notation of :mod:`cartoloop.kernels.pose_adjustment.elimination`, a node moves by
L^-T (v + L^-1 sum_i A_i T_i s_i).
"""

from __future__ import annotations

import numpy as np

from cartoloop._jit import kernel
from cartoloop.arrays import FloatArray, IntArray
from cartoloop.kernels.pose_adjustment.layout import LANES, Layout

_W = LANES


@kernel
def _step_block(
    poses: FloatArray,
    num_submaps: int,
    slot_places: FloatArray,
    layout: Layout,
    b: int,
    factors: FloatArray,
    node: FloatArray,
    submap: FloatArray,
    out_steps: FloatArray,
) -> None:
    """Write the steps of the nodes of block b into `out_steps` (24,).

    `slot_places` (num_slots, 7) has x, y, cosine and sine of theta, and the step, of submaps;
    `node` (16,) and `submap` (56,) are scratch.
    """
    blocks, nodes, slots = layout.blocks, layout.nodes, layout.slots
    measured, weights = layout.rows.measured, layout.rows.weights
    for i in range(_W):
        vertex = num_submaps + nodes[b, i]
        node[i], node[_W + i] = poses[vertex, 0], poses[vertex, 1]
        for c in range(3):
            out_steps[c * _W + i] = 0.0
    for row in range(blocks[b, 0], blocks[b, 0] + blocks[b, 1]):
        for i in range(_W):
            slot = slots[row, i]
            for c in range(7):
                submap[c * _W + i] = slot_places[slot, c]
        for i in range(node.size // 2):
            dx, dy = node[i] - submap[i], node[_W + i] - submap[_W + i]
            cos_a, sin_a = submap[2 * _W + i], submap[3 * _W + i]
            st = submap[6 * _W + i]
            sx, sy = submap[4 * _W + i] - dy * st, submap[5 * _W + i] + dx * st
            # the vector is rotated into the frame of the submap and back, not the matrix
            ux, uy = cos_a * sx + sin_a * sy, cos_a * sy - sin_a * sx
            xy, xt = measured[row, 4 * _W + i], measured[row, 5 * _W + i]
            yt, weight = measured[row, 7 * _W + i], weights[row, i]
            px = weight * (measured[row, 3 * _W + i] * ux + xy * uy + xt * st)
            py = weight * (xy * ux + measured[row, 6 * _W + i] * uy + yt * st)
            pt = weight * (xt * ux + yt * uy + measured[row, 8 * _W + i] * st)
            out_steps[i] += cos_a * px - sin_a * py
            out_steps[_W + i] += sin_a * px + cos_a * py
            out_steps[2 * _W + i] += pt
    for i in range(node.size // 2):
        i0, l1, l2 = factors[b, i], factors[b, _W + i], factors[b, 2 * _W + i]
        i1, l21, i2 = factors[b, 3 * _W + i], factors[b, 4 * _W + i], factors[b, 5 * _W + i]
        px = out_steps[i] * i0
        py = (out_steps[_W + i] - l1 * px) * i1
        pt = (out_steps[2 * _W + i] - l2 * px - l21 * py) * i2
        st = (pt + factors[b, 8 * _W + i]) * i2
        sy = (py + factors[b, 7 * _W + i] - l21 * st) * i1
        out_steps[i] = (px + factors[b, 6 * _W + i] - l1 * sy - l2 * st) * i0
        out_steps[_W + i] = sy
        out_steps[2 * _W + i] = st


@kernel
def move_nodes(
    poses: FloatArray,
    rotations: FloatArray,
    submap_steps: FloatArray,
    layout: Layout,
    factors: FloatArray,
    out_poses: FloatArray,
) -> None:
    """Write the poses of the packed nodes into `out_poses`, after the step that follows.

    Parameters
    ----------
    poses : float64, shape (num_vertices, 3), where :func:`linearize_windows` wrote the weights and
        `factors`.
    rotations : float64, shape (num_vertices, 2), cosine and sine of the angles of the submaps.
    submap_steps : float64, shape (num_submaps, 3).
    out_poses : float64, shape (num_vertices, 3).
    """
    windows, blocks, nodes, slot_ends = (
        layout.windows,
        layout.blocks,
        layout.nodes,
        layout.slot_ends,
    )
    lanes, num_submaps = nodes.shape[1], submap_steps.shape[0]
    node, submap, steps = np.empty(2 * lanes), np.empty(7 * lanes), np.empty(3 * lanes)
    slot_places = np.empty((slot_ends.shape[0], 7))
    for w in range(windows.shape[0]):
        for slot in range(windows[w, 2], windows[w, 3]):
            a = slot_ends[slot, 0]
            if a == slot_ends[slot, 1]:
                for c in range(2):
                    slot_places[slot, c] = poses[a, c]
                    slot_places[slot, 2 + c] = rotations[a, c]
                for c in range(3):
                    slot_places[slot, 4 + c] = submap_steps[a, c]
        for b in range(windows[w, 0], windows[w, 1]):
            _step_block(poses, num_submaps, slot_places, layout, b, factors, node, submap, steps)
            for i in range(blocks[b, 2]):
                v = num_submaps + nodes[b, i]
                for c in range(3):
                    out_poses[v, c] = poses[v, c] + steps[c * _W + i]


@kernel
def move_vertices(
    poses: FloatArray, vertices: IntArray, steps: FloatArray, out_poses: FloatArray
) -> None:
    """Write the poses of `vertices` (n,) after `steps` (n or more, 3) into `out_poses`."""
    for k in range(vertices.size):
        for c in range(3):
            out_poses[vertices[k], c] = poses[vertices[k], c] + steps[k, c]
