# SPDX-License-Identifier: Apache-2.0
"""Map images drawn by hand: pixels as a mapper would leave them, without one."""

from __future__ import annotations

import numpy as np

from cartoloop.evaluation.map_image import MapImage
from cartoloop.sensor.pose import Pose

FREE, UNKNOWN_SHADE, OCCUPIED = 0.004, 0.19608, 1.0
RESOLUTION = 0.05
UNMOVED = Pose(0.0, 0.0, 0.0)


def unknown_map(width, height, origin=UNMOVED, resolution=RESOLUTION):
    """An image of this size [m] in which nothing is known."""
    shape = (round(height / resolution), round(width / resolution))
    occupancy = np.full(shape, UNKNOWN_SHADE, np.float32)
    return MapImage(occupancy, resolution, origin, occupied_thresh=0.65, free_thresh=0.196)


def pixel_centres(image):
    """Centres of all pixels in the image's own axes [m], shape (rows, cols, 2)."""
    rows, cols = image.occupancy.shape
    x, y = np.meshgrid(np.arange(cols) + 0.5, np.arange(rows) + 0.5)
    return np.dstack((x, y)) * image.resolution


def draw_wall(image, start, end, value=OCCUPIED):
    """Darken the pixels in which the hits on a wall's face fall; image axes [m]."""
    start, end = np.asarray(start), np.asarray(end)
    num_hits = int(np.hypot(*(end - start)) / image.resolution * 10) + 2
    hits = start + np.linspace(0.0, 1.0, num_hits)[:, np.newaxis] * (end - start)
    col, row = np.floor(hits / image.resolution + 1e-9).astype(int).T
    image.occupancy[row, col] = value


def room(width, depth, centre=(5.0, 5.0), angle=0.0, size=10.0, thickness=1, **frame):
    """A room seen from inside: free floor, walls of some layers of hits, the rest unknown."""
    image = unknown_map(size, size, **frame)
    u, v = np.array((np.cos(angle), np.sin(angle))), np.array((-np.sin(angle), np.cos(angle)))
    offset = pixel_centres(image) - centre
    inside = (np.abs(offset @ u) < width / 2) & (np.abs(offset @ v) < depth / 2)
    image.occupancy[inside] = FREE
    for layer in np.arange(thickness) * image.resolution * 0.9:
        half_u, half_v = (width / 2 + layer) * u, (depth / 2 + layer) * v
        corners = [
            centre + a * half_u + b * half_v for a, b in ((1, 1), (-1, 1), (-1, -1), (1, -1))
        ]
        for start, end in zip(corners, [*corners[1:], corners[0]], strict=True):
            draw_wall(image, start, end)
    return image
