# SPDX-License-Identifier: Apache-2.0
"""Parts of a map that are apart, laid beside each other: their relative poses are not known."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple, Protocol

import numpy as np

from cartoloop.arrays import FloatArray, IntArray
from cartoloop.map_data import MapData
from cartoloop.sensor.pose import Pose, transform_points
from cartoloop.session import MAIN_PART

GAP_M = 5.0
"""Distance between two parts [m]."""

GROWING_STEP_M = 10.0
"""A part that grows is moved by whole steps, so that it stands still in between [m]."""


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


class Box(Protocol):
    """The extent of a submap in its frame, as a grid has it."""

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of cells."""

    @property
    def origin_x(self) -> float:
        """Centre of cell (0, 0) [m]."""

    @property
    def origin_y(self) -> float:
        """Centre of cell (0, 0) [m]."""

    @property
    def resolution(self) -> float:
        """Edge of a cell [m]."""


def beside(content: MapData) -> Placed:
    """Return the poses of a map, with each further part to the right of those before it."""
    graph = content.graph
    boxes = dict(enumerate(content.submap_grids))
    offsets = part_offsets(graph.submap_poses, boxes, content.submap_parts)
    last = offsets.get(content.sessions[-1].part, np.zeros(2))
    return Placed(
        moved(graph.submap_poses, content.submap_parts, offsets),
        moved(graph.node_poses, content.node_parts, offsets),
        (float(last[0]), float(last[1])),
    )


def part_offsets(
    submap_poses: FloatArray, boxes: Mapping[int, Box], parts: IntArray, step: float = 0.0
) -> dict[int, FloatArray]:
    """Return by how much each part is moved, shape (2,) each [m].

    Parameters
    ----------
    boxes : extents of the submaps that are drawn, by number.
    parts : of the submaps.
    step : further parts are moved by whole multiples of it [m]; 0: as far as is needed.
    """
    right, bottom = 0.0, 0.0
    offsets: dict[int, FloatArray] = {}
    for part in sorted(set(parts.tolist())):
        of_part = [int(i) for i in np.flatnonzero(parts == part) if int(i) in boxes]
        if not of_part:
            continue
        lower, upper = _extent(submap_poses, boxes, of_part)
        offset = np.zeros(2)
        if part != MAIN_PART:
            offset = np.array((right + GAP_M, bottom)) - lower
            offset = np.ceil(offset / step) * step if step else offset
        else:
            bottom = float(lower[1])
        offsets[part] = offset
        right = float(upper[0] + offset[0])
    return offsets


def moved(poses: FloatArray, parts: IntArray, offsets: Mapping[int, FloatArray]) -> FloatArray:
    """Return poses, shape (n, 3), each moved with its part."""
    found = poses.copy()
    for part, offset in offsets.items():
        found[parts == part, :2] += offset
    return found


def _extent(
    submap_poses: FloatArray, boxes: Mapping[int, Box], submaps: Sequence[int]
) -> tuple[FloatArray, FloatArray]:
    """Return the lower left and the upper right corner of some submaps [m]."""
    corners = []
    for submap in submaps:
        grid = boxes[submap]
        height, width = (size * grid.resolution for size in grid.shape)
        origin = np.array((grid.origin_x, grid.origin_y))
        box = origin + np.array([(0.0, 0.0), (width, 0.0), (width, height), (0.0, height)])
        corners.append(transform_points(Pose(*submap_poses[submap].tolist()), box))
    together = np.concatenate(corners)
    return together.min(axis=0), together.max(axis=0)
