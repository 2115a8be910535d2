# SPDX-License-Identifier: Apache-2.0
"""Inserts matched scans into the active submaps, and makes nodes of them."""

from __future__ import annotations

import numpy as np

from cartoloop.arrays import FloatArray
from cartoloop.config import AdaptiveVoxelFilterConfig, LocalSlamConfig
from cartoloop.errors import InputError
from cartoloop.journal.outcomes import RunOutcomes
from cartoloop.kernels.moved_points import moved_points
from cartoloop.local_slam.first_map import FirstMap
from cartoloop.local_slam.scan_matcher import MatchedScan
from cartoloop.scan_matching.least_squares import match_information
from cartoloop.sensor.events import LaserScan, PointCloud
from cartoloop.sensor.isolated_returns import without_isolated
from cartoloop.sensor.pose import Pose, compose
from cartoloop.sensor.range_filter import RangeData, thin
from cartoloop.submaps.node import Node
from cartoloop.submaps.probability_grid import NO_POINTS
from cartoloop.submaps.submap import ActiveSubmaps, Submap


class SubmapBuilder:
    """Builds the submaps of a session from scans at their poses in the local frame.

    Parameters
    ----------
    config : parameters of local SLAM.
    node_filter : voxel filter of the points that a node keeps for loop closure; None: none.
    outcomes : of the run; it has the grids of submaps that were finished before.
    first_node, first_submap : indices of the first ones.
    """

    def __init__(
        self,
        config: LocalSlamConfig,
        node_filter: AdaptiveVoxelFilterConfig | None,
        outcomes: RunOutcomes,
        first_node: int,
        first_submap: int,
    ) -> None:
        self._config = config.insertion
        self._node_filter = node_filter
        self._active = ActiveSubmaps(config.submaps, first_submap, outcomes.finished_submaps)
        self._first_map = FirstMap(config)
        self._next_node = first_node

    @property
    def unfinished(self) -> tuple[Submap, ...]:
        """The growing submaps, and those about to be finished, the oldest first."""
        return self._active.unfinished

    @property
    def older(self) -> Submap:
        """The older active submap, which exists once a scan was inserted."""
        return self._active.submaps[0]

    def to_match(self, *, by_odometry: bool) -> Submap:
        """Return what to match a scan to: the older active submap, which exists.

        Instead of a young one, whose pixels may hold the robot, the walls that it shows.

        Parameters
        ----------
        by_odometry : whether the motion prior rests on odometry.
        """
        walls = self._first_map.submap
        return self.older if walls is None or by_odometry else walls

    def information(self, match: MatchedScan | None) -> FloatArray:
        """Return the information matrix of a scan's pose in the older active submap, shape (3, 3).

        Parameters
        ----------
        match : None if the pose is the predicted one.
        """
        if match is not None:
            return match_information(match.match)
        config = self._config
        if self._active.submaps:
            translation, rotation = (
                config.predicted_translation_information,
                config.predicted_rotation_information,
            )
        else:
            translation, rotation = (
                config.first_translation_information,
                config.first_rotation_information,
            )
        return np.diag((translation, translation, rotation))

    def insert(
        self,
        scan: LaserScan | PointCloud,
        data: RangeData,
        tf_local_tracking: Pose,
        information: FloatArray,
        *,
        starts_over: bool,
    ) -> Node:
        """Insert a scan into the active submaps and return its node.

        Parameters
        ----------
        data : ends of its beams.
        information : of its pose, shape (3, 3).
        starts_over : whether both active submaps end before it.

        Raises
        ------
        InputError
            The scan is so far from the previous ones that no submap can hold both.
        """
        try:
            insertion = self._active.insert(
                compose(tf_local_tracking, data.tf_tracking_sensor),
                moved_points(*tf_local_tracking, data.returns),
                moved_points(*tf_local_tracking, data.misses),
                tf_local_robot=tf_local_tracking,
                noise=data.noise,
                starts_over=starts_over,
            )
        except InputError as error:
            raise InputError(f"at the scan with stamp {scan.stamp:.6f}: {error}") from error
        self._first_map.insert(tf_local_tracking, data, insertion.submaps[0])
        node = Node(
            self._next_node,
            scan.time,
            tf_local_tracking,
            self._points_to_keep(data.returns),
            insertion.submaps,
            information,
            insertion.finished,
        )
        self._next_node += 1
        return node

    def _points_to_keep(self, returns: FloatArray) -> FloatArray:
        """Return the returns of a scan that its node keeps, shape (n, 2) [m]."""
        if self._node_filter is None:
            return NO_POINTS
        return thin(without_isolated(returns), self._node_filter)
