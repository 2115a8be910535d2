# SPDX-License-Identifier: Apache-2.0
"""Rows of eight constraints: filled from a problem's columns, weights read back."""

from __future__ import annotations

from cartoloop._jit import kernel
from cartoloop.arrays import FloatArray, IntArray
from cartoloop.kernels.pose_adjustment.layout import LANES, Layout


@kernel
def fill_rows(
    ids: IntArray,
    groups: IntArray,
    tf_a_b: FloatArray,
    informations: FloatArray,
    out_measured: FloatArray,
    out_groups: IntArray,
) -> None:
    """Write measurements and groups of the constraints of rows into the outputs.

    Parameters
    ----------
    ids : int64, shape (num_rows, 8); -1: as the first lane.
    groups, tf_a_b, informations : of all constraints, shapes (n,), (n, 3), (n, 9).
    out_measured : float64, shape (num_rows, 72), see `MEASURED`.
    out_groups : int64, shape (num_rows, 8).
    """
    for row in range(ids.shape[0]):
        for i in range(LANES):
            c = ids[row, i]
            if c < 0:
                c = ids[row, 0]
            out_groups[row, i] = groups[c]
            for k in range(3):
                out_measured[row, i + k * LANES] = tf_a_b[c, k]
                out_measured[row, i + (3 + k) * LANES] = informations[c, k]
            out_measured[row, i + 6 * LANES] = informations[c, 4]
            out_measured[row, i + 7 * LANES] = informations[c, 5]
            out_measured[row, i + 8 * LANES] = informations[c, 8]


@kernel
def read_weights(layout: Layout, out_weights: FloatArray) -> None:
    """Write the weights of the packed constraints to their places in `out_weights`."""
    windows, blocks = layout.windows, layout.blocks
    ids, weights = layout.rows.ids, layout.rows.weights
    for w in range(windows.shape[0]):
        for b in range(windows[w, 0], windows[w, 1]):
            for row in range(blocks[b, 0], blocks[b, 0] + blocks[b, 1]):
                for i in range(blocks[b, 2]):
                    out_weights[ids[row, i]] = weights[row, i]
