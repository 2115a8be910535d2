# SPDX-License-Identifier: Apache-2.0
"""The map of a state as a PNG file."""

from __future__ import annotations

import io
from typing import NamedTuple

from cartoloop.config import SubmapConfig
from cartoloop.map_output.occupancy_map import compose_map
from cartoloop.map_output.picture import draw_map
from cartoloop.sensor.pose import FloatArray
from cartoloop.submaps.finished_grid import FinishedGrid


class Drawing(NamedTuple):
    """What a picture is made of: the submaps, where they are, and the robot's way."""

    grids: list[FinishedGrid]
    tf_map_submaps: FloatArray
    trajectory: FloatArray
    config: SubmapConfig


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
