# SPDX-License-Identifier: Apache-2.0
"""Composite scans: the returns of some metres of the robot's path, as if seen at once.

In a large search window a single scan fits in many places; with its neighbours it is distinct. The
local poses within a few metres are known far better than a pixel.
"""

from __future__ import annotations

import math

import numpy as np

from cartoloop.arrays import FloatArray, IntArray
from cartoloop.config import WideSearchConfig
from cartoloop.global_slam.submap_paths import LOST_M, UNCONNECTED_M
from cartoloop.growing_array import GrowingArray
from cartoloop.kernels.moved_points import moved_points
from cartoloop.sensor.pose import Pose, relative
from cartoloop.sensor.range_filter import thin
from cartoloop.sensor.scan_points import NodePoints, ScanPoints


class CompositeScans:
    """Makes a composite scan every few metres of the robot's path.

    Parameters
    ----------
    config : spacing, length, and the filter of the returns.
    """

    def __init__(self, config: WideSearchConfig) -> None:
        self._config = config
        self._tf_local_node = GrowingArray((3,), np.float64)
        self._travelled = GrowingArray((), np.float64)
        self._newest = GrowingArray((), np.int64)
        self._points = NodePoints()
        self._since = 0.0
        self._begins_session = False

    def __len__(self) -> int:
        return len(self._newest)

    @property
    def nodes(self) -> IntArray:
        """The newest node of each, whose frame it has; int64, shape (n,)."""
        return self._newest.view

    @property
    def points(self) -> ScanPoints:
        """The returns of each [m]."""
        return self._points.view

    @property
    def travelled(self) -> FloatArray:
        """Path length of the robot at each, shape (n,) [m]."""
        lengths: FloatArray = self._travelled.view[self._newest.view]
        return lengths

    @property
    def tf_local_scan(self) -> FloatArray:
        """Pose of each before loop closure, shape (n, 3)."""
        poses: FloatArray = self._tf_local_node.view[self._newest.view]
        return poses

    def begin_session(self) -> None:
        """Note that the next node is the first of another session: no scan has nodes of both."""
        self._begins_session = True

    def add_node(
        self, tf_local_node: Pose, node_points: ScanPoints, *, was_lost: bool = False
    ) -> int | None:
        """Note the next node; return the number of the composite scan that it completes, if any.

        Parameters
        ----------
        node_points : the returns of all nodes, this one included.
        was_lost : whether nothing says how far it is from the node before.
        """
        poses, travelled = self._tf_local_node, self._travelled
        length = 0.0
        if len(poses):
            x, y, _ = poses.view[-1].tolist()
            step = LOST_M if was_lost else math.dist((x, y), tf_local_node[:2])
            length = float(travelled.view[-1]) + (UNCONNECTED_M if self._begins_session else step)
        if self._begins_session or was_lost:
            self._since, self._begins_session = length, False
        poses.append(tf_local_node)
        travelled.append(length)
        if length - self._since < self._config.spacing:
            return None
        self._since = length
        newest = len(poses) - 1
        self._points.append(self._composed(newest, node_points))
        self._newest.append(newest)
        return len(self) - 1

    def _composed(self, newest: int, node_points: ScanPoints) -> FloatArray:
        """Return the returns of the last nodes in the frame of the newest."""
        config, travelled = self._config, self._travelled.view
        oldest, limit = np.searchsorted(
            travelled, travelled[newest] - (config.length, config.max_length)
        ).tolist()
        oldest = max(min(oldest, newest + 1 - config.min_num_scans), limit)
        step = -(-(newest - oldest + 1) // config.max_num_scans)
        tf_local_newest = Pose(*self._tf_local_node.view[newest].tolist())
        parts = []
        for node in range(newest, oldest - 1, -step):
            pose = Pose(*self._tf_local_node.view[node].tolist())
            parts.append(moved_points(*relative(tf_local_newest, pose), node_points[node]))
        return thin(np.concatenate(parts), config.adaptive_voxel_filter)
