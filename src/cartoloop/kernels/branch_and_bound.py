# SPDX-License-Identifier: Apache-2.0
"""Branch and bound, algorithm 3 of the paper, in rotations as well as in translations; exact.

A node of the search tree is a block of 2^h x 2^h translations, eq. (11), for a *group* of
neighbouring rotations rather than for a single one; see :mod:`cartoloop.kernels.node_bounds` for
what bounds it. Translations are counted from the window's first one in cells, rotations likewise in
steps of eq. (7).

A node's *key* orders the search and decides ties: its bound first, then nearness to the estimate
(the squared distance in steps), so that of equal scores the nearest to the estimate wins, and of
equally near ones the first in rotation, row, column. The key of a node is never below that of its
candidates.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cartoloop._jit import kernel
from cartoloop.kernels.node_bounds import (
    BLOCK,
    COL,
    FIRST_GROUP,
    GROUP,
    KEY,
    REST,
    ROTATION,
    ROW,
    STEP,
    ByteArray,
    CellArray,
    FloatArray,
    IntArray,
    place_points,
    score_children,
)
from cartoloop.kernels.search_tree import grow_tree

_POINTS = 40  # in a block, at most: partial sums are looked at after each block
_LANES = 8  # of a vector register
_CHILDREN = 8  # four translations, two halves of the rotations
_NEAR = 28  # bits of a key that tell how near the estimate


@kernel
def distance_from_zero(first: int, size: int) -> int:
    """Return the least absolute value among the whole numbers first ... first + size - 1."""
    return max(first, -(first + size - 1), 0)


@kernel
def node_key(
    bound: int, col: int, row: int, rotation: int, block: int, group: int, window: IntArray
) -> int:
    """Return the key of a node: an upper bound of the keys of its candidates."""
    x = distance_from_zero(col - window[0], block)
    y = distance_from_zero(row - window[1], block)
    turn = distance_from_zero(rotation - window[2], group)
    far = (1 << _NEAR) - 1
    return (bound << _NEAR) + far - min(x * x + y * y + turn * turn, far)


@kernel
def order_by_key(nodes: IntArray, first: int, count: int) -> IntArray:
    """Return the indices of `count` nodes from `first` on, the largest key first (Shell's sort)."""
    order = np.arange(first, first + count)
    gap = 1
    while gap < count // 3:
        gap = 3 * gap + 1
    while gap > 0:
        for i in range(gap, count):
            moving = order[i]
            j = i
            while j >= gap and nodes[order[j - gap], KEY] < nodes[moving, KEY]:
                order[j] = order[j - gap]
                j -= gap
            order[j] = moving
        gap //= 3
    return order


@kernel
def most_promising(nodes: IntArray, first: int, count: int, least_key: int) -> int:
    """Return which of `count` nodes has the largest key, -1 if none reaches `least_key` or 0."""
    found, largest = -1, max(least_key, 0)
    for k in range(first, first + count):
        if nodes[k, KEY] >= largest:
            found, largest = k, nodes[k, KEY]
    return found


@kernel
def farthest_from(value: int, first: int, size: int) -> int:
    """Return the largest distance of the whole numbers first ... first + size - 1 from a value."""
    return max(abs(first - value), abs(first + size - 1 - value))


@kernel
def is_near(near: IntArray, col: int, row: int, rotation: int, block: int, group: int) -> bool:
    """Return whether all candidates of a node are near, see :func:`descend`."""
    x, y = farthest_from(near[COL], col, block), farthest_from(near[ROW], row, block)
    turn = farthest_from(near[ROTATION], rotation, group)
    return bool(x * x + y * y <= near[4] and turn <= near[5])


@kernel
def comes_first(key: int, col: int, row: int, rotation: int, best: IntArray) -> bool:
    """Return whether a candidate beats the best one; on equal keys, whether it comes first."""
    if key != best[KEY]:
        return bool(key > best[KEY])
    if rotation != best[ROTATION]:
        return bool(rotation < best[ROTATION])
    if row != best[ROW]:
        return bool(row < best[ROW])
    return bool(col < best[COL])


@kernel
def explore(
    cells: ByteArray,
    heights: IntArray,
    boxes: CellArray,
    points: FloatArray,
    frame: FloatArray,
    window: IntArray,
    cols: CellArray,
    rows: CellArray,
    grids: CellArray,
    is_placed: NDArray[np.bool_],
    index: CellArray,
    sums: IntArray,
    nodes: IntArray,
    num_tiles: int,
    order: IntArray,
    min_sum: int,
    near: IntArray,
    best: IntArray,
) -> int:
    """Cover the window by nodes, or find the best candidate under them by depth-first search.

    One function does both, and in one piece: what they share is run too often to be called.

    Parameters
    ----------
    cells, points, frame, window : see :func:`search`.
    heights : int64, shape (num_heights, 8): of the nodes of each height, from single candidates to
        the tree's top: edge of the block of translations [cells], rotations in a group, and of the
        grids the binary logarithm of their stride [cells], margin, last column, last row, length of
        a row; number of groups at lower heights. From one height to the next blocks and groups
        stay or double, except that the first group is of up to four rotations.
    boxes : int32, shape (num_heights, num_moves): where in `cells` the first cell of the grid is
        whose boxes are large enough for the block if a point moves by so many cells.
    cols, rows, grids, is_placed : where the points are, for each group of rotations of each height
        as :func:`place_points` writes it, and whether that has been done.
    index, sums : see :func:`score_children`.
    nodes : int64, shape (n, REST + num_blocks + 1): _CHILDREN rows for each height but the top one,
        one for the root, then the nodes that cover the window.
    num_tiles : the nodes that cover the window come in tiles of 2 x 2; 0: find the best candidate.
    order : indices of the nodes to descend from, the largest key first.
    min_sum : what a candidate must reach.
    near : int64, (0, column, row, rotation, squared distance [cells], rotations): candidates within
        both are not sought; the distance is negative if all are.
    best : int64, shape (4,): key, column, row, rotation; the key is -1 if there is none.

    Returns
    -------
    How many nodes cover the window.
    """
    top = heights.shape[0] - 1
    root = top * _CHILDREN
    edge = 2 * heights[top, BLOCK]
    tile_cols, tile_rows = 2 * window[0] // edge + 1, 2 * window[1] // edge + 1
    waiting = np.zeros(top + 1, dtype=np.int64)
    num_places = cols.size // is_placed.size
    last = sums.shape[0] - 1
    least, least_key = min_sum, -1
    height, cursor, end = top, 0, root + 1
    while True:
        if num_tiles > 0:  # the next four nodes that cover the window, children of the root
            if cursor == num_tiles:
                return int(end - root - 1)
            parent, child_height, step = root, top, edge // 2
            nodes[root, COL] = cursor % tile_cols * edge
            nodes[root, ROW] = cursor // tile_cols % tile_rows * edge
            begin_group = cursor // (tile_cols * tile_rows)
            end_group = begin_group + 1
            cursor += 1
        else:
            if height == top:
                if cursor == order.size or nodes[order[cursor], KEY] < least_key:
                    return 0
                parent = order[cursor]
                cursor += 1
            else:
                parent = most_promising(nodes, height * _CHILDREN, int(waiting[height]), least_key)
                if parent < 0:
                    height += 1
                    continue
            key, col, row = nodes[parent, KEY], nodes[parent, COL], nodes[parent, ROW]
            group = nodes[parent, ROTATION]
            if height < top:
                nodes[parent, KEY] = -1
            block, size = heights[height, BLOCK], heights[height, GROUP]
            if near[4] >= 0 and is_near(near, col, row, group * size, block, size):
                continue
            if height == 0:
                if comes_first(key, col, row, group, best):
                    best[KEY], best[COL], best[ROW], best[ROTATION] = key, col, row, group
                    least, least_key = max(min_sum, key >> _NEAR), key
                continue
            child_height = height - 1
            step = heights[child_height, BLOCK] if heights[child_height, BLOCK] < block else 0
            split = size // heights[child_height, GROUP]
            begin_group = group * split
            num_groups = heights[height, FIRST_GROUP] - heights[child_height, FIRST_GROUP]
            end_group = min(begin_group + split, num_groups)
            end = child_height * _CHILDREN
        block, size = heights[child_height, BLOCK], heights[child_height, GROUP]
        num_children = 4 if step > 0 else 1
        first_col, first_row = nodes[parent, COL], nodes[parent, ROW]
        for group in range(begin_group, end_group):
            number = heights[child_height, FIRST_GROUP] + group
            if not is_placed[number]:
                is_placed[number] = True
                place_points(
                    heights, boxes, points, frame, window, child_height, group,
                    number * num_places, cols, rows, grids,
                )  # fmt: skip
            if not score_children(
                cells, heights, child_height, cols, rows, grids, number * num_places,
                points.shape[0], first_col - window[0], first_row - window[1], step,
                nodes, parent, least, index, sums,
            ):  # fmt: skip
                continue
            for child in range(num_children):
                bound = sums[last, child]
                col, row = first_col + step * (child & 1), first_row + step * (child >> 1)
                if bound < least or col > 2 * window[0] or row > 2 * window[1]:
                    continue
                key = node_key(bound, col, row, group * size, block, size, window)
                if key < least_key:
                    continue
                nodes[end, KEY], nodes[end, COL], nodes[end, ROW], nodes[end, ROTATION] = (
                    key,
                    col,
                    row,
                    group,
                )
                nodes[end, REST] = bound
                for i in range(last + 1):
                    nodes[end, REST + i + 1] = bound - sums[i, child]
                end += 1
        if num_tiles == 0:
            height = child_height
            waiting[height] = end - height * _CHILDREN


@kernel
def search(
    cells: ByteArray,
    levels: IntArray,
    level_boxes: CellArray,
    points: FloatArray,
    frame: FloatArray,
    window: IntArray,
    extent: FloatArray,
    min_sum: int,
    away: IntArray,
    out_matches: IntArray,
) -> None:
    """Write the best candidate of a window, and the best one away from it, into `out_matches`.

    Parameters
    ----------
    cells : uint8, shape (n,): grids of maxima, see :mod:`cartoloop.kernels.precomputation_grid`.
    levels, level_boxes, extent : where these grids are, how far the points reach: `levels`, `boxes`
        and `extent` of :func:`grow_tree`.
    points : float64, shape (n, 2), scan frame [m]; n > 0.
    frame : float64, (x, y, theta of the estimate, origin_x, origin_y, resolution, rotation step).
    window : int64, (w_x, w_y, w_theta) of eq. (8).
    min_sum : sum of cell values that a candidate must reach.
    away : int64, (squared distance [cells], rotations, depth): what counts as away from the best;
        how far its sum may be below the best one's, negative if it is not sought.
    out_matches : int64, shape (2, 4): sum, column, row, rotation, from the window's first candidate
        on; the sum is -1 where there is none.
    """
    heights = np.empty((levels.shape[0] + 1, FIRST_GROUP + 1), dtype=np.int64)
    boxes = np.empty((levels.shape[0] + 1, level_boxes.shape[1]), dtype=np.int32)
    num_heights = grow_tree(levels, level_boxes, window, frame[STEP], extent, heights, boxes)
    heights = heights[:num_heights]
    num_points = points.shape[0]
    # Up to _POINTS, in whole vector registers; not a constant, as short constant loops are
    # unrolled, which keeps them from becoming vector instructions.
    num_blocks = (num_points + _POINTS - 1) // _POINTS
    size = (num_points // num_blocks // _LANES + 1) * _LANES
    num_blocks = (num_points + size - 1) // size
    num_groups = 0
    for height in range(heights.shape[0]):
        heights[height, FIRST_GROUP] = num_groups
        num_groups += (2 * window[2] + heights[height, GROUP]) // heights[height, GROUP]
    num_places = num_groups * num_blocks * size
    cols, rows = np.empty(num_places, dtype=np.int32), np.empty(num_places, dtype=np.int32)
    grids = np.empty(num_places, dtype=np.int32)
    is_placed = np.zeros(num_groups, dtype=np.bool_)
    index = np.empty(size, dtype=np.int32)
    sums = np.zeros((num_blocks, 4), dtype=np.int64)
    top = heights.shape[0] - 1
    edge = 2 * heights[top, BLOCK]
    num_tiles = (2 * window[0] // edge + 1) * (2 * window[1] // edge + 1)
    num_tiles *= num_groups - heights[top, FIRST_GROUP]
    root = top * _CHILDREN
    nodes = np.empty((root + 1 + 4 * num_tiles, REST + num_blocks + 1), dtype=np.int64)
    for i in range(num_blocks + 1):
        nodes[root, REST + i] = 255 * max(num_points - i * size, 0)
    near = np.full(6, -1, dtype=np.int64)
    best = np.full(4, -1, dtype=np.int64)
    order = np.zeros(0, dtype=np.int64)
    count = 0
    for match in range(-1, 2):
        count += explore(
            cells, heights, boxes, points, frame, window, cols, rows, grids, is_placed, index, sums,
            nodes, num_tiles if match < 0 else 0, order, min_sum, near, best,
        )  # fmt: skip
        if match < 0:
            order = order_by_key(nodes, root + 1, count)
            continue
        out_matches[match, 0] = best[KEY] >> _NEAR
        for k in range(1, 4):
            out_matches[match, k] = best[k]
        for k in range(4):
            near[k] = best[k]
        near[4], near[5] = away[0], away[1]
        if best[KEY] < 0 or away[2] < 0:
            out_matches[1, 0] = -1
            return
        min_sum = max(min_sum, out_matches[0, 0] - away[2])
        best[KEY] = -1
