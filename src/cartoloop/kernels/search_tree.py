# SPDX-License-Identifier: Apache-2.0
"""The heights of the branch-and-bound tree, eq. (11) and (13): blocks, groups, bounding grids."""

from __future__ import annotations

import math

from cartoloop._jit import kernel
from cartoloop.arrays import CellArray
from cartoloop.kernels.node_bounds import Records
from cartoloop.kernels.search_window import ScanExtent, SearchWindow

MEAN_MOVE = 1.0
"""Mean distance that points move within a group of rotations [blocks].

Larger groups are fewer, but bounded less tightly; this is near the flat optimum of the search time.
The result does not depend on it.
"""

MAX_TURN = 1.0
"""A group turns by no more than this [rad]: the boxes around long arcs would be loose. The result
does not depend on it."""

MAX_TOP_BLOCKS = 5
"""Maximum number of the tree's first nodes, eq. (13), along a side of the window, if the largest
blocks allow it. More of them are scored in vain, fewer are bounded loosely; the result does not
depend on it."""

_ROUNDING = 1e-9
"""Excess over a whole number that is a rounding error; and the smallest divisor."""


@kernel
def grow_tree(
    levels: Records,
    boxes: CellArray,
    window: SearchWindow,
    step: float,
    extent: ScanExtent,
    max_move: int,
    out_heights: Records,
    out_boxes: CellArray,
) -> int:
    """Write the properties of the nodes of each height into `out_heights`; return their number.

    Parameters
    ----------
    levels : of :data:`node_bounds.LEVEL`, shape (num_levels,), for blocks of 1, 2, 4, ...
        translations.
    boxes : int32, shape (num_levels, num_moves): where the first cell of the grid is whose boxes
        are large enough for the block if a point moves by this number of cells.
    window : of the search.
    step : delta_theta of eq. (7) [rad].
    extent : distance of the points from the scan's origin [cells].
    max_move : maximum number of blocks that a point may move within a group.
    out_heights : of :data:`node_bounds.HEIGHT`, shape (num_levels + 1,); `first_group` is not
        written.
    out_boxes : int32, shape (num_levels + 1, num_moves): the rows of `boxes` by height.
    """
    move = 2.0 * math.sin(0.5 * step)  # in a step, of a point at a distance of one
    most = max_move / max(extent.farthest * move, _ROUNDING) + _ROUNDING
    per_cell = min(MEAN_MOVE / max(extent.mean * move, _ROUNDING), most)
    turn = 1.0 + MAX_TURN / step
    widest = 2 * max(window.half_cols, window.half_rows) + 1
    level, block, group, height = 0, 1, 1, 0
    while True:
        out_heights[height]["block"], out_heights[height]["group"] = block, group
        out_heights[height]["shift"] = levels[level]["shift"]
        out_heights[height]["margin"] = levels[level]["margin"]
        out_heights[height]["last_col"] = levels[level]["last_col"]
        out_heights[height]["last_row"] = levels[level]["last_row"]
        out_heights[height]["row_length"] = levels[level]["row_length"]
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
