# SPDX-License-Identifier: Apache-2.0
"""Multifrontal Cholesky factorization of a planned system of 3 x 3 blocks, and its solution.

Each front (see :mod:`cartoloop.kernels.sparse_cholesky.fronts`) is a small dense problem. The rows
of its pivots stay in the factor. Its update, the Schur complement on the later rows, waits on a
stack until the parent front adds it. There are two stacks, for fronts of even and of odd depth, so
that a front's own update does not overlap those of its children. Within a front, vertices are
numbered backwards, and only the lower half of symmetric matrices is stored.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from cartoloop._jit import kernel
from cartoloop.arrays import FloatArray, IntArray
from cartoloop.kernels.sparse_cholesky.arrays import padded
from cartoloop.kernels.sparse_cholesky.symbolic import Plan

PIVOT_TOLERANCE = 1e-13
"""A pivot below this share of the system's diagonal is rounding error: the system is singular."""
LEAST_DIAGONAL = 1e-6
"""Damping acts at least as if the diagonal were this large: rows that nothing measures stay put."""
_GROUP = 6
"""Pivot rows that are subtracted at once: the row that they change is loaded and stored once."""
_BLOCK = 48
"""Pivot rows that stay in the cache while all rows below them are updated."""


class Workspace(NamedTuple):
    """Buffers of one plan; overwritten by every :func:`solve`.

    Attributes
    ----------
    factor : float64, (plan.factor_begin[-1],).
    diagonal : float64, (n, 3), of the damped system: pivots are compared with it.
    even_stack, odd_stack : float64, (plan.even_size,), (plan.odd_size,).
    waiting : int64, (num_fronts,), fronts whose updates are on the stacks.
    scratch : float64, (3 plan.max_width,).
    """

    factor: FloatArray
    diagonal: FloatArray
    even_stack: FloatArray
    odd_stack: FloatArray
    waiting: IntArray
    scratch: FloatArray


def workspace(plan: Plan) -> Workspace:
    """Return uninitialised buffers for a plan."""
    return Workspace(
        factor=_aligned(int(plan.factor_begin[-1])),
        diagonal=np.empty((plan.order.size, 3)),
        even_stack=_aligned(plan.even_size),
        odd_stack=_aligned(plan.odd_size),
        waiting=np.empty(plan.num_children.size, dtype=np.int64),
        scratch=np.empty(3 * plan.max_width),
    )


