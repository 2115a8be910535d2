# SPDX-License-Identifier: Apache-2.0
"""The returns of the nodes, which searches match to submaps."""

from __future__ import annotations

import numpy as np

from cartoloop.arrays import FloatArray
from cartoloop.growing_array import GrowingArray
from cartoloop.sensor.scan_points import ScanPoints


class NodePoints:
    """Keeps the returns of ever more nodes; one thread adds, others may read what there is."""

    def __init__(self) -> None:
        self._points = GrowingArray((2,), np.float64)
        self._bounds = GrowingArray((), np.int64)
        self._bounds.append(0)

    def append(self, points: FloatArray) -> None:
        """Add the returns of the next node, shape (k, 2) [m], tracking frame."""
        self._points.extend(points)
        self._bounds.append(len(self._points))

    @property
    def view(self) -> ScanPoints:
        """The returns of the nodes so far; they stay as they are."""
        bounds = self._bounds.view  # first, so that the points of these nodes are all there
        return ScanPoints(self._points.view, bounds[:-1], bounds[1:])
