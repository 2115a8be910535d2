# SPDX-License-Identifier: Apache-2.0
"""Bounding grids of the search tree: the paper's, and the alternatives that it rejects."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cartoloop.arrays import ByteArray, IntArray
from cartoloop.kernels.precomputation_grid import halve


@dataclass(frozen=True, slots=True)
class BoundingGrids:
    """The grids of one submap for all heights of the tree.

    Attributes
    ----------
    cells : uint8, all grids in one.
    levels : int64, shape (h_0 + 1, 6), see :func:`bench.matching.plain_search.search_plainly`.
    """

    cells: ByteArray
    levels: IntArray


def precomputed(cells: ByteArray, top: int) -> BoundingGrids:
    """Return the paper's grids, eq. (17): the maximum of the 2^h x 2^h box beginning at each pixel.

    Parameters
    ----------
    cells : uint8, shape (num_rows, num_cols), not empty.
    top : h_0, the largest height.
    """
    grids = [cells]
    for height in range(top):
        edge = 1 << height
        padded = np.pad(grids[-1], edge)
        rows = np.maximum(padded[:-edge], padded[edge:])
        grids.append(np.maximum(rows[:, :-edge], rows[:, edge:]))
    # Boxes that begin before the submap's first pixel reach into it.
    return _together([(grid, (1 << height) - 1, 0, 0) for height, grid in enumerate(grids)])


def halved(cells: ByteArray, top: int) -> BoundingGrids:
    """Return grids of successively halved resolution; a box meets up to 2 x 2 of their cells.

    Parameters are those of :func:`precomputed`.
    """
    # A border of zeros, so that all four cells exist wherever a box meets one of the grid's.
    bordered = [np.pad(grid, 1) for grid in _pyramid(cells, top)]
    return _together([(grid, 1, height, 1) for height, grid in enumerate(bordered)])


def halved_and_joined(cells: ByteArray, top: int) -> BoundingGrids:
    """Return grids of halved resolution, each cell joined with the next ones right and above.

    Faster to look up, as that is one cell, not four; but a box that happens to be aligned with the
    cells is bounded by cells that it does not meet. Parameters are those of :func:`precomputed`.
    """
    grids = [cells]
    for grid in _pyramid(cells, top)[1:]:
        padded = np.pad(grid, 1)
        rows = np.maximum(padded[:-1], padded[1:])
        grids.append(np.maximum(rows[:, :-1], rows[:, 1:]))
    return _together([(grid, min(height, 1), height, 0) for height, grid in enumerate(grids)])


def _pyramid(cells: ByteArray, top: int) -> list[ByteArray]:
    """Return the grid and its halvings, each cell the maximum of 2 x 2 finer ones."""
    grids = [np.ascontiguousarray(cells)]
    for _ in range(top):
        num_rows, num_cols = grids[-1].shape
        coarser = np.empty(((num_rows + 1) // 2, (num_cols + 1) // 2), dtype=np.uint8)
        halve(grids[-1], coarser)
        grids.append(coarser)
    return grids


def _together(grids: list[tuple[ByteArray, int, int, int]]) -> BoundingGrids:
    """Return grids, each with the last three columns of its level, in one."""
    levels, first = [], 0
    for grid, *rest in grids:
        levels.append((first, grid.shape[1], grid.shape[0], *rest))
        first += grid.size
    return BoundingGrids(
        np.concatenate([grid.ravel() for grid, *_ in grids]), np.array(levels, dtype=np.int64)
    )
