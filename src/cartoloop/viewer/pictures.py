# SPDX-License-Identifier: Apache-2.0
"""The map of a state as a PNG file."""

from __future__ import annotations

import asyncio
import io
import math
from time import perf_counter
from typing import TYPE_CHECKING, NamedTuple

from cartoloop.config import SubmapConfig
from cartoloop.map_output.occupancy_map import compose_map
from cartoloop.map_output.picture import draw_map
from cartoloop.sensor.pose import FloatArray
from cartoloop.submaps.finished_grid import FinishedGrid

if TYPE_CHECKING:
    from cartoloop.viewer.feed import Update
    from cartoloop.viewer.live_state import LiveState

_MIN_AGE_S = 5.0
"""Who asks again before that gets the same picture."""


class Drawing(NamedTuple):
    """What a picture is made of: the submaps, where they are, and the robot's way."""

    grids: list[FinishedGrid]
    tf_map_submaps: FloatArray
    trajectory: FloatArray
    config: SubmapConfig


class Pictures:
    """Pictures of a state for who asks: one is made at a time, and not the same one twice.

    To draw a large map takes a processor for a second, which mapping could use.

    Parameters
    ----------
    state : what is drawn.
    """

    def __init__(self, state: LiveState) -> None:
        self._state = state
        self._making = asyncio.Lock()
        self._png = b""
        self._made = -math.inf
        self._shows: Update | None = None

    async def latest(self) -> bytes:
        """Return the map as a PNG file; while it grows, it may be some seconds old.

        Raises
        ------
        OutputError
            The map is too large.
        """
        async with self._making:
            over = self._state.readings.phase in ("finished", "failed")
            is_same = over and self._shows is self._state.last
            is_old = over or perf_counter() - self._made >= _MIN_AGE_S
            if is_old and not is_same:
                shows = self._state.last
                self._png = await asyncio.to_thread(picture_png, self._state.drawing())
                self._made, self._shows = perf_counter(), shows
            return self._png


def picture_png(drawing: Drawing) -> bytes:
    """Return the map with the trajectory as a PNG file.

    Raises
    ------
    OutputError
        The map is too large.
    """
    occupancy_map = compose_map(drawing.grids, drawing.tf_map_submaps, drawing.config)
    buffer = io.BytesIO()
    draw_map(occupancy_map, trajectory=drawing.trajectory).save(buffer, format="png")
    return buffer.getvalue()
