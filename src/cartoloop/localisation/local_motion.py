# SPDX-License-Identifier: Apache-2.0
"""How a robot moves by its own scans: local SLAM, and the latest metres of the path."""

from __future__ import annotations

import dataclasses
import math
from collections import deque
from typing import NamedTuple

import numpy as np

from cartoloop.arrays import BoolArray, FloatArray
from cartoloop.config import Config
from cartoloop.errors import InputError
from cartoloop.local_slam.gap import is_gap
from cartoloop.local_slam.local_slam import LocalSlam
from cartoloop.local_slam.sensor_calibration import SensorCalibration
from cartoloop.localisation.decision import MIN_POINTS
from cartoloop.localisation.moving_returns import MovingReturns
from cartoloop.localisation.trail import SCAN_FILTER, Trail
from cartoloop.localisation.unseen_motion import MotionError, UnseenMotion, unseen_error
from cartoloop.runtime.stage_timer import StageTimer
from cartoloop.sensor.events import Imu, LaserScan, Odometry, PointCloud
from cartoloop.sensor.pose import Pose, compose, relative, transform_points
from cartoloop.sensor.range_filter import thin

COVER_M = 0.6
"""A scan with fewer returns than `MIN_POINTS` beyond this distance [m] is of a cover, or of the
robot itself: it goes where the robot goes, and would hold local SLAM where it is."""

MAX_READING_AGE_S = 3.0
"""Odometry that is older than this measures no motion [s]."""

NUM_TIMES = 20
"""Number of scans whose times show how often there is one."""


class LocalScan(NamedTuple):
    """A scan as local SLAM sees it.

    Attributes
    ----------
    stamp, time : of the scan, as recorded and in order [s].
    tf_local_tracking : pose of the robot, local frame, which drifts.
    points : float64, shape (n, 2), its returns, thinned [m], tracking frame.
    returns : float64, shape (m, 2), all of them.
    beam_origin : pose of the scanner on the robot.
    moving : bool, shape (n,), which of the points are of what moves.
    has_odometry : whether odometry has measured the motion since the last scan.
    unseen : by how much that motion may be wrong if no scan measured it, as this one has hardly any
        return, or some are missing before it; None otherwise.
    """

    stamp: float
    time: float
    tf_local_tracking: Pose
    points: FloatArray
    returns: FloatArray
    beam_origin: Pose
    moving: BoolArray
    has_odometry: bool = True
    unseen: MotionError | None = None


