# SPDX-License-Identifier: Apache-2.0
"""The map as ROS's map_server reads it: an image and a YAML file with its pose."""

from __future__ import annotations

import numpy as np

from cartoloop.config import MapOutputConfig
from cartoloop.map_output.occupancy_map import OccupancyMap

OCCUPIED_SHADE, UNKNOWN_SHADE, FREE_SHADE = 0, 205, 254

_UNKNOWN_OCCUPANCY = 1.0 - UNKNOWN_SHADE / 255.0  # 0.19608: what readers make of the shade


def pgm_bytes(occupancy_map: OccupancyMap, config: MapOutputConfig) -> bytes:
    """Return the map as a binary PGM image: occupied 0, free 254, unknown and undecided 205.

    The first row is the top of the map, i.e. the largest y.
    """
    probability = occupancy_map.probability
    rows, cols = probability.shape
    shades = np.full((rows, cols), UNKNOWN_SHADE, dtype=np.uint8)
    shades[(probability >= 0.0) & (probability < config.free_thresh)] = FREE_SHADE
    shades[probability > config.occupied_thresh] = OCCUPIED_SHADE
    header = f"P5\n# {occupancy_map.resolution:g} m/pixel\n{cols} {rows}\n255\n"
    return header.encode("ascii") + shades[::-1].tobytes()


def yaml_text(occupancy_map: OccupancyMap, config: MapOutputConfig, image: str) -> str:
    """Return the YAML file that goes with the image named `image`.

    Readers compare the image's shades with these thresholds. The shade 205 of unknown cells must be
    neither free nor occupied, for any thresholds on the probabilities.
    """
    free_thresh = min(config.free_thresh, 0.196)
    occupied_thresh = max(config.occupied_thresh, 0.2)
    assert free_thresh < _UNKNOWN_OCCUPANCY < occupied_thresh
    # to 1e-9 m, which takes off the tails that multiples of the resolution have
    origin_x, origin_y = round(occupancy_map.origin_x, 9), round(occupancy_map.origin_y, 9)
    return (
        f"image: {image}\n"
        "mode: trinary\n"
        f"resolution: {occupancy_map.resolution!r}\n"
        f"origin: [{origin_x!r}, {origin_y!r}, 0.0]\n"
        "negate: 0\n"
        f"occupied_thresh: {occupied_thresh!r}\n"
        f"free_thresh: {free_thresh!r}\n"
    )
