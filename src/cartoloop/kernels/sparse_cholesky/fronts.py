# SPDX-License-Identifier: Apache-2.0
"""Symbolic factorization: which fronts the multifrontal Cholesky method works through.

A front belongs to a group of vertices (its pivots) that are eliminated together; its rows are the
later vertices that they are coupled with then, by the system or by what earlier fronts leave.

Within a front the vertices are numbered backwards, the last to be eliminated first: rows, then
pivots. All loops over the lower half of a symmetric matrix then begin at column 0, which is what
the compiler needs to turn them into vector instructions.
"""

from __future__ import annotations

import numpy as np

from cartoloop._jit import kernel
from cartoloop.arrays import IntArray
from cartoloop.kernels.sparse_cholesky.arrays import filled, padded


@kernel
def _sort(values: IntArray, first: int, last: int) -> None:
    """Sort values[first:last] downwards in place (Shell's method: short, without recursion)."""
    gap = 1
    while gap < (last - first) // 3:
        gap = 3 * gap + 1
    while gap > 0:
        for i in range(first + gap, last):
            value = values[i]
            k = i
            while k >= first + gap and values[k - gap] < value:
                values[k] = values[k - gap]
                k -= gap
            values[k] = value
        gap //= 3


@kernel
def front_rows(
    begin: IntArray, neighbours: IntArray, order: IntArray, group_begin: IntArray
) -> tuple[IntArray, IntArray, IntArray]:
    """Return the rows of every front, and the front that each hands its update to.

    Parameters
    ----------
    begin, neighbours : int64, the coupled vertices, see :func:`minimum_degree`.
    order : int64, shape (n,), vertices in their order of elimination.
    group_begin : int64, shape (num_fronts + 1,), positions in it.

    Returns
    -------
    row_begin : int64, shape (num_fronts + 1,).
    rows : int64, positions in `order`, descending within a front, its own pivots not among them.
    parent : int64, shape (num_fronts,), later than the front itself; -1 for none.
    """
    n = order.size
    num_fronts = group_begin.size - 1
    position = np.empty(n, dtype=np.int64)
    front_of = np.empty(n, dtype=np.int64)
    for f in range(num_fronts):
        for i in range(group_begin[f], group_begin[f + 1]):
            position[order[i]] = i
            front_of[i] = f
    row_begin = np.zeros(num_fronts + 1, dtype=np.int64)
    rows = np.empty(neighbours.size + n, dtype=np.int64)
    parent = filled(num_fronts, -1)
    first_child = filled(num_fronts, -1)
    sibling = filled(num_fronts, -1)
    seen_by = filled(n, -1)
    for f in range(num_fronts):
        end = group_begin[f + 1]
        count = row_begin[f]
        if count + n > rows.size:
            grown = np.empty(2 * rows.size + n, dtype=np.int64)
            for i in range(count):
                grown[i] = rows[i]
            rows = grown
        for i in range(group_begin[f], end):
            for k in range(begin[order[i]], begin[order[i] + 1]):
                other = position[neighbours[k]]
                if other >= end and seen_by[other] != f:
                    seen_by[other] = f
                    rows[count] = other
                    count += 1
        child = first_child[f]
        while child >= 0:
            for k in range(row_begin[child], row_begin[child + 1]):
                other = rows[k]
                if other >= end and seen_by[other] != f:
                    seen_by[other] = f
                    rows[count] = other
                    count += 1
            child = sibling[child]
        _sort(rows, row_begin[f], count)
        row_begin[f + 1] = count
        if count > row_begin[f]:
            above = front_of[rows[count - 1]]
            parent[f] = above
            sibling[f] = first_child[above]
            first_child[above] = f
    return row_begin, rows[: row_begin[num_fronts]], parent


@kernel
def _append(target: IntArray, place: int, source: IntArray, first: int, last: int) -> int:
    """Copy source[first:last] to `target` from `place` on; return the place behind it."""
    for i in range(first, last):
        target[place] = source[i]
        place += 1
    return place


