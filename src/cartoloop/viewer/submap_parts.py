# SPDX-License-Identifier: Apache-2.0
"""The submaps of the state: textures of growing and finished ones, previews of finished ones."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from numpy.typing import NDArray

from cartoloop.viewer.previews import Preview
from cartoloop.viewer.textures import FinishedTexture, GrowingTexture

if TYPE_CHECKING:
    from cartoloop.submaps.finished_grid import FinishedGrid
    from cartoloop.viewer.feed import GrowingCells

_THREADS = 4
"""Threads that compress many submaps at once, as when a finished map is opened."""

_FEW = 2
"""Up to this number of submaps, to start threads takes longer than to compress."""

_Made = TypeVar("_Made")


class SubmapParts:
    """The parts of the state that belong to submaps.

    Parameters
    ----------
    log_odds : float32 (256,), evidence of each value of a cell.

    Attributes
    ----------
    growing : textures of the submaps that scans are still inserted into.
    finished : grids of the finished submaps.
    """

    def __init__(self, log_odds: NDArray[np.float32]) -> None:
        self.growing: dict[int, GrowingTexture] = {}
        self.finished: dict[int, FinishedGrid] = {}
        self._log_odds = log_odds

    def grow(self, active: Iterable[GrowingCells]) -> dict[int, GrowingTexture]:
        """Take in the cells of growing submaps; return the textures that have changed."""
        changed = {}
        for grid in active:
            if grid.submap in self.finished:
                continue
            texture = self.growing.setdefault(grid.submap, GrowingTexture(grid.submap))
            if texture.set(grid):
                changed[grid.submap] = texture
        return changed

    def finish(
        self, grids: Mapping[int, FinishedGrid]
    ) -> dict[int, tuple[Preview, FinishedTexture]]:
        """Take in finished submaps; return preview and texture of those that are new."""
        new = {submap: grid for submap, grid in grids.items() if submap not in self.finished}

        def parts(submap: int) -> tuple[Preview, FinishedTexture]:
            growing = self.growing.get(submap)
            version = growing.version + 1 if growing else 1
            grid = new[submap]
            return Preview(submap, grid, self._log_odds), FinishedTexture(submap, version, grid)

        made = dict(zip(new, _map_all(parts, list(new)), strict=True))
        self.finished |= new
        for submap in new:
            self.growing.pop(submap, None)
        return made

    def grids(self) -> dict[int, FinishedGrid]:
        """Return the grids of all submaps by number, growing ones as they were drawn last."""
        drawn = {submap: texture.grid() for submap, texture in self.growing.items()}
        return dict(sorted((drawn | self.finished).items()))


def _map_all(make: Callable[[int], _Made], submaps: Sequence[int]) -> Iterable[_Made]:
    """Return the result for each submap, computed in threads where there are many."""
    if len(submaps) <= _FEW:
        return [make(submap) for submap in submaps]
    with ThreadPoolExecutor(_THREADS) as threads:
        return list(threads.map(make, submaps))
