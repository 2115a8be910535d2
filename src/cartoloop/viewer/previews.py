# SPDX-License-Identifier: Apache-2.0
"""Finished submaps from afar: small pictures that a page can show before all cells have come."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from cartoloop.map_output.picture import floor_and_wall
from cartoloop.submaps.finished_grid import FinishedGrid
from cartoloop.viewer.protocol import Texture, preview_message

if TYPE_CHECKING:
    from cartoloop.viewer.parts import Token

SHRINK = 4
"""Cells to a pixel, along an edge."""

_AGREEING = 2.0
"""What one submap has seen is seldom all: it is shown as sure as so many that agree."""

_STEPS = 15  # of four bits


class Preview:
    """A finished submap as a small picture; a part of the state."""

    def __init__(self, submap: int, grid: FinishedGrid, log_odds: NDArray[np.float32]) -> None:
        pixels = shrink(grid.cells, log_odds)
        shift = (SHRINK - 1) / 2.0 * grid.resolution  # between the centres of cell and pixel
        texture = Texture(
            pixels, grid.origin_x + shift, grid.origin_y + shift, SHRINK * grid.resolution
        )
        self._message = preview_message(submap, texture)
        self._token = (0, 1)

    def news(self, seen: Token | None) -> tuple[bytes, Token]:
        """Return all of it, unless it was seen."""
        return (b"" if seen == self._token else self._message), self._token


def shrink(cells: NDArray[np.uint8], log_odds: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Return how much floor and how much wall is in each square of cells.

    Parameters
    ----------
    cells : uint8, shape (rows, cols), of a :class:`FinishedGrid`, 0 unknown.
    log_odds : float32 (256,), evidence by value.

    Returns
    -------
    uint8, shape (ceil(rows / SHRINK), ceil(cols / SHRINK)): fifteenths, of wall in the upper and of
    floor in the lower four bits; what is neither is ground.
    """
    floor, wall = floor_and_wall(1.0 / (1.0 + np.exp(-_AGREEING * log_odds.astype(np.float64))))
    # Both in one number, so that one sum adds up both: of 16 cells, each is within 12 bits.
    floor_255, wall_255 = np.rint(255.0 * floor), np.rint(255.0 * wall)
    shares = floor_255.astype(np.uint32) | wall_255.astype(np.uint32) << 16
    shares[0] = 0
    rows, cols = cells.shape
    padded = np.pad(cells, ((0, -rows % SHRINK), (0, -cols % SHRINK)))
    in_rows = shares[padded].reshape(len(padded) // SHRINK, SHRINK, padded.shape[1])
    by_row = in_rows.sum(axis=1, dtype=np.uint32)
    sums = by_row[:, ::SHRINK].copy()
    for first in range(1, SHRINK):
        sums += by_row[:, first::SHRINK]
    full = 255 * SHRINK * SHRINK
    floors = ((sums & 0xFFFF) * _STEPS + full // 2) // full
    walls = ((sums >> 16) * _STEPS + full // 2) // full
    pixels: NDArray[np.uint8] = (walls << 4 | floors).astype(np.uint8)
    return pixels