@kernel
def merge_small_fronts(
    order: IntArray, group_begin: IntArray, row_begin: IntArray, parent: IntArray, max_zeros: int
) -> tuple[IntArray, IntArray]:
    """Return the order of elimination, regrouped into fewer and larger fronts, children first.

    A front joins its parent if that stores at most `max_zeros` blocks more: many tiny fronts cost
    more in bookkeeping than a few zeros in arithmetic. The new order is a postorder, in which the
    updates that a front takes in are the last ones that were made.

    Parameters
    ----------
    order, group_begin : int64, see :func:`front_rows`, from which `row_begin` and `parent` come.
    max_zeros : int64, blocks.

    Returns
    -------
    order, group_begin : int64, as the parameters.
    """
    num_fronts = parent.size
    head_of = np.empty(num_fronts, dtype=np.int64)  # the front that a front has joined, upwards
    num_pivots = np.empty(num_fronts, dtype=np.int64)
    zeros = np.zeros(num_fronts, dtype=np.int64)
    for f in range(num_fronts):
        head_of[f] = f
        num_pivots[f] = group_begin[f + 1] - group_begin[f]
    for f in range(num_fronts - 1, -1, -1):
        if parent[f] < 0:
            continue
        above = head_of[parent[f]]
        width = row_begin[above + 1] - row_begin[above] + num_pivots[above]
        extra = num_pivots[f] * (width - (row_begin[f + 1] - row_begin[f]))
        if zeros[above] + extra <= max_zeros:
            head_of[f] = above
            num_pivots[above] += num_pivots[f]
            zeros[above] += extra
    # children of each head, linked so that the walk below visits them in ascending order
    first_child = filled(num_fronts + 1, -1)
    sibling = filled(num_fronts, -1)
    member = filled(num_fronts, -1)  # next front of the same group
    for f in range(num_fronts - 1, -1, -1):
        head = head_of[f]
        if head != f:
            member[f] = member[head]
            member[head] = f
            continue
        above = num_fronts if parent[f] < 0 else head_of[parent[f]]
        sibling[f] = first_child[above]
        first_child[above] = f
    new_order = np.empty(order.size, dtype=np.int64)
    new_begin = np.zeros(num_fronts + 1, dtype=np.int64)
    num_groups = 0
    place = 0
    stack = np.empty(num_fronts + 1, dtype=np.int64)
    stack[0] = num_fronts
    depth = 1
    while depth > 0:
        f = stack[depth - 1]
        child = first_child[f]
        if child >= 0:
            first_child[f] = sibling[child]
            stack[depth] = child
            depth += 1
            continue
        depth -= 1
        if f == num_fronts:
            break
        part = member[f]
        while part >= 0:  # members ascend; the head, which is the latest of them, comes last
            place = _append(new_order, place, order, group_begin[part], group_begin[part + 1])
            part = member[part]
        place = _append(new_order, place, order, group_begin[f], group_begin[f + 1])
        num_groups += 1
        new_begin[num_groups] = place
    return new_order, new_begin[: num_groups + 1]


