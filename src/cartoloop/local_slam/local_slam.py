# SPDX-License-Identifier: Apache-2.0
"""Local SLAM (section IV): match each scan to the older active submap, insert it into both."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from cartoloop.config import Config
from cartoloop.errors import InputError
from cartoloop.local_slam.motion_filter import MotionFilter
from cartoloop.local_slam.pose_extrapolator import PoseExtrapolator, Prediction
from cartoloop.local_slam.scan_matcher import MatchedScan, ScanMatcher
from cartoloop.scan_matching.least_squares import LeastSquaresMatch
from cartoloop.scan_matching.match_information import match_information
from cartoloop.sensor.events import Imu, LaserScan, Odometry, PointCloud
from cartoloop.sensor.pose import FloatArray, Pose, compose, transform_points
from cartoloop.sensor.range_filter import RangeData, RangeFilter, thin
from cartoloop.sensor.sweep_motion import SweepMotion
from cartoloop.stage_timer import StageTimer
from cartoloop.submaps.node import Node
from cartoloop.submaps.submap import ActiveSubmaps, Submap

MIN_RETURNS = 10
"""A scan with fewer returns cannot be matched; it gets the predicted pose."""

FIRST_INFORMATION = np.diag((1e4, 1e4, 1e5))
"""Certainty of a scan's pose in the submap that it founds: by definition, so nearly perfect."""

PREDICTED_INFORMATION = np.diag((400.0, 400.0, 2500.0))
"""Certainty of the first scan of a further scanner, which is placed as predicted."""


@dataclass(frozen=True, slots=True)
class LocalSlamResult:
    """Where a scan was taken, and the node that it became.

    Attributes
    ----------
    tf_local_tracking : its pose before loop closure.
    was_matched : False where there were too few returns, so that the pose is as predicted.
    node : None unless the scan was inserted into the submaps.
    returns : float64, shape (n, 2), what it saw [m], tracking frame.
    match : the match to the older active submap, None where it was not matched.
    """

    tf_local_tracking: Pose
    was_matched: bool
    node: Node | None
    returns: FloatArray
    match: LeastSquaresMatch | None = None


@dataclass(slots=True)
class _Scanner:
    """What is kept for each scanner by itself.

    Attributes
    ----------
    matcher : knows how well its scans usually fit.
    motion_filter : lets each scanner contribute what it sees.
    num_scans : how many it took.
    is_in_map : whether one of its scans was inserted.
    """

    matcher: ScanMatcher
    motion_filter: MotionFilter
    num_scans: int = 0
    is_in_map: bool = False


class LocalSlam:
    """Turns scans into poses in the local frame, and into submaps."""

    def __init__(self, config: Config, timer: StageTimer) -> None:
        self._config = config.local_slam
        self._loop_filter = config.global_slam.constraint_search.adaptive_voxel_filter
        self._timer = timer
        self._range_filter = RangeFilter(config.sensor)
        self._scanners: dict[str, _Scanner] = {}
        self._active = ActiveSubmaps(self._config.submaps)
        self._num_nodes = 0
        self.extrapolator = PoseExtrapolator(
            self._config.prediction,
            use_odometry=self._config.use_odometry,
            use_imu=self._config.use_imu,
            imu_gravity_time_constant=self._config.imu_gravity_time_constant,
            project_to_horizontal=self._config.project_to_horizontal,
        )

    @property
    def active_submaps(self) -> tuple[Submap, ...]:
        """The submaps that still grow, the older first."""
        return self._active.submaps

    @property
    def num_scans_of(self) -> dict[str, int]:
        """How many scans each scanner took, by its name."""
        return {name: scanner.num_scans for name, scanner in sorted(self._scanners.items())}

    def add_odometry(self, odometry: Odometry) -> None:
        """Take in a wheel-odometry reading."""
        self.extrapolator.add_odometry(odometry.time, odometry.tf_odom_tracking)

    def add_imu(self, imu: Imu) -> None:
        """Take in an inertial reading."""
        self.extrapolator.add_imu(imu)

    def add_scan(
        self, scan: LaserScan | PointCloud, on_pose: Callable[[Pose], None] | None = None
    ) -> LocalSlamResult:
        """Match a scan and insert it where it shows something new.

        Parameters
        ----------
        on_pose : called with the scan's pose, local frame, as soon as it is known: whoever waits
            for it need not wait until the scan is inserted.

        Raises
        ------
        InputError
            It seems to be so far from the scans before that no submap can hold both.
        """
        scanner = self._scanner_of(scan)
        with self._timer.measure("filter"):
            motion = self.extrapolator.sweep_motion(scan.time, *scan.sweep)
            data = self._range_filter.apply(scan, motion)
            points = thin(data.returns, self._config.adaptive_voxel_filter)
        with self._timer.measure("predict"):
            prediction = self.extrapolator.predict(scan.time)
        found: MatchedScan | None = None
        submap = self._active.matching
        shows_enough = len(points) >= MIN_RETURNS
        # The first scan of another scanner may look where nothing is mapped yet.
        is_first = submap is None or not scanner.is_in_map
        if submap is not None and shows_enough and not is_first:
            with self._timer.measure("match"):
                found = scanner.matcher.match(
                    submap, points, prediction, self.extrapolator, scan.time
                )
            corrected = self.extrapolator.corrected_motion(
                scan.time, found.tf_local_tracking, motion
            )
            if corrected is not None:
                motion = corrected
                data, found = self._match_again(scan, motion, submap, found, scanner.matcher)
        tf_local_tracking = found.tf_local_tracking if found else prediction.tf_local_tracking
        if on_pose is not None:
            on_pose(tf_local_tracking)
        with self._timer.measure("predict"):
            self.extrapolator.add_pose(scan.time, tf_local_tracking, motion)
        node = None
        if (found or (is_first and shows_enough)) and scanner.motion_filter.is_new(
            scan.time, tf_local_tracking
        ):
            information = PREDICTED_INFORMATION if submap else FIRST_INFORMATION
            if found:
                information = match_information(found.match)
            try:
                with self._timer.measure("insert"):
                    node = self._insert(scan.time, data, tf_local_tracking, information)
            except InputError as error:
                raise InputError(f"at the scan with stamp {scan.stamp:.6f}: {error}") from error
            scanner.is_in_map = True
        return LocalSlamResult(
            tf_local_tracking,
            found is not None,
            node,
            data.returns,
            None if found is None else found.match,
        )

    def _match_again(
        self,
        scan: LaserScan | PointCloud,
        motion: SweepMotion,
        submap: Submap,
        found: MatchedScan,
        matcher: ScanMatcher,
    ) -> tuple[RangeData, MatchedScan]:
        """Return a scan's beams, and where it fits, for a motion of which the match has told."""
        with self._timer.measure("filter"):
            data = self._range_filter.apply(scan, motion)
            points = thin(data.returns, self._config.adaptive_voxel_filter)
        if len(points) < MIN_RETURNS:
            return data, found
        prediction = Prediction(found.tf_local_tracking, by_odometry=False)
        with self._timer.measure("match"):
            again = matcher.match(submap, points, prediction, self.extrapolator, scan.time)
        return data, again

    def _scanner_of(self, scan: LaserScan | PointCloud) -> _Scanner:
        """Return what is kept for the scanner of a scan, and count the scan."""
        name = scan.geometry.sensor
        scanner = self._scanners.get(name)
        if scanner is None:
            scanner = self._scanners[name] = _Scanner(
                ScanMatcher(self._config), MotionFilter(self._config.motion_filter)
            )
        scanner.num_scans += 1
        return scanner

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