def _aligned(size: int) -> FloatArray:
    """Return an uninitialised array that begins a cache line: factorization is twice as fast."""
    numbers = np.empty(size + 7)
    first = -(numbers.ctypes.data // 8) % 8
    return numbers[first : first + size]


@kernel
def _assemble(blocks: FloatArray, damping: float, plan: Plan, out: Workspace) -> None:
    """Write the blocks of the system, its diagonal damped, into their places in the factor."""
    target, stride, transposed = plan.target, plan.stride, plan.transposed
    out_factor, out_diagonal = out.factor, out.diagonal
    num_rows = plan.order.size
    for i in range(out_factor.size):
        out_factor[i] = 0.0
    for k in range(num_rows):
        place, width = target[k], stride[k]
        for r in range(3):
            diagonal = blocks[k, 4 * r]
            diagonal += damping * max(diagonal, LEAST_DIAGONAL)
            out_diagonal[k, r] = diagonal
            out_factor[place + r * width + r] = diagonal
            for c in range(r):
                out_factor[place + r * width + c] = blocks[k, 3 * c + r]
    for s in range(num_rows, target.size):
        place, width, slot = target[s], stride[s], s + 1  # block number num_rows is not read
        down, along = (1, 3) if transposed[s] == 1 else (3, 1)
        for r in range(3):
            for c in range(3):
                out_factor[place + r * width + c] = blocks[slot, down * r + along * c]


@kernel
def _subtract_pivots(
    target: FloatArray, row: int, size: int, panel: FloatArray, low: int, high: int, column: int
) -> None:
    """Subtract from a row of `target` rows low to high - 1 of `panel`, times theirs at `column`."""
    while low + _GROUP <= high:
        a0, a1, a2 = panel[low, column], panel[low + 1, column], panel[low + 2, column]
        a3, a4, a5 = panel[low + 3, column], panel[low + 4, column], panel[low + 5, column]
        for j in range(size):
            target[row, j] -= (
                a0 * panel[low, j] + a1 * panel[low + 1, j] + a2 * panel[low + 2, j]
            ) + (a3 * panel[low + 3, j] + a4 * panel[low + 4, j] + a5 * panel[low + 5, j])
        low += _GROUP
    while low < high:  # the pivots of one vertex are left over
        a0, a1, a2 = panel[low, column], panel[low + 1, column], panel[low + 2, column]
        for j in range(size):
            target[row, j] -= a0 * panel[low, j] + a1 * panel[low + 1, j] + a2 * panel[low + 2, j]
        low += 3


@kernel
def _eliminate_pivots(panel: FloatArray, diagonal: FloatArray, update: FloatArray) -> bool:
    """Factor the pivot rows of a front in place and subtract their products from its update.

    Parameters
    ----------
    panel : float64, shape (num_pivots, padded(num_rows + num_pivots)).
    diagonal : float64, shape (num_pivots,) at least, of the system, pivots are compared with it.
    update : float64, shape (num_rows, padded(num_rows)), lower half.

    Returns
    -------
    definite : bool, False if a pivot vanishes.
    """
    num_rows = update.shape[0]
    high = panel.shape[0]
    while high > 0:
        low = max(high - _BLOCK, 0)
        group_high = high
        while group_high > low:
            group_low = max(group_high - _GROUP, low)
            for q in range(group_high - 1, group_low - 1, -1):
                own = num_rows + q
                pivot = panel[q, own]
                if not pivot > PIVOT_TOLERANCE * diagonal[q]:
                    return False
                scale = 1.0 / math.sqrt(pivot)
                for j in range(own + 1):
                    panel[q, j] *= scale
                for i in range(group_low, q):
                    a = panel[q, num_rows + i]
                    for j in range(num_rows + i + 1):
                        panel[i, j] -= a * panel[q, j]
            for i in range(low, group_low):
                column = num_rows + i
                _subtract_pivots(panel, i, column + 1, panel, group_low, group_high, column)
            group_high = group_low
        for i in range(low):
            column = num_rows + i
            _subtract_pivots(panel, i, column + 1, panel, low, high, column)
        for i in range(num_rows):
            _subtract_pivots(update, i, i + 1, panel, low, high, i)
        high = low
    return True


@kernel
def _extend_add(child: FloatArray, places: IntArray, panel: FloatArray, update: FloatArray) -> None:
    """Add the update of a child front to the front (extend-add).

    Parameters
    ----------
    child : float64, shape (3 n, padded(3 n)), lower half.
    places : int64, shape (n,), ascending, where its rows are in the front.
    panel, update : float64, of the front, see :func:`_eliminate_pivots`.
    """
    num_rows = update.shape[0]
    for i in range(places.size):
        for r in range(3):
            row = 3 * places[i] + r
            if row < num_rows:
                for j in range(i + 1):
                    column = 3 * places[j]
                    update[row, column] += child[3 * i + r, 3 * j]
                    update[row, column + 1] += child[3 * i + r, 3 * j + 1]
                    update[row, column + 2] += child[3 * i + r, 3 * j + 2]
            else:
                row -= num_rows
                for j in range(i + 1):
                    column = 3 * places[j]
                    panel[row, column] += child[3 * i + r, 3 * j]
                    panel[row, column + 1] += child[3 * i + r, 3 * j + 1]
                    panel[row, column + 2] += child[3 * i + r, 3 * j + 2]


@kernel
def _factor(plan: Plan, out: Workspace) -> bool:
    """Factor the assembled system in place; return False if it is not positive definite."""
    order, group_begin, row_begin = plan.order, plan.group_begin, plan.row_begin
    factor_begin, num_children, depth = plan.factor_begin, plan.num_children, plan.depth
    diagonal, waiting = out.diagonal, out.waiting
    even_stack, odd_stack, out_factor = out.even_stack, out.odd_stack, out.factor
    place_in_parent = plan.place_in_parent
    num_waiting = 0
    even_top = odd_top = 0
    pivots_diagonal = np.empty(diagonal.size)
    for f in range(num_children.size):
        num_pivots = 3 * (group_begin[f + 1] - group_begin[f])
        num_rows = 3 * (row_begin[f + 1] - row_begin[f])
        for q in range(num_pivots):
            pivots_diagonal[q] = diagonal[order[group_begin[f + 1] - 1 - q // 3], q % 3]
        panel = out_factor[factor_begin[f] : factor_begin[f + 1]].reshape(
            (num_pivots, padded(num_pivots + num_rows))
        )
        even = depth[f] % 2 == 0
        stack, top = (even_stack, even_top) if even else (odd_stack, odd_top)
        children, child_top = (odd_stack, odd_top) if even else (even_stack, even_top)
        size = num_rows * padded(num_rows)
        update = stack[top : top + size].reshape((num_rows, padded(num_rows)))
        for i in range(num_rows):
            for j in range(i + 1):
                update[i, j] = 0.0
        for _ in range(num_children[f]):
            num_waiting -= 1
            child = waiting[num_waiting]
            n = 3 * (row_begin[child + 1] - row_begin[child])
            child_top -= n * padded(n)
            _extend_add(
                children[child_top : child_top + n * padded(n)].reshape((n, padded(n))),
                place_in_parent[row_begin[child] : row_begin[child + 1]],
                panel,
                update,
            )
        if not _eliminate_pivots(panel, pivots_diagonal, update):
            return False
        if num_rows > 0:
            waiting[num_waiting] = f
            num_waiting += 1
        even_top, odd_top = (top + size, child_top) if even else (child_top, top + size)
    return True


@kernel
def _solve_lower(plan: Plan, right: FloatArray, work: Workspace, out_solution: FloatArray) -> float:
    """Write y with L y = -right into `out_solution`; return the square of its length."""
    order, group_begin = plan.order, plan.group_begin
    row_begin, rows, factor_begin = plan.row_begin, plan.rows, plan.factor_begin
    factor, scratch = work.factor, work.scratch
    energy = 0.0
    for v in range(order.size):
        for r in range(3):
            out_solution[v, r] = -right[v, r]
    for f in range(group_begin.size - 1):  # forward
        num_rows = 3 * (row_begin[f + 1] - row_begin[f])
        num_pivots = 3 * (group_begin[f + 1] - group_begin[f])
        width = padded(num_rows + num_pivots)
        place = factor_begin[f + 1]
        for j in range(num_rows):
            scratch[j] = 0.0
        for q in range(num_pivots):
            scratch[num_rows + q] = out_solution[order[group_begin[f + 1] - 1 - q // 3], q % 3]
        for q in range(num_pivots - 1, -1, -1):
            place -= width
            own = num_rows + q
            row = factor[place : place + own]
            value = scratch[own] / factor[place + own]
            energy += value * value
            for j in range(row.size):
                scratch[j] -= value * row[j]
            out_solution[order[group_begin[f + 1] - 1 - q // 3], q % 3] = value
        for i in range(row_begin[f], row_begin[f + 1]):
            j = 3 * (i - row_begin[f])
            for r in range(3):
                out_solution[order[rows[i]], r] += scratch[j + r]
    return energy


@kernel
def _solve_upper(plan: Plan, work: Workspace, out_solution: FloatArray) -> None:
    """Replace y in `out_solution` by x with L^T x = y."""
    order, group_begin = plan.order, plan.group_begin
    row_begin, rows, factor_begin = plan.row_begin, plan.rows, plan.factor_begin
    factor, scratch = work.factor, work.scratch
    for f in range(group_begin.size - 2, -1, -1):  # backward
        num_rows = 3 * (row_begin[f + 1] - row_begin[f])
        num_pivots = 3 * (group_begin[f + 1] - group_begin[f])
        width = padded(num_rows + num_pivots)
        for i in range(row_begin[f], row_begin[f + 1]):
            j = 3 * (i - row_begin[f])
            for r in range(3):
                scratch[j + r] = out_solution[order[rows[i]], r]
        place = factor_begin[f]
        for q in range(num_pivots):
            own = num_rows + q
            even, odd = 0.0, 0.0  # two chains: in one, each sum would wait for the one before
            for j in range(0, own - 1, 2):
                even += factor[place + j] * scratch[j]
                odd += factor[place + j + 1] * scratch[j + 1]
            if own % 2 == 1:
                even += factor[place + own - 1] * scratch[own - 1]
            vertex = order[group_begin[f + 1] - 1 - q // 3]
            value = (out_solution[vertex, q % 3] - (even + odd)) / factor[place + own]
            out_solution[vertex, q % 3] = value
            scratch[own] = value
            place += width


@kernel
def solve(
    plan: Plan,
    blocks: FloatArray,
    right: FloatArray,
    damping: float,
    work: Workspace,
    out_solution: FloatArray,
) -> tuple[float, bool]:
    """Write the solution of H x = -right into `out_solution`.

    Parameters
    ----------
    plan : of the sparsity pattern of H.
    blocks : float64, shape (n + 1 + num_columns, 9), blocks of H row by row: the n diagonal ones
        (upper half only), one that is not read, then those above the diagonal in the order of the
        pattern's columns.
    right : float64, shape (n or more, 3).
    damping : float64, share of the diagonal that is added to it (Marquardt).
    work : buffers of the plan.
    out_solution : float64, shape (n or more, 3); rows beyond n are left alone.

    Returns
    -------
    decrease : float64, half of right^T H^-1 right, H being damped.
    definite : bool, False if H is not positive definite: nothing is solved then.
    """
    _assemble(blocks, damping, plan, work)
    if not _factor(plan, work):
        return 0.0, False
    energy = _solve_lower(plan, right, work, out_solution)
    _solve_upper(plan, work, out_solution)
    return 0.5 * energy, True
