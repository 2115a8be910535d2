# SPDX-License-Identifier: Apache-2.0
"""The grid of a finished submap: one byte for each pixel, compressed."""

from __future__ import annotations

import math
import zlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import numpy as np
from numpy.typing import NDArray

from cartoloop.arrays import ByteArray
from cartoloop.kernels.cell_values import dequantize_box, quantize_box
from cartoloop.runtime.reused_memory import ReusedMemory

MIN_PROBABILITY = 0.1
MAX_PROBABILITY = 0.9
"""The interval [p_min, p_max] that probabilities are clamped to (section IV-B)."""

MAX_STEPS = 254.0
"""Steps from the smallest cell value of an observed cell, 1, to the largest, 255."""

PROBABILITY_STEP = (MAX_PROBABILITY - MIN_PROBABILITY) / MAX_STEPS
"""Difference between neighbouring cell values."""

MAX_CELLS = 2**27
"""Of one submap: a square of 500 m at 0.05 m; more is no submap but a damaged file."""

MAX_KEPT_BYTES = 64 << 20
"""Cells that are kept decompressed, one byte each: those of some hundred submaps of rooms."""

_ZLIB_HEADER, _ZLIB_CHECKSUM = 2, 4
"""Before and after the compressed data of a zlib stream (RFC 1950) [bytes]."""

_MEMORY = ReusedMemory(max_idle_bytes=16 << 20)
"""Memory of probabilities: that of four large grids."""


class FinishedGrid:
    """A probability grid that does not change, stored compressed since its cells are rarely read.

    Parameters
    ----------
    cells : uint8, shape (num_rows, num_cols): 0 where never observed, otherwise v in 1..255 for
        the probability ``MIN_PROBABILITY + (v - 1) * PROBABILITY_STEP``. Rows: y, columns: x.
    origin_x, origin_y : centre of ``cells[0, 0]`` [m, submap frame].
    resolution : pixel edge r [m].
    """

    __slots__ = ("_kept", "_packed", "origin_x", "origin_y", "resolution", "shape")

    def __init__(
        self, cells: ByteArray, origin_x: float, origin_y: float, resolution: float
    ) -> None:
        self._packed = zlib.compress(cells.tobytes(), level=1)
        self._kept: ByteArray | None = None
        self.shape: tuple[int, int] = (cells.shape[0], cells.shape[1])
        self.origin_x = origin_x
        self.origin_y = origin_y
        self.resolution = resolution

    def is_same(self, other: FinishedGrid) -> bool:
        """Return whether another grid has the same cells in the same place."""
        return self is other or (
            (self.shape, self.origin_x, self.origin_y, self.resolution)
            == (other.shape, other.origin_x, other.origin_y, other.resolution)
            and self._packed == other._packed
        )

    @classmethod
    def of_packed(
        cls,
        packed: bytes,
        shape: tuple[int, int],
        origin_x: float,
        origin_y: float,
        resolution: float,
    ) -> FinishedGrid:
        """Return the grid of cells that are compressed already, as :attr:`packed` yields them.

        Raises
        ------
        ValueError, zlib.error
            They are damaged, or have another shape; no more memory is ever taken than that needs.
        """
        size = shape[0] * shape[1]
        if min(shape) < 0 or size > MAX_CELLS:
            raise ValueError(f"a submap is {shape[0]} by {shape[1]} cells")
        if not (math.isfinite(origin_x + origin_y) and 0.0 < resolution < math.inf):
            raise ValueError(
                f"a submap lies at {origin_x}, {origin_y}, with cells of {resolution} m"
            )
        stream = zlib.decompressobj()
        if len(stream.decompress(packed, size + 1)) != size or not stream.eof:
            raise ValueError("a compressed field is too short or too long")
        grid = cls.__new__(cls)
        grid._packed, grid._kept, grid.shape = packed, None, shape
        grid.origin_x, grid.origin_y, grid.resolution = origin_x, origin_y, resolution
        return grid

    @property
    def size(self) -> int:
        """Number of cells."""
        return self.shape[0] * self.shape[1]

    @property
    def packed(self) -> bytes:
        """The cells, row by row, as a zlib stream."""
        return self._packed

    @property
    def cells(self) -> ByteArray:
        """The values of the cells; decompressed on each access, 1 ms for a million or two.

        Not within :func:`kept_cells`.
        """
        if self._kept is not None:
            return self._kept
        # Without the checksum at the end, which was compared when the cells came from a file.
        stream = memoryview(self._packed)[_ZLIB_HEADER:-_ZLIB_CHECKSUM]
        cells = zlib.decompress(stream, wbits=-zlib.MAX_WBITS, bufsize=max(self.size, 1))
        return np.frombuffer(cells, dtype=np.uint8).reshape(self.shape)

    def probabilities(self) -> NDArray[np.float32]:
        """Return the probability of each cell, float32 like `cells`; 0 where never observed."""
        return probabilities_of_part(self.cells, 0, 0, self.shape)


@contextmanager
def kept_cells(grids: Sequence[FinishedGrid], max_bytes: int = MAX_KEPT_BYTES) -> Iterator[None]:
    """Keep the cells of grids that are read several times, as many as there is memory for.

    Parameters
    ----------
    grids : those from the first one on.
    max_bytes : of all that are kept.
    """
    kept: list[FinishedGrid] = []
    num_bytes = 0
    try:
        for grid in grids:
            num_bytes += grid.size
            if num_bytes > max_bytes:
                break
            grid._kept = grid.cells
            kept.append(grid)
        yield
    finally:
        for grid in kept:
            grid._kept = None


def quantize_probabilities(probabilities: NDArray[np.float32]) -> ByteArray:
    """Return cell values for probabilities within the clamping interval, 0 for never observed."""
    row = np.ascontiguousarray(probabilities).reshape(1, -1)
    return quantize_part(row, 0, 0, row.shape).reshape(probabilities.shape)


def quantize_part(
    probabilities: NDArray[np.float32], first_row: int, first_col: int, shape: tuple[int, int]
) -> ByteArray:
    """Return the cell values of a box of a grid in C order, given its first cell."""
    values = np.empty(shape, dtype=np.uint8)
    quantize_box(probabilities, first_row, first_col, MIN_PROBABILITY, PROBABILITY_STEP, values)
    return values


def probabilities_of_part(
    values: ByteArray, first_row: int, first_col: int, shape: tuple[int, int]
) -> NDArray[np.float32]:
    """Return the probabilities of a box of cell values, given its first cell."""
    memory = _MEMORY.array(4 * shape[0] * shape[1])
    probabilities = memory.view(np.float32).reshape(shape)
    dequantize_box(values, first_row, first_col, MIN_PROBABILITY, PROBABILITY_STEP, probabilities)
    return probabilities


def mean_probability(mean_value: float) -> float:
    """Return the score, in [0, 1], of points whose cells' values have this mean."""
    return max(0.0, MIN_PROBABILITY + (mean_value - 1.0) * PROBABILITY_STEP)


def mean_value(score: float) -> float:
    """Return the mean cell value of a score: inverse of :func:`mean_probability`."""
    return (score - MIN_PROBABILITY) / PROBABILITY_STEP + 1.0