@kernel
def plan_fronts(
    group_begin: IntArray, row_begin: IntArray, rows: IntArray, parent: IntArray
) -> tuple[IntArray, IntArray, IntArray, IntArray, int, int, int]:
    """Return where the numbers of every front go, for fronts in postorder.

    Parameters
    ----------
    group_begin, row_begin, rows, parent : int64, see :func:`front_rows`.

    Returns
    -------
    factor_begin : int64, shape (num_fronts + 1,), offset of the pivots' rows in the factor.
    place_in_parent : int64, of every row: its number within the parent.
    num_children : int64, shape (num_fronts,).
    depth : int64, shape (num_fronts,), 0 of a front without parent.
    even_size, odd_size : int64, numbers that the updates of fronts of even and odd depth need while
        they wait for their parents.
    max_width : int64, largest front, in vertices.
    """
    num_fronts = parent.size
    factor_begin = np.zeros(num_fronts + 1, dtype=np.int64)
    place_in_parent = np.zeros(rows.size, dtype=np.int64)
    num_children = np.zeros(num_fronts, dtype=np.int64)
    depth = np.zeros(num_fronts, dtype=np.int64)
    for f in range(num_fronts - 1, -1, -1):
        if parent[f] >= 0:
            depth[f] = depth[parent[f]] + 1
    waiting = np.zeros(num_fronts, dtype=np.int64)  # room that the children's updates take
    most = np.zeros(2, dtype=np.int64)
    in_use = np.zeros(2, dtype=np.int64)
    max_width = 0
    for f in range(num_fronts):
        num_pivots = group_begin[f + 1] - group_begin[f]
        num_rows = row_begin[f + 1] - row_begin[f]
        max_width = max(max_width, num_pivots + num_rows)
        factor_begin[f + 1] = factor_begin[f] + 3 * num_pivots * padded(3 * (num_pivots + num_rows))
        update = 3 * num_rows * padded(3 * num_rows)
        side = depth[f] % 2
        in_use[side] += update
        most[side] = max(most[side], in_use[side])
        in_use[1 - side] -= waiting[f]
        above = parent[f]
        if above < 0:
            continue
        num_children[above] += 1
        waiting[above] += update
        end_above = group_begin[above + 1]
        rows_above = row_begin[above + 1] - row_begin[above]
        k = row_begin[above]
        for i in range(row_begin[f], row_begin[f + 1]):
            if rows[i] < end_above:
                place_in_parent[i] = rows_above + end_above - 1 - rows[i]
                continue
            while rows[k] > rows[i]:
                k += 1
            place_in_parent[i] = k - row_begin[above]
    return factor_begin, place_in_parent, num_children, depth, most[0], most[1], max_width


@kernel
def place_blocks(
    row_begin_system: IntArray,
    columns: IntArray,
    order: IntArray,
    group_begin: IntArray,
    row_begin: IntArray,
    rows: IntArray,
    factor_begin: IntArray,
) -> tuple[IntArray, IntArray, IntArray]:
    """Return where the blocks of the system go in the factor.

    Parameters
    ----------
    row_begin_system, columns : int64, blocks above the diagonal, see :func:`couple_kept_vertices`.
    order, group_begin, row_begin, rows, factor_begin : int64, the fronts.

    Returns
    -------
    target : int64, offset of the block's first number, of the n diagonal ones, then of the others.
    stride : int64, how far apart the block's rows are in it.
    transposed : int64, 1 where the block's column is eliminated before its row.
    """
    n = order.size
    num_blocks = n + columns.size
    target = np.empty(num_blocks, dtype=np.int64)
    stride = np.empty(num_blocks, dtype=np.int64)
    transposed = np.zeros(num_blocks, dtype=np.int64)
    position = np.empty(n, dtype=np.int64)
    front_of = np.empty(n, dtype=np.int64)
    for f in range(group_begin.size - 1):
        for i in range(group_begin[f], group_begin[f + 1]):
            position[order[i]] = i
            front_of[i] = f
    for k in range(n):
        for s in range(row_begin_system[k] - 1, row_begin_system[k + 1]):
            if s < row_begin_system[k]:
                block, early, late = k, position[k], position[k]
            else:
                block, early, late = n + s, position[k], position[columns[s]]
            if late < early:
                early, late = late, early
                transposed[block] = 1
            f = front_of[early]
            end = group_begin[f + 1]
            num_rows = row_begin[f + 1] - row_begin[f]
            width = padded(3 * (end - group_begin[f] + num_rows))
            if late < end:
                column = num_rows + end - 1 - late
            else:
                low, high = row_begin[f], row_begin[f + 1]
                while low < high:
                    middle = (low + high) // 2
                    if rows[middle] > late:
                        low = middle + 1
                    else:
                        high = middle
                column = low - row_begin[f]
            target[block] = factor_begin[f] + 3 * (end - 1 - early) * width + 3 * column
            stride[block] = width
    return target, stride, transposed
