# SPDX-License-Identifier: Apache-2.0
"""Branch and bound, algorithm 3 of the paper, in rotations as well as in translations; exact.

A node of the search tree is a block of 2^h x 2^h translations, eq. (11), for a *group* of
neighbouring rotations, not for a single one. :mod:`cartoloop.kernels.node_bounds` has its bound,
:mod:`cartoloop.kernels.search_window` the numbers of candidates, and
:mod:`cartoloop.kernels.search_order` the *key* of a node, which orders the search.

All nodes stand in one array, `nodes`. Each height but the top one has _CHILDREN rows for the
children of the node that is being expanded above it; then comes the root, which stands for the
whole window, and the nodes that cover the window, eq. (13). A row holds a node and what its bound
leaves to the points from each block of points on::

    row                                     column
    0                     height 0          KEY  COL  ROW  ROTATION  REST  REST + 1  ...
    _CHILDREN             height 1           |    |    |      |        |       |
    ...                                     key  first    group of   sum of  sum from the second
    top * _CHILDREN       root                   translation rotations  all   block of points on
    top * _CHILDREN + 1   nodes that cover the window

Where the points of a group of rotations look up their maxima is computed once for each group of
each height, at its first use, and kept in `places`: the groups of height h are there from
``heights[h]["first_group"]`` on, each with `num_places` entries (whole blocks of points).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cartoloop._jit import borrowing_kernel, inlined_kernel, kernel
from cartoloop.arrays import BoolArray, ByteArray, CellArray, FloatArray, IntArray
from cartoloop.kernels.node_bounds import (
    COL,
    HEIGHT,
    KEY,
    REST,
    ROTATION,
    ROW,
    Children,
    PlacedScan,
    Places,
    Records,
    place_points,
    score_children,
)
from cartoloop.kernels.precomputation_grid import GridArrays
from cartoloop.kernels.search_order import (
    NEAR_BITS,
    Excluded,
    comes_first,
    is_excluded,
    most_promising,
    node_key,
    order_by_key,
)
from cartoloop.kernels.search_tree import grow_tree
from cartoloop.kernels.search_window import ScanExtent, SearchFrame, SearchWindow

_POINTS = 40
"""Maximum number of points in a block: partial sums are compared with the threshold after each."""

_LANES = 8
"""Entries of a vector register, int32: blocks of points are multiples of it."""

_CHILDREN = 8
"""Maximum number of children of a node: four translations, two halves of the rotations. (The first
group, of up to four rotations, has single translations, which are not divided.)"""

_MAX_CELL = 255
"""Largest cell value."""


class Elsewhere(NamedTuple):
    """Which candidates can be runner-up.

    Attributes
    ----------
    squared_distance, num_rotations : candidates within both of the best one are in the same place
        [cells^2], [rotation steps].
    max_gap : how far its sum may be below that of the best one; negative: no runner-up is searched
        for.
    min_sum : what its sum must reach. It may be less than what the best one must reach.
    """

    squared_distance: int
    num_rotations: int
    max_gap: int
    min_sum: int


class Search(NamedTuple):
    """The inputs and the memory of one search; the arrays' layout is drawn above.

    Attributes
    ----------
    cells : uint8, shape (n,), the precomputed grids.
    heights : of :data:`node_bounds.HEIGHT`, shape (num_heights,), from single candidates to the
        tree's top. From one height to the next blocks and groups stay or double, except that the
        first group is of up to four rotations.
    scan : the scan, with where its points look up their maxima.
    window : of the search.
    is_placed : bool, shape (num_groups,): whether the places of a group are computed.
    indices : int32, scratch, an entry for each point of a block.
    sums : int64, shape (num_blocks, 4), scratch, see :func:`score_children`.
    nodes : int64, shape (m, REST + num_blocks + 1).
    num_waiting : int64, shape (num_heights,), scratch: children to be expanded, by height.
    """

    cells: ByteArray
    heights: Records
    scan: PlacedScan
    window: SearchWindow
    is_placed: BoolArray
    indices: CellArray
    sums: IntArray
    nodes: IntArray
    num_waiting: IntArray


class Branch(NamedTuple):
    """A node to be expanded, all scalars.

    Attributes
    ----------
    parent : its row in `nodes`.
    height, begin_group, end_group : of its children.
    step : from one block of translations to the next [cells]; 0: the block is not divided.
    min_sum, min_key : what a candidate must reach.
    end : row in `nodes` where the first child is written.
    """

    parent: int
    height: int
    begin_group: int
    end_group: int
    step: int
    min_sum: int
    min_key: int
    end: int


@inlined_kernel
def push_children(
    cells: ByteArray,
    heights: Records,
    cols: CellArray,
    rows: CellArray,
    boxes: CellArray,
    scan: PlacedScan,
    window: SearchWindow,
    branch: Branch,
    is_placed: BoolArray,
    indices: CellArray,
    sums: IntArray,
    nodes: IntArray,
) -> int:
    """Append the children of a node that can hold the best candidate to `nodes`; return its end.

    Parameters
    ----------
    cells, heights, scan, window, is_placed, indices, sums, nodes : of :class:`Search`.
    cols, rows, boxes : of ``scan.places``.
    branch : the node, and which children.
    """
    parent, height, step, end = branch.parent, branch.height, branch.step, branch.end
    block, size = heights[height]["block"], heights[height]["group"]
    num_places = cols.size // is_placed.size
    last = sums.shape[0] - 1
    first_col, first_row = nodes[parent, COL], nodes[parent, ROW]
    left, below = first_col - window.half_cols, first_row - window.half_rows
    children = Children(parent, height, left, below, step)
    for group in range(branch.begin_group, branch.end_group):
        number = heights[height]["first_group"] + group
        if not is_placed[number]:
            is_placed[number] = True
            place_points(heights, scan, window, height, group, number * num_places)
        if not score_children(
            cells, heights, cols, rows, boxes, number * num_places, scan.num_points, children,
            branch.min_sum, nodes, indices, sums,
        ):  # fmt: skip
            continue
        for child in range(4 if step > 0 else 1):
            bound = sums[last, child]
            col, row = first_col + step * (child & 1), first_row + step * (child >> 1)
            if bound < branch.min_sum or col > 2 * window.half_cols or row > 2 * window.half_rows:
                continue
            key = node_key(bound, col, row, group * size, block, size, window)
            if key < branch.min_key:
                continue
            nodes[end, KEY], nodes[end, COL], nodes[end, ROW] = key, col, row
            nodes[end, ROTATION], nodes[end, REST] = group, bound
            for i in range(last + 1):
                nodes[end, REST + i + 1] = bound - sums[i, child]
            end += 1
    return end


@borrowing_kernel
def cover_window(search: Search, min_sum: int) -> int:
    """Write the nodes that cover the window, eq. (13), behind the root; return their number.

    They are scored in tiles of 2 x 2, as if they were children of the root.
    """
    cells, heights, scan, window = search.cells, search.heights, search.scan, search.window
    cols, rows, boxes = scan.places.cols, scan.places.rows, scan.places.boxes
    is_placed, indices = search.is_placed, search.indices
    sums, nodes = search.sums, search.nodes
    top = heights.shape[0] - 1
    root = top * _CHILDREN
    block = heights[top]["block"]
    edge = 2 * block
    tile_cols = 2 * window.half_cols // edge + 1
    tile_rows = 2 * window.half_rows // edge + 1
    num_groups = is_placed.size - heights[top]["first_group"]
    end = root + 1
    for tile in range(tile_cols * tile_rows * num_groups):
        nodes[root, COL] = tile % tile_cols * edge
        nodes[root, ROW] = tile // tile_cols % tile_rows * edge
        group = tile // (tile_cols * tile_rows)
        branch = Branch(root, top, group, group + 1, block, min_sum, -1, end)
        end = push_children(
            cells, heights, cols, rows, boxes, scan, window, branch, is_placed, indices, sums,
            nodes,
        )  # fmt: skip
    return int(end - root - 1)


@borrowing_kernel
def find_best(
    search: Search,
    order: IntArray,
    min_sum: int,
    max_expanded: int,
    excluded: Excluded,
    best: IntArray,
) -> bool:
    """Write the best candidate, found by depth-first search, into `best`; return whether it is.

    It is not if more nodes would have to be expanded than is allowed.

    Parameters
    ----------
    order : int64, indices of the nodes that cover the window, the largest key first.
    min_sum : what a candidate must reach.
    max_expanded : number of nodes that may be expanded.
    excluded : candidates that do not count.
    best : int64, shape (4,): key, column, row, rotation; the key is -1 if there is none.
    """
    cells, heights, scan, window = search.cells, search.heights, search.scan, search.window
    cols, rows, boxes = scan.places.cols, scan.places.rows, scan.places.boxes
    is_placed, indices = search.is_placed, search.indices
    sums, nodes = search.sums, search.nodes
    top = heights.shape[0] - 1
    num_waiting = search.num_waiting
    best[KEY] = -1
    min_key = -1
    height, cursor, num_expanded = top, 0, 0
    while True:
        if height == top:
            if cursor == order.size:
                return True
            parent = order[cursor]
            if nodes[parent, KEY] < min_key or nodes[parent, REST] < min_sum:
                return True
            cursor += 1
        else:
            parent = most_promising(nodes, height * _CHILDREN, int(num_waiting[height]), min_key)
            if parent < 0:
                height += 1
                continue
        key, col, row = nodes[parent, KEY], nodes[parent, COL], nodes[parent, ROW]
        group = nodes[parent, ROTATION]
        if height < top:
            nodes[parent, KEY] = -1
        block, size = heights[height]["block"], heights[height]["group"]
        if is_excluded(excluded, col, row, group * size, block, size):
            continue
        if height == 0:
            if comes_first(key, col, row, group, best):
                best[KEY], best[COL], best[ROW], best[ROTATION] = key, col, row, group
                min_sum, min_key = max(min_sum, key >> NEAR_BITS), key
            continue
        num_expanded += 1
        if num_expanded > max_expanded:
            return False
        child = height - 1
        step = heights[child]["block"] if heights[child]["block"] < block else 0
        split = size // heights[child]["group"]
        num_groups = heights[height]["first_group"] - heights[child]["first_group"]
        begin, end = group * split, min((group + 1) * split, num_groups)
        first = child * _CHILDREN
        branch = Branch(parent, child, begin, end, step, min_sum, min_key, first)
        last = push_children(
            cells, heights, cols, rows, boxes, scan, window, branch, is_placed, indices, sums,
            nodes,
        )  # fmt: skip
        height = child
        num_waiting[height] = last - first


@kernel
def begin_search(
    grids: GridArrays,
    points: FloatArray,
    frame: SearchFrame,
    window: SearchWindow,
    extent: ScanExtent,
    max_move: int,
) -> Search:
    """Return the tree and the memory of a search, with the root written into `nodes`.

    Parameters are those of :func:`search`.
    """
    heights = np.empty(grids.levels.shape[0] + 1, dtype=HEIGHT)
    boxes = np.empty((grids.levels.shape[0] + 1, grids.boxes.shape[1]), dtype=np.int32)
    num_heights = grow_tree(
        grids.levels, grids.boxes, window, frame.step, extent, max_move, heights, boxes
    )
    heights = heights[:num_heights]
    num_points = points.shape[0]
    # Up to _POINTS, in whole vector registers; not a constant, as short constant loops are
    # unrolled, which keeps them from becoming vector instructions.
    num_blocks = (num_points + _POINTS - 1) // _POINTS
    size = (num_points // num_blocks // _LANES + 1) * _LANES
    num_blocks = (num_points + size - 1) // size
    num_groups = 0
    for height in range(num_heights):
        heights[height]["first_group"] = num_groups
        group = heights[height]["group"]
        num_groups += (2 * window.half_rotations + group) // group
    num_places = num_groups * num_blocks * size
    places = Places(
        np.empty(num_places, dtype=np.int32),
        np.empty(num_places, dtype=np.int32),
        np.empty(num_places, dtype=np.int32),
    )
    top = num_heights - 1
    edge = 2 * heights[top]["block"]
    num_tiles = (2 * window.half_cols // edge + 1) * (2 * window.half_rows // edge + 1)
    num_tiles *= num_groups - heights[top]["first_group"]
    root = top * _CHILDREN
    nodes = np.empty((root + 1 + 4 * num_tiles, REST + num_blocks + 1), dtype=np.int64)
    for i in range(num_blocks + 1):
        nodes[root, REST + i] = _MAX_CELL * max(num_points - i * size, 0)
    return Search(
        grids.cells, heights, PlacedScan(num_points, points, frame, boxes, places), window,
        np.zeros(num_groups, dtype=np.bool_), np.empty(size, dtype=np.int32),
        np.zeros((num_blocks, 4), dtype=np.int64), nodes, np.empty(num_heights, dtype=np.int64),
    )  # fmt: skip


@kernel
def search(
    grids: GridArrays,
    points: FloatArray,
    frame: SearchFrame,
    window: SearchWindow,
    extent: ScanExtent,
    max_move: int,
    min_sum: int,
    max_expanded: int,
    elsewhere: Elsewhere,
    out_matches: IntArray,
) -> None:
    """Write the best candidate of a window, and the runner-up, into `out_matches`.

    Parameters
    ----------
    grids : of the submap.
    points : float64, shape (n, 2), tracking frame [m]; n > 0.
    frame, window : of the search.
    extent : distance of the points from the scan's origin [cells].
    max_move : maximum number of blocks that a point may move within a group of rotations.
    min_sum : sum of cell values that a candidate must reach.
    max_expanded : number of nodes that may be expanded for each of both; beyond, there is no match.
    elsewhere : which candidates can be runner-up.
    out_matches : int64, shape (2, 4): sum, column, row, rotation, of the best candidate and of the
        runner-up; the sum is -1 where there is none.
    """
    state = begin_search(grids, points, frame, window, extent, max_move)
    first = (state.heights.shape[0] - 1) * _CHILDREN + 1
    lowest = min(min_sum, max(elsewhere.min_sum, min_sum - elsewhere.max_gap))
    order = order_by_key(state.nodes, first, cover_window(state, lowest))
    best = np.full(4, -1, dtype=np.int64)
    squared_distance, num_rotations = -1, -1
    for match in range(2):
        excluded = Excluded(best[COL], best[ROW], best[ROTATION], squared_distance, num_rotations)
        if not find_best(state, order, min_sum, max_expanded, excluded, best):
            out_matches[0, 0] = out_matches[1, 0] = -1
            return
        out_matches[match, 0] = best[KEY] >> NEAR_BITS
        for k in range(1, 4):
            out_matches[match, k] = best[k]
        if best[KEY] < 0 or elsewhere.max_gap < 0:
            out_matches[1, 0] = -1
            return
        squared_distance, num_rotations = elsewhere.squared_distance, elsewhere.num_rotations
        min_sum = max(elsewhere.min_sum, out_matches[0, 0] - elsewhere.max_gap)
