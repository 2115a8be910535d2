# SPDX-License-Identifier: Apache-2.0
"""A map for localisation as pages draw it: blocks of its grid, as finished submaps."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cartoloop.localisation.known_map import KnownMap
from cartoloop.submaps.finished_grid import MAX_PROBABILITY, MAX_STEPS, MIN_PROBABILITY
from cartoloop.viewer.parts import Latest
from cartoloop.viewer.previews import Preview
from cartoloop.viewer.protocol import Texture, submap_message

if TYPE_CHECKING:
    from cartoloop.sensor.pose import Pose

BLOCK_CELLS = 512
"""Edge of a block [cells]: some of a large map are out of sight, and none exceeds a texture."""

CLARITY = 2.0
"""Factor on the log-odds of cells: at the edge of a block half of them is still clear."""


class Block(NamedTuple):
    """A part of the map, as parts of the state."""

    preview: Preview
    cells: Latest


def known_log_odds() -> NDArray[np.float32]:
    """Return the evidence of each value of a cell of a known map, float32 (256,)."""
    span = MAX_PROBABILITY - MIN_PROBABILITY
    probability = MIN_PROBABILITY + np.arange(-1, 255) / MAX_STEPS * span
    log_odds = CLARITY * np.log(probability / (1.0 - probability))
    log_odds[0] = 0.0
    return log_odds.astype(np.float32)


def blocks_of(known: KnownMap, log_odds: NDArray[np.float32]) -> Iterator[Block]:
    """Yield the blocks of a map in which anything is known; their frame is that of its grid."""
    grid = known.grid
    cells = grid.cells
    rows, cols = cells.shape
    number = 0
    for row in range(0, rows, BLOCK_CELLS):
        for col in range(0, cols, BLOCK_CELLS):
            part = cells[row : row + BLOCK_CELLS, col : col + BLOCK_CELLS]
            if not part.any():
                continue
            texture = Texture(
                np.ascontiguousarray(part),
                grid.origin_x + col * grid.resolution,
                grid.origin_y + row * grid.resolution,
                grid.resolution,
            )
            block = Block(Preview(number, texture, log_odds), Latest())
            block.cells.set(submap_message(number, 1, texture, finished=True))
            yield block
            number += 1


def is_on_map(known: KnownMap, tf_map: Pose, margin: float) -> bool:
    """Return whether a position lies in the rectangle of a map, or that near to it [m]."""
    at = known.to_grid(tf_map)
    grid = known.grid
    rows, cols = grid.shape
    return math.isfinite(at.x + at.y) and (
        -margin <= at.x - grid.origin_x <= cols * grid.resolution + margin
        and -margin <= at.y - grid.origin_y <= rows * grid.resolution + margin
    )
