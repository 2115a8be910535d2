# SPDX-License-Identifier: Apache-2.0
"""Submaps as pages draw them: whole when they are finished, in patches while they grow."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from cartoloop.kernels.map_composition import abstain_beside_walls
from cartoloop.submaps.finished_grid import FinishedGrid, quantize_probabilities
from cartoloop.viewer.feed import GrowingCells
from cartoloop.viewer.protocol import Texture, patch_message, submap_message

if TYPE_CHECKING:
    from cartoloop.viewer.parts import Token

MAX_PATCHES = 32
"""Changes of a growing submap that are kept as patches; a page that missed more gets all cells."""

Box = tuple[int, int, int, int]
"""First row, end row, first column, end column."""


def drawn_cells(cells: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return cells whose evidence is that which they add to the map, shape as given.

    Those that are free beside a wall abstain, as in :func:`cell_evidence` when a map is composed.

    Parameters
    ----------
    cells : uint8, shape (rows, cols), of a :class:`FinishedGrid`.
    """
    drawn = np.empty(cells.shape, dtype=np.uint8)
    abstain_beside_walls(np.ascontiguousarray(cells), drawn)
    return drawn


class FinishedTexture:
    """A submap that will not change any more; a part of the state."""

    def __init__(self, submap: int, version: int, grid: FinishedGrid | Texture) -> None:
        self._submap = submap
        self._grid: FinishedGrid | Texture | None = grid
        self._message = b""
        self._token = (0, version)

    def news(self, seen: Token | None) -> tuple[bytes, Token]:
        """Return all of it, unless it was seen."""
        if seen == self._token:
            return b"", self._token
        if not self._message:
            self.make()
        return self._message, self._token

    def make(self) -> None:
        """Make the message, which takes 10 ms, before a page asks for it; for any thread."""
        if (grid := self._grid) is None:
            return
        texture = Texture(drawn_cells(grid.cells), grid.origin_x, grid.origin_y, grid.resolution)
        self._message = submap_message(self._submap, self._token[1], texture, finished=True)
        self._grid = None


class GrowingTexture:
    """A submap that scans are still inserted into; a part of the state."""

    def __init__(self, submap: int) -> None:
        self.version = 0
        self._submap = submap
        self._whole_since = 1  # version from which on patches apply to what there was
        self._place = (0.0, 0.0, 0.0)
        self._seen = np.zeros((0, 0), np.float32)  # the cells that were drawn
        self._values = np.zeros((0, 0), np.uint8)
        self._drawn = np.zeros((0, 0), np.uint8)
        self._boxes: dict[int, Box] = {}
        self._made: dict[int, bytes] = {}

    def set(self, grid: GrowingCells) -> bool:
        """Update from the present grid; return whether it has changed."""
        place = (grid.origin_x, grid.origin_y, grid.resolution)
        if grid.cells.shape != self._seen.shape or place != self._place:
            self._place = place
            self._seen = np.zeros(grid.cells.shape, np.float32)
            self._values = np.zeros(grid.cells.shape, np.uint8)
            self._drawn = np.zeros(grid.cells.shape, np.uint8)
            self._boxes.clear()
            self._whole_since = self.version + 1
        changed = np.flatnonzero(grid.cells != self._seen)
        if len(changed) == 0:
            return False
        now = grid.cells.reshape(-1)[changed]
        self._seen.reshape(-1)[changed] = now
        self._values.reshape(-1)[changed] = quantize_probabilities(now)
        rows, cols = np.divmod(changed, grid.cells.shape[1])
        box = int(rows[0]), int(rows[-1]) + 1, int(cols.min()), int(cols.max()) + 1
        self._boxes[self.version + 1] = self._draw(box)
        self._boxes.pop(self.version + 1 - MAX_PATCHES, None)
        self.version += 1
        self._made.clear()
        return True

    def news(self, seen: Token | None) -> tuple[bytes, Token]:
        """Return the rectangle that has changed since, or all where that is not known."""
        since, token = seen[1] if seen else 0, (0, self.version)
        if since == self.version:
            return b"", token
        if since not in self._made:
            self._made[since] = self._message(since)
        return self._made[since], token

    def grid(self) -> FinishedGrid:
        """Return the grid as it was drawn last."""
        return FinishedGrid(self._values, *self._place)

    def _draw(self, changed: Box) -> Box:
        """Draw what a change touches, one cell more on each side; return that box.

        A cell's effect on its neighbours does not depend on its own neighbours.
        """
        num_rows, num_cols = self._values.shape
        touched = _grown(changed, 1, num_rows, num_cols)
        seen = _grown(changed, 2, num_rows, num_cols)
        drawn = drawn_cells(self._values[seen[0] : seen[1], seen[2] : seen[3]])
        self._drawn[touched[0] : touched[1], touched[2] : touched[3]] = drawn[
            touched[0] - seen[0] : touched[1] - seen[0],
            touched[2] - seen[2] : touched[3] - seen[2],
        ]
        return touched

    def _message(self, since: int) -> bytes:
        missed = range(since + 1, self.version + 1)
        if since < self._whole_since or any(version not in self._boxes for version in missed):
            texture = Texture(self._drawn, *self._place)
            return submap_message(self._submap, self.version, texture, finished=False)
        boxes = np.array([self._boxes[version] for version in missed])
        first_row, _, first_col, _ = boxes.min(axis=0).tolist()
        _, end_row, _, end_col = boxes.max(axis=0).tolist()
        cells = self._drawn[first_row:end_row, first_col:end_col]
        return patch_message(self._submap, since, self.version, (first_row, first_col), cells)


def _grown(box: Box, by: int, num_rows: int, num_cols: int) -> Box:
    return (
        max(box[0] - by, 0),
        min(box[1] + by, num_rows),
        max(box[2] - by, 0),
        min(box[3] + by, num_cols),
    )