class LocalMotion:
    """Local SLAM without a map, which can begin again and keeps what it knows about the sensors.

    Parameters
    ----------
    config : of sensors and local SLAM.
    calibration : what is known about the sensors before.

    Attributes
    ----------
    trail : the latest metres of the path.
    scan : the last scan, None before the first.
    """

    def __init__(self, config: Config, calibration: SensorCalibration | None) -> None:
        self._config = config
        self._timer = StageTimer()
        self._first_sensor: str | None = None
        self._local_slam = self._new_local_slam(calibration)
        self.trail = Trail()
        self._moving = MovingReturns()
        self.scan: LocalScan | None = None
        self._unseen = UnseenMotion()
        self._has_seen = False
        self._last: tuple[float, Pose] | None = None
        self._odometry_time = -math.inf
        self._times: deque[float] = deque(maxlen=NUM_TIMES)

    def _new_local_slam(self, calibration: SensorCalibration | None) -> LocalSlam:
        config = self._config
        return LocalSlam(
            config.local_slam,
            config.sensor,
            config.global_slam.constraint_search.adaptive_voxel_filter,
            self._timer,
            calibration,
        )

    @property
    def calibration(self) -> SensorCalibration:
        """What is known about the sensors by now."""
        return self._local_slam.calibration

    @property
    def has_lost_sight(self) -> bool:
        """Whether what was seen before says nothing any longer of where the robot is."""
        return self._has_seen and self._unseen.is_too_long

    def begin_again(self) -> None:
        """Forget the path, and keep the calibration."""
        self._local_slam = self._new_local_slam(self.calibration)
        self.trail = Trail()
        self._moving = MovingReturns()
        self._unseen = UnseenMotion()
        self._last = None
        self._has_seen = False

    def add_odometry(self, reading: Odometry) -> None:
        """Add a reading."""
        self._odometry_time = reading.time
        self._local_slam.add_odometry(reading)

    def add_imu(self, reading: Imu) -> None:
        """Add a reading."""
        self._local_slam.add_imu(reading)

    def is_ready(self, scan: LaserScan | PointCloud, time: float) -> bool:
        """Return whether all that a scan needs has been read by a time [s]."""
        return self._local_slam.is_ready(scan, time)

    def add_scan(self, event: LaserScan | PointCloud) -> LocalScan | None:
        """Add a scan; None if the path has become too long for a submap.

        Only jumps of the odometry lead to that; then local SLAM has to begin again.
        """
        try:
            result = self._local_slam.add_scan(self._seen(event))
        except InputError:
            return None
        points = thin(result.returns, self._config.local_slam.adaptive_voxel_filter)
        origin = self._beam_origin(event)
        moving = self._moving.add(
            event.time,
            compose(result.tf_local_tracking, origin),
            transform_points(result.tf_local_tracking, points),
            transform_points(result.tf_local_tracking, result.returns),
        )
        # People who walk beside the robot would contradict every place, the right one as well.
        standing = thin(points[~moving], SCAN_FILTER)
        self.trail.add(result.tf_local_tracking, standing, origin)
        has_odometry = (
            self._local_slam.extrapolator.odometry.is_trusted
            and event.time - self._odometry_time <= MAX_READING_AGE_S
        )
        pose, last = result.tf_local_tracking, self._last or (event.time, result.tf_local_tracking)
        step, duration = relative(last[1], pose), event.time - last[0]
        error = None
        if len(points) < MIN_POINTS or is_gap(duration, self._times):
            error = unseen_error(step, duration, has_odometry=has_odometry)
        self._unseen.add(step, error)
        self._has_seen = self._has_seen or len(points) >= MIN_POINTS
        self._last = event.time, pose
        if event.time not in self._times:  # a scan is added again where the path begins again
            self._times.append(event.time)
        self.scan = LocalScan(
            event.stamp, event.time, pose, points, result.returns, origin, moving,
            has_odometry, error,
        )  # fmt: skip
        return self.scan

    def _beam_origin(self, event: LaserScan | PointCloud) -> Pose:
        """Return the pose of a scanner on the robot; a configured one is of the first scanner."""
        geometry = event.geometry
        if self._first_sensor is None:
            self._first_sensor = geometry.sensor
        given = self._config.sensor.laser_pose
        if given is not None and geometry.sensor == self._first_sensor:
            return Pose(*given)
        return geometry.tf_tracking_sensor

    def _seen(self, event: LaserScan | PointCloud) -> LaserScan | PointCloud:
        """Return a scan; without any return if it shows a cover in front of the scanner."""
        sensor = self._config.sensor
        most = min(sensor.max_range or sensor.default_max_range, event.geometry.range_max)
        distances = ranges_of(event)
        is_return = (distances > 0.0) & (distances < most)
        if np.count_nonzero(is_return & (distances > COVER_M)) >= MIN_POINTS or not is_return.any():
            return event
        if isinstance(event, PointCloud):
            return dataclasses.replace(event, points=np.full_like(event.points, np.nan))
        return dataclasses.replace(event, ranges=np.full_like(event.ranges, np.nan))


def ranges_of(event: LaserScan | PointCloud) -> FloatArray:
    """Return how far away what a scan measured is, shape (n,) [m]."""
    if isinstance(event, LaserScan):
        return event.ranges
    return np.asarray(np.linalg.norm(event.points, axis=1), dtype=np.float64)
