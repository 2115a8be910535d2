# SPDX-License-Identifier: Apache-2.0
"""Local SLAM (section IV): match each scan to the older active submap, insert it into both."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cartoloop.config import Config
from cartoloop.local_slam.motion_filter import MotionFilter
from cartoloop.local_slam.pose_extrapolator import PoseExtrapolator
from cartoloop.local_slam.scan_matcher import MatchedScan, ScanMatcher
from cartoloop.scan_matching.match_information import match_information
from cartoloop.sensor.events import Imu, LaserScan, Odometry
from cartoloop.sensor.pose import FloatArray, Pose, compose, transform_points
from cartoloop.sensor.range_filter import RangeData, RangeFilter, thin
from cartoloop.stage_timer import StageTimer
from cartoloop.submaps.node import Node
from cartoloop.submaps.submap import ActiveSubmaps, Submap

MIN_RETURNS = 10
"""A scan with fewer returns cannot be matched; it gets the predicted pose."""

FIRST_INFORMATION = np.diag((1e4, 1e4, 1e5))
"""Certainty of a scan's pose in the submap that it founds: by definition, so nearly perfect."""


@dataclass(frozen=True, slots=True)
class LocalSlamResult:
    """Where a scan was taken, and the node that it became.

    Attributes
    ----------
    tf_local_tracking : its pose before loop closure.
    was_matched : False where there were too few returns, so that the pose is as predicted.
    node : None unless the scan was inserted into the submaps.
    returns : float64, shape (n, 2), what it saw [m], tracking frame.
    """

    tf_local_tracking: Pose
    was_matched: bool
    node: Node | None
    returns: FloatArray


class LocalSlam:
    """Turns scans into poses in the local frame, and into submaps."""

    def __init__(self, config: Config, timer: StageTimer) -> None:
        self._config = config.local_slam
        self._loop_filter = config.global_slam.constraint_search.adaptive_voxel_filter
        self._timer = timer
        self._range_filter = RangeFilter(config.sensor)
        self._motion_filter = MotionFilter(self._config.motion_filter)
        self._matcher = ScanMatcher(self._config)
        self._active = ActiveSubmaps(self._config.submaps)
        self._num_nodes = 0
        self.extrapolator = PoseExtrapolator(
            self._config.prediction, use_odometry=self._config.use_odometry
        )

    @property
    def active_submaps(self) -> tuple[Submap, ...]:
        """The submaps that still grow, the older first."""
        return self._active.submaps

    def add_odometry(self, odometry: Odometry) -> None:
        """Take in a wheel-odometry reading."""
        self.extrapolator.add_odometry(odometry.time, odometry.tf_odom_tracking)

    def add_imu(self, imu: Imu) -> None:
        """Take in an inertial reading."""
        self.extrapolator.add_imu(imu)

    def add_scan(self, scan: LaserScan) -> LocalSlamResult:
        """Match a scan and insert it where it shows something new."""
        with self._timer.measure("filter"):
            data = self._range_filter.apply(scan)
            points = thin(data.returns, self._config.adaptive_voxel_filter)
        with self._timer.measure("predict"):
            prediction = self.extrapolator.predict(scan.time)
        found: MatchedScan | None = None
        submap = self._active.matching
        if submap is not None and len(points) >= MIN_RETURNS:
            with self._timer.measure("match"):
                found = self._matcher.match(
                    submap, points, prediction, self.extrapolator, scan.time
                )
        tf_local_tracking = found.tf_local_tracking if found else prediction.tf_local_tracking
        with self._timer.measure("predict"):
            self.extrapolator.add_pose(scan.time, tf_local_tracking)
        node = None
        if (
            found or (submap is None and len(points) >= MIN_RETURNS)
        ) and self._motion_filter.is_new(scan.time, tf_local_tracking):
            information = match_information(found.match) if found else FIRST_INFORMATION
            with self._timer.measure("insert"):
                node = self._insert(scan.time, data, tf_local_tracking, information)
        return LocalSlamResult(tf_local_tracking, found is not None, node, data.returns)

    def _insert(
        self, time: float, data: RangeData, tf_local_tracking: Pose, information: FloatArray
    ) -> Node:
        insertion = self._active.insert(
            compose(tf_local_tracking, data.tf_tracking_sensor),
            transform_points(tf_local_tracking, data.returns),
            transform_points(tf_local_tracking, data.misses),
        )
        node = Node(
            self._num_nodes,
            time,
            tf_local_tracking,
            thin(data.returns, self._loop_filter),
            insertion.submaps,
            information,
            insertion.finished,
        )
        self._num_nodes += 1
        return node
