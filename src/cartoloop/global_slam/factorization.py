# SPDX-License-Identifier: Apache-2.0
"""Sparse Cholesky factorization of the reduced normal equations: planned once, then repeated."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cartoloop.kernels import block_cholesky, cholesky_structure, schur_structure
from cartoloop.kernels.cholesky_ordering import minimum_degree

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_MAX_ZEROS_OF_A_FRONT = 8
"""Blocks of zeros that merging small fronts may store: 0 to 64 were tried on the public graphs."""


@dataclass(frozen=True)
class Fronts:
    """The plan of the factorization; see :mod:`cartoloop.kernels.cholesky_structure`."""

    order: IntArray
    group_begin: IntArray
    row_begin: IntArray
    rows: IntArray
    factor_begin: IntArray
    place_in_parent: IntArray
    num_children: IntArray
    target: IntArray
    stride: IntArray
    transposed: IntArray
    depth: IntArray
    even_size: int
    odd_size: int
    max_width: int


def plan_factorization(row_begin: IntArray, columns: IntArray) -> Fronts:
    """Return how to factor a system with these blocks above its diagonal.

    Parameters
    ----------
    row_begin : int64, shape (n + 1,).
    columns : int64, block columns of row k in columns[row_begin[k]:row_begin[k + 1]], all > k.
    """
    begin, neighbours = schur_structure.both_halves(row_begin, columns)
    order, group_begin, num_groups = minimum_degree(begin, neighbours)
    group_begin = group_begin[: num_groups + 1]
    front_begin, _, parent = cholesky_structure.front_rows(begin, neighbours, order, group_begin)
    order, group_begin = cholesky_structure.merge_small_fronts(
        order, group_begin, front_begin, parent, _MAX_ZEROS_OF_A_FRONT
    )
    front_begin, rows, parent = cholesky_structure.front_rows(begin, neighbours, order, group_begin)
    factor_begin, place_in_parent, num_children, depth, even_size, odd_size, max_width = (
        cholesky_structure.plan_fronts(group_begin, front_begin, rows, parent)
    )
    target, stride, transposed = cholesky_structure.place_blocks(
        row_begin, columns, order, group_begin, front_begin, rows, factor_begin
    )
    return Fronts(
        order,
        group_begin,
        front_begin,
        rows,
        factor_begin,
        place_in_parent,
        num_children,
        target,
        stride,
        transposed,
        depth,
        even_size,
        odd_size,
        max_width,
    )


def _aligned(size: int) -> FloatArray:
    """Return an uninitialised array that begins a cache line: factorization is twice as fast."""
    numbers = np.empty(size + 7)
    first = -(numbers.ctypes.data // 8) % 8
    return numbers[first : first + size]


class Factorization:
    """Solves systems of one structure.

    Parameters
    ----------
    row_begin, columns : blocks above the diagonal, see :func:`plan_factorization`.
    """

    def __init__(self, row_begin: IntArray, columns: IntArray) -> None:
        fronts = self._fronts = plan_factorization(row_begin, columns)
        self._factor = _aligned(int(fronts.factor_begin[-1]))
        self._diagonal = np.empty((row_begin.size - 1, 3))
        self._even_stack = _aligned(fronts.even_size)
        self._odd_stack = _aligned(fronts.odd_size)
        self._waiting = np.empty(fronts.num_children.size, dtype=np.int64)
        self._scratch = np.empty(3 * fronts.max_width)

    def solve(
        self, blocks: FloatArray, gradient: FloatArray, damping: float, out_steps: FloatArray
    ) -> tuple[float, bool]:
        """Write the steps that solve the system into `out_steps`.

        Parameters
        ----------
        blocks, gradient : see :mod:`cartoloop.kernels.kept_constraints`.
        damping : share of the diagonal that is added to it (Marquardt).
        out_steps : shape (n or more, 3).

        Returns
        -------
        decrease : of the (damped) quadratic model.
        definite : whether the system could be factored; if not, damp more.
        """
        fronts = self._fronts
        block_cholesky.assemble_blocks(
            blocks,
            len(self._diagonal),
            damping,
            fronts.target,
            fronts.stride,
            fronts.transposed,
            self._factor,
            self._diagonal,
        )
        if not block_cholesky.factor_fronts(
            fronts.order,
            fronts.group_begin,
            fronts.row_begin,
            fronts.place_in_parent,
            fronts.num_children,
            fronts.depth,
            fronts.factor_begin,
            self._diagonal,
            self._even_stack,
            self._odd_stack,
            self._waiting,
            self._factor,
        ):
            return 0.0, False
        decrease = block_cholesky.solve_fronts(
            fronts.order,
            fronts.group_begin,
            fronts.row_begin,
            fronts.rows,
            fronts.factor_begin,
            self._factor,
            gradient,
            self._scratch,
            out_steps,
        )
        return decrease, True
