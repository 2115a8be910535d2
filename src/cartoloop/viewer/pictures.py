# SPDX-License-Identifier: Apache-2.0
"""The map of a state as a PNG file."""

from __future__ import annotations

import asyncio
import io
import math
from time import perf_counter
from typing import NamedTuple, Protocol

from cartoloop.arrays import FloatArray
from cartoloop.config import SubmapConfig
from cartoloop.map_output.occupancy_map import compose_map
from cartoloop.map_output.picture import draw_map
from cartoloop.submaps.finished_grid import FinishedGrid

_MIN_AGE_S = 5.0
"""While the map grows, a picture younger than this is not drawn again [s]: a large one takes a
processor for a second."""


class Drawing(NamedTuple):
    """What a picture is made of: the submaps, their poses, the robot's trajectory, the caption."""

    grids: list[FinishedGrid]
    tf_map_submaps: FloatArray
    trajectory: FloatArray
    config: SubmapConfig
    caption: list[str]


class Drawable(Protocol):
    """What pictures are drawn of: the state of the view."""

    @property
    def version(self) -> object:
        """An object that is replaced when the map changes."""

    @property
    def is_over(self) -> bool:
        """Whether the map is finished."""

    def drawing(self) -> Drawing:
        """Return what a picture of the present map is made of."""


class Pictures:
    """Pictures of a state: one is drawn at a time, and the same one is not drawn twice.

    Parameters
    ----------
    state : what is drawn.
    """

    def __init__(self, state: Drawable) -> None:
        self._state = state
        self._making = asyncio.Lock()
        self._png = b""
        self._made = -math.inf
        self._version: object = None

    async def latest(self) -> bytes:
        """Return the map as a PNG file; while it grows, it may be some seconds old.

        Raises
        ------
        OutputError
            The map is too large.
        """
        async with self._making:
            over = self._state.is_over
            is_same = over and self._version is self._state.version
            is_old = over or perf_counter() - self._made >= _MIN_AGE_S
            if is_old and not is_same:
                version = self._state.version
                self._png = await asyncio.to_thread(picture_png, self._state.drawing())
                self._made, self._version = perf_counter(), version
            return self._png


def picture_png(drawing: Drawing) -> bytes:
    """Return the map with caption and trajectory as a PNG file.

    Raises
    ------
    OutputError
        The map is too large.
    """
    occupancy_map = compose_map(drawing.grids, drawing.tf_map_submaps, drawing.config)
    buffer = io.BytesIO()
    picture = draw_map(occupancy_map, trajectory=drawing.trajectory, caption=drawing.caption)
    picture.save(buffer, format="png")
    return buffer.getvalue()
