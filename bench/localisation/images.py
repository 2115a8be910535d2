# SPDX-License-Identifier: Apache-2.0
"""Maps as a reader of their image alone sees them."""

from __future__ import annotations

import numpy as np

from cartoloop.evaluation.map_image import MapImage
from cartoloop.localisation.known_map import KnownMap, known_map_of, known_map_of_image
from cartoloop.map_output.occupancy_map import OccupancyMap
from cartoloop.result import Result
from cartoloop.sensor.pose import Pose

OURS, IMAGE = "ours", "pgm and yaml"
"""What of a map is given: all of it, or its image."""


def known_maps_of(result: Result, name: str = "the map") -> dict[str, KnownMap]:
    """Return a map for localisation, by what is given of it."""
    return {OURS: known_map_of(result, name), IMAGE: known_map_as_image(result)}


def known_map_as_image(result: Result) -> KnownMap:
    """Return a map as a reader of its ``map.pgm`` and ``map.yaml`` sees it."""
    options = result.config.map_output
    return known_map_of_image(
        _image_of(result.occupancy_map(), options.occupied_thresh, options.free_thresh)
    )


def _image_of(occupancy_map: OccupancyMap, occupied: float, free: float) -> MapImage:
    probability = occupancy_map.probability
    occupancy = np.full(probability.shape, -1.0, dtype=np.float32)
    occupancy[(probability >= 0.0) & (probability < free)] = 0.0
    occupancy[probability > occupied] = 1.0
    origin = Pose(occupancy_map.origin_x, occupancy_map.origin_y, 0.0)
    return MapImage(occupancy, occupancy_map.resolution, origin, 0.65, 0.196)
