# SPDX-License-Identifier: Apache-2.0
"""What the nodes of the branch-and-bound tree stand for at each height, eq. (11) and (13)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from cartoloop._jit import kernel
from cartoloop.kernels.node_bounds import BLOCK, GROUP, SHIFT

CellArray = NDArray[np.int32]
FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

MEAN_MOVE = 1.0
"""By so many blocks the points move on average within a group of rotations.

Larger groups are fewer, but bounded less tightly; this is near the flat optimum.
"""

MAX_TURN = 1.0
"""A group turns by no more than this [rad]: the boxes around long arcs would be loose."""

MAX_TOP_BLOCKS = 5
"""The tree's first nodes, eq. (13), are at most so many a side, if the largest blocks allow it."""

_ROUNDING = 1e-9


@kernel
def grow_tree(
    levels: IntArray,
    boxes: CellArray,
    window: IntArray,
    step: float,
    extent: FloatArray,
    out_heights: IntArray,
    out_boxes: CellArray,
) -> int:
    """Write what the nodes of each height stand for into `out_heights`; return how many there are.

    Parameters
    ----------
    levels : int64, shape (num_levels, 5), for blocks of 1, 2, 4, ... translations, the grids that
        bound them: binary logarithm of the stride, margin, last column and row, length of a row.
    boxes : int32, shape (num_levels, num_moves): where the first cell of the grid is whose boxes
        are large enough for the block if a point moves by so many cells.
    window : int64, (w_x, w_y, w_theta) of eq. (8).
    step : delta_theta of eq. (7) [rad].
    extent : float64, mean and largest distance of the points from the scan's origin [cells]; by how
        many blocks a point may move within a group.
    out_heights : int64, shape (num_levels + 1, 8), see :func:`branch_and_bound.explore`; the last
        column is left alone.
    out_boxes : int32, shape (num_levels + 1, num_moves): the rows of `boxes` by height.
    """
    move = 2.0 * math.sin(0.5 * step)  # in a step, of a point at a distance of one
    most = extent[2] / max(extent[1] * move, _ROUNDING) + _ROUNDING
    per_cell = min(MEAN_MOVE / max(extent[0] * move, _ROUNDING), most)
    turn = 1.0 + MAX_TURN / step
    widest = 2 * max(window[0], window[1]) + 1
    level, block, group, height = 0, 1, 1, 0
    while True:
        out_heights[height, BLOCK], out_heights[height, GROUP] = block, group
        for k in range(levels.shape[1]):
            out_heights[height, SHIFT + k] = levels[level, k]
        for k in range(boxes.shape[1]):
            out_boxes[height, k] = boxes[level, k]
        height += 1
        if height == 1:
            # Single translations are first bounded for a few rotations at once, if any fit.
            first_group = int(min(per_cell + 0.5, most, turn))
            if first_group > 1:
                group, per_cell = first_group, float(first_group)
                continue
        if widest <= MAX_TOP_BLOCKS * block or level + 1 == levels.shape[0]:
            return height
        level, block = level + 1, 2 * block
        if 2 * group <= min(per_cell * block, turn):
            group *= 2
