# SPDX-License-Identifier: Apache-2.0
"""The precomputed grids of one finished submap, eq. (17): maxima over a pyramid of boxes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from cartoloop.arrays import ByteArray, CellArray, IntArray
from cartoloop.kernels.node_bounds import LEVEL
from cartoloop.kernels.precomputation_grid import GridArrays, grow_boxes, halve
from cartoloop.runtime.reused_memory import ReusedMemory
from cartoloop.submaps.finished_grid import probabilities_of_part

STRIDES = (1, 1, 1, 2, 4, 8)
"""For blocks of 1, 2, 4, ... translations: the stride of the grids that bound them [cells].

A grid with stride s holds every s-th box, enlarged so that it contains the boxes in between: much
smaller, and nearly as tight where the boxes are large.
"""

MAP_STRIDES = (*STRIDES, 16, 32)
"""The same for whole maps, mostly empty: larger blocks exclude more at once, in windows that are
wide enough for them."""

MAX_MOVE = 4
"""Maximum distance that a point moves within a group of rotations [blocks]: there are no boxes for
longer moves. Search results do not depend on it."""

_FINE = (1, 2, 3, 5, 7, 10, 15, 22)
_COARSE = (5, 6, 8, 11, 15, 22)
BOXES = {1: _FINE, 2: _COARSE, 4: _COARSE, 8: _COARSE, 16: _COARSE, 32: _COARSE}
"""By stride, the edges of the boxes [strides].

More sizes make tighter bounds; but most submaps are searched for a few scans at a time, and then
grids take longer to make than to search.
"""

LARGEST_STEP = 4
"""From a box to that of a neighbouring node [strides]."""

MARGIN = _FINE[-1] + LARGEST_STEP
"""Zeros before the first column and row [strides]: boxes from there on, or a step on, are empty."""

_END_MARGIN = LARGEST_STEP + 1

_MEMORY = ReusedMemory(max_idle_bytes=40 << 20)


@dataclass(frozen=True, slots=True)
class GridLayout:
    """How the grids of one stride lie in memory, one after the other.

    Attributes
    ----------
    stride : from one box to the next [cells].
    num_rows, num_cols : of the boxes that begin within the submap's grid.
    first : where the first grid begins.
    """

    stride: int
    num_rows: int
    num_cols: int
    first: int

    @property
    def row_length(self) -> int:
        """Of a row with its margins."""
        return MARGIN + self.num_cols + _END_MARGIN

    @property
    def grid_size(self) -> int:
        """Bytes of one grid with its margins."""
        return (MARGIN + self.num_rows + _END_MARGIN) * self.row_length

    @property
    def end(self) -> int:
        """Past the last grid."""
        return self.first + len(BOXES[self.stride]) * self.grid_size

    def box_table(self, block: int, num_moves: int) -> IntArray:
        """Return where the grid's first cell is, for blocks of an edge, by how far a point moves.

        The grid is the one with the smallest boxes that hold the block and the move, wherever
        within its stride the box begins.
        """
        start: IntArray = _smallest_boxes(self.stride, block, num_moves) * self.grid_size
        return start + self.first + MARGIN * (self.row_length + 1)


@cache
def _smallest_boxes(stride: int, block: int, num_moves: int) -> IntArray:
    """Return which of the boxes of a stride hold a block, by how far a point moves."""
    edges = np.array(BOXES[stride])
    moves = np.arange(num_moves)
    return np.minimum(np.searchsorted((edges - 1) * stride + 1, block + moves), len(edges) - 1)


class PrecomputationGrids:
    """Maxima over boxes of a submap's cells.

    Parameters
    ----------
    cells : uint8, shape (num_rows, num_cols), not empty.
    strides : for blocks of 1, 2, 4, ... translations.

    Attributes
    ----------
    cells : uint8, all grids in one.
    layouts : by stride.
    levels : of :data:`cartoloop.kernels.node_bounds.LEVEL`, shape (len(strides),), for blocks of
        1, 2, 4, ... translations.
    boxes : int32, shape (len(strides), num_moves), see :meth:`GridLayout.box_table`.
    """

    def __init__(self, cells: ByteArray, strides: Sequence[int] = STRIDES) -> None:
        self.layouts: dict[int, GridLayout] = {}
        end = 0
        for stride in dict.fromkeys(strides):
            num_rows, num_cols = (-(-size // stride) for size in cells.shape)
            self.layouts[stride] = GridLayout(stride, num_rows, num_cols, end)
            end = self.layouts[stride].end
        self.cells = _MEMORY.array(end)
        cells = np.ascontiguousarray(cells)
        for layout in self.layouts.values():
            if layout.stride > 1:
                halved = np.empty(
                    ((cells.shape[0] + 1) // 2, (cells.shape[1] + 1) // 2), dtype=np.uint8
                )
                halve(cells, halved)
                halved.flags.writeable = False  # like `cells`: one compiled kernel serves both
                cells = halved
            grids = self.cells[layout.first : layout.end].reshape(-1, layout.grid_size)
            edges = np.array(BOXES[layout.stride])
            grow_boxes(cells, edges, MARGIN, layout.row_length, grids)
        layouts = [self.layouts[stride] for stride in strides]
        self.levels = np.array(
            [
                (x.stride.bit_length() - 1, MARGIN, x.num_cols, x.num_rows, x.row_length)
                for x in layouts
            ],
            dtype=LEVEL,
        )
        num_moves = MAX_MOVE * (1 << (len(strides) - 1)) + 3
        tables = [layout.box_table(1 << height, num_moves) for height, layout in enumerate(layouts)]
        self.boxes: CellArray = np.array(tables, dtype=np.int32)

    @property
    def arrays(self) -> GridArrays:
        """The grids as kernels take them."""
        return GridArrays(self.cells, self.levels, self.boxes)

    def probabilities(self) -> NDArray[np.float32]:
        """Return the probability of each of the submap's cells; 0 where never observed."""
        layout = self.layouts[1]
        shape = (layout.num_rows, layout.num_cols)
        cells = self.grid(1, 1)
        cells.flags.writeable = False  # as those of a finished grid
        return probabilities_of_part(cells, MARGIN, MARGIN, shape)

    def grid(self, stride: int, edge: int) -> ByteArray:
        """Return the grid of boxes of `edge` strides, with its margins: ``[row + MARGIN, ...]``."""
        layout = self.layouts[stride]
        first = layout.first + BOXES[stride].index(edge) * layout.grid_size
        return self.cells[first : first + layout.grid_size].reshape(-1, layout.row_length)
