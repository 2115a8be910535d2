# SPDX-License-Identifier: Apache-2.0
"""Rectangles that may be turned."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from cartoloop.arrays import BoolArray, FloatArray
from cartoloop.sensor.pose import Pose, compose_all
from cartoloop.sensor.scan_points import ScanPoints


class Rectangle(NamedTuple):
    """A rectangle in some frame.

    Attributes
    ----------
    corner : pose of its lower left corner, x along its lower side.
    width, height : [m].
    """

    corner: Pose
    width: float
    height: float

    def contains(self, points: FloatArray) -> BoolArray:
        """Return which points, shape (n, 2), of that frame are inside."""
        cos, sin = np.cos(self.corner.theta), np.sin(self.corner.theta)
        dx, dy = points[:, 0] - self.corner.x, points[:, 1] - self.corner.y
        along, across = cos * dx + sin * dy, cos * dy - sin * dx
        inside: BoolArray = (
            (along >= 0.0) & (along <= self.width) & (across >= 0.0) & (across <= self.height)
        )
        return inside


def returns_inside(area: Rectangle, points: ScanPoints, node_poses: FloatArray) -> BoolArray:
    """Return which of the returns of all nodes are in a rectangle of the map.

    Parameters
    ----------
    node_poses : shape (n, 3), of the nodes of `points`.
    """
    seen = np.column_stack((points.points, np.zeros(len(points.points))))
    return area.contains(compose_all(np.repeat(node_poses, points.counts, axis=0), seen)[:, :2])
