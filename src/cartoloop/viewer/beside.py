# SPDX-License-Identifier: Apache-2.0
"""Parts of a map that are apart, laid beside each other: their relative poses are not known."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cartoloop.arrays import FloatArray, IntArray
from cartoloop.map_data import MapData
from cartoloop.sensor.pose import Pose, transform_points
from cartoloop.session import MAIN_PART

GAP_M = 5.0
"""Distance between two parts [m]."""


class Placed(NamedTuple):
    """Where submaps and nodes are drawn.

    Attributes
    ----------
    submap_poses, node_poses : float64 (m, 3), (n, 3); those of the main part are in the map frame.
    last_offset : by how much the part of the last scan was moved [m].
    """

    submap_poses: FloatArray
    node_poses: FloatArray
    last_offset: tuple[float, float]


def beside(content: MapData) -> Placed:
    """Return the poses of a map, with each further part to the right of those before it."""
    submaps, nodes = content.graph.submap_poses.copy(), content.graph.node_poses.copy()
    parts = sorted({session.part for session in content.sessions})
    right, bottom, last = 0.0, 0.0, (0.0, 0.0)
    for part in parts:
        of_part = np.flatnonzero(content.submap_parts == part)
        if len(of_part) == 0:
            continue
        lower, upper = _extent(content, of_part)
        offset = np.zeros(2)
        if part != MAIN_PART:
            offset = np.array((right + GAP_M, bottom)) - lower
            submaps[of_part, :2] += offset
            nodes[content.node_parts == part, :2] += offset
        else:
            bottom = float(lower[1])
        right = float(upper[0] + offset[0])
        if part == content.sessions[-1].part:
            last = float(offset[0]), float(offset[1])
    return Placed(submaps, nodes, last)


def _extent(content: MapData, submaps: IntArray) -> tuple[FloatArray, FloatArray]:
    """Return the lower left and the upper right corner of some submaps [m]."""
    corners = []
    for submap in submaps.tolist():
        grid = content.submap_grids[submap]
        height, width = (size * grid.resolution for size in grid.shape)
        origin = np.array((grid.origin_x, grid.origin_y))
        box = origin + np.array([(0.0, 0.0), (width, 0.0), (width, height), (0.0, height)])
        corners.append(transform_points(Pose(*content.graph.submap_poses[submap].tolist()), box))
    together = np.concatenate(corners)
    return together.min(axis=0), together.max(axis=0)
