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
"""Factor on the evidence of one submap, as if this number of submaps agreed: several usually do."""

_STEPS = 15  # of four bits
_FULL = 255 // SHRINK


class Preview:
    """A finished submap as a small picture; a part of the state."""

    def __init__(
        self, submap: int, grid: FinishedGrid | Texture, log_odds: NDArray[np.float32]
    ) -> None:
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
    rows, cols = cells.shape
    padded = np.pad(cells, ((0, -rows % SHRINK), (0, -cols % SHRINK)))
    pixels: NDArray[np.uint8] = (_means(padded, wall) << 4 | _means(padded, floor)).astype(np.uint8)
    return pixels


def _means(cells: NDArray[np.uint8], shares: NDArray[np.float64]) -> NDArray[np.uint16]:
    """Return the mean of shares in each square of cells, in fifteenths; of unknown cells 0."""
    table = np.rint(_FULL * shares).astype(np.uint8)
    table[0] = 0
    # Four of these are within a byte: so most of it is done on bytes, many at a time.
    looked_up = np.frombuffer(cells.tobytes().translate(table.tobytes()), np.uint8)
    rows = looked_up.reshape(len(cells) // SHRINK, SHRINK, cells.shape[1])
    by_row = rows[:, 0] + rows[:, 1] + rows[:, 2] + rows[:, 3]
    sums = by_row[:, ::SHRINK].astype(np.uint16)
    for first in range(1, SHRINK):
        sums += by_row[:, first::SHRINK]
    whole = _FULL * SHRINK * SHRINK
    means: NDArray[np.uint16] = (sums * np.uint16(_STEPS) + np.uint16(whole // 2)) // whole
    return means
