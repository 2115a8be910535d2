# SPDX-License-Identifier: Apache-2.0
"""The order of nodes and candidates in branch and bound.

A node's *key* orders the search and breaks a tie: its bound first, then nearness to the estimate
(the squared distance in steps), so that of equal scores the nearest to the estimate wins, and of
equally near ones the first in rotation, row, column. The key of a node is never below that of its
candidates. ::

    bit 63            28 27                                    0
        [ bound or sum  ][ 2^28 - 1 - squared distance in steps ]
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cartoloop._jit import borrowing_kernel, kernel
from cartoloop.arrays import FloatArray, IntArray
from cartoloop.kernels.node_bounds import COL, KEY, ROTATION, ROW
from cartoloop.kernels.search_window import SearchWindow

NEAR_BITS = 28
"""Bits of a key that hold the nearness to the estimate."""


class Excluded(NamedTuple):
    """Candidates that are not searched for: those near another one, both in place and rotation.

    Attributes
    ----------
    col, row, rotation : the other candidate.
    squared_distance : [cells^2]; negative: nothing is excluded.
    num_rotations : [rotation steps].
    """

    col: int
    row: int
    rotation: int
    squared_distance: int
    num_rotations: int


@borrowing_kernel
def distance_from_zero(first: int, size: int) -> int:
    """Return the least absolute value among the whole numbers first ... first + size - 1."""
    return max(first, -(first + size - 1), 0)


@borrowing_kernel
def node_key(
    bound: int, col: int, row: int, rotation: int, block: int, group: int, window: SearchWindow
) -> int:
    """Return the key of a node: an upper bound of the keys of its candidates."""
    x = distance_from_zero(col - window.half_cols, block)
    y = distance_from_zero(row - window.half_rows, block)
    turn = distance_from_zero(rotation - window.half_rotations, group)
    far = (1 << NEAR_BITS) - 1
    return (bound << NEAR_BITS) + far - min(x * x + y * y + turn * turn, far)


@kernel
def order_by_key(nodes: IntArray | FloatArray, first: int, count: int) -> IntArray:
    """Return the indices of `count` nodes from `first` on, the largest key first (Shell's sort).

    Parameters
    ----------
    nodes : shape (m, k), with the keys in the first column.
    """
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


@borrowing_kernel
def most_promising(nodes: IntArray, first: int, count: int, min_key: int) -> int:
    """Return which of `count` nodes has the largest key, -1 if none reaches `min_key` or 0."""
    found, largest = -1, max(min_key, 0)
    for k in range(first, first + count):
        if nodes[k, KEY] >= largest:
            found, largest = k, nodes[k, KEY]
    return found


@borrowing_kernel
def farthest_from(value: int, first: int, size: int) -> int:
    """Return the largest distance of the whole numbers first ... first + size - 1 from a value."""
    return max(abs(first - value), abs(first + size - 1 - value))


@borrowing_kernel
def is_excluded(
    excluded: Excluded, col: int, row: int, rotation: int, block: int, group: int
) -> bool:
    """Return whether all candidates of a node are excluded."""
    if excluded.squared_distance < 0:
        return False
    x, y = farthest_from(excluded.col, col, block), farthest_from(excluded.row, row, block)
    turn = farthest_from(excluded.rotation, rotation, group)
    return bool(x * x + y * y <= excluded.squared_distance and turn <= excluded.num_rotations)


@borrowing_kernel
def comes_first(key: int, col: int, row: int, rotation: int, best: IntArray) -> bool:
    """Return whether a candidate beats the best one; on equal keys, whether it comes first."""
    if key != best[KEY]:
        return bool(key > best[KEY])
    if rotation != best[ROTATION]:
        return bool(rotation < best[ROTATION])
    if row != best[ROW]:
        return bool(row < best[ROW])
    return bool(col < best[COL])
