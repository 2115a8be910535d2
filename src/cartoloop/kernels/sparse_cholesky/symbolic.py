# SPDX-License-Identifier: Apache-2.0
"""The plan of a factorization: what depends on the sparsity pattern alone."""

from __future__ import annotations

from typing import NamedTuple

from cartoloop._jit import kernel
from cartoloop.arrays import IntArray
from cartoloop.kernels.sparse_cholesky import fronts
from cartoloop.kernels.sparse_cholesky.arrays import both_halves
from cartoloop.kernels.sparse_cholesky.ordering import minimum_degree

MAX_ZEROS_OF_A_FRONT = 8
"""Blocks of zeros that merging small fronts may store: the fastest of 0 to 64 on public graphs."""


class Plan(NamedTuple):
    """How to factor the systems of one sparsity pattern of n block rows.

    Attributes
    ----------
    order : int64, (n,), block rows in their order of elimination.
    group_begin : int64, (num_fronts + 1,), positions in `order` of the pivots of each front.
    row_begin, rows : int64, (num_fronts + 1,), (num_rows,), later positions that each front
        updates, descending.
    factor_begin : int64, (num_fronts + 1,), offset of each front's pivot rows in the factor.
    place_in_parent : int64, (num_rows,), number of each row within the parent front.
    num_children, depth : int64, (num_fronts,), in the tree of fronts; depth 0 at the roots.
    target, stride : int64, (num_blocks,), where the first number of each block of the system goes
        in the factor, and how far apart its rows are there; the n diagonal blocks first.
    transposed : int64, (num_blocks,), 1 where a block's column is eliminated before its row.
    even_size, odd_size : numbers that the updates of fronts of even and odd depth need at once.
    max_width : block rows and columns of the largest front.
    """

    order: IntArray
    group_begin: IntArray
    row_begin: IntArray
    rows: IntArray
    factor_begin: IntArray
    place_in_parent: IntArray
    num_children: IntArray
    depth: IntArray
    target: IntArray
    stride: IntArray
    transposed: IntArray
    even_size: int
    odd_size: int
    max_width: int


@kernel
def plan(row_begin: IntArray, columns: IntArray) -> Plan:
    """Return how to factor systems with these blocks above their diagonal.

    Parameters
    ----------
    row_begin : int64, shape (n + 1,).
    columns : int64, block columns of row k in columns[row_begin[k]:row_begin[k + 1]], all > k.
    """
    begin, neighbours = both_halves(row_begin, columns)
    order, group_begin, num_groups = minimum_degree(begin, neighbours)
    group_begin = group_begin[: num_groups + 1]
    front_begin, _, parent = fronts.front_rows(begin, neighbours, order, group_begin)
    order, group_begin = fronts.merge_small_fronts(
        order, group_begin, front_begin, parent, MAX_ZEROS_OF_A_FRONT
    )
    front_begin, rows, parent = fronts.front_rows(begin, neighbours, order, group_begin)
    factor_begin, place_in_parent, num_children, depth, even_size, odd_size, max_width = (
        fronts.plan_fronts(group_begin, front_begin, rows, parent)
    )
    target, stride, transposed = fronts.place_blocks(
        row_begin, columns, order, group_begin, front_begin, rows, factor_begin
    )
    return Plan(
        order,
        group_begin,
        front_begin,
        rows,
        factor_begin,
        place_in_parent,
        num_children,
        depth,
        target,
        stride,
        transposed,
        even_size,
        odd_size,
        max_width,
    )
