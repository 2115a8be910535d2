# SPDX-License-Identifier: Apache-2.0
"""How a robot moves by its own scans: local SLAM, and the latest metres of the path."""

from __future__ import annotations

from typing import NamedTuple

from cartoloop.arrays import FloatArray
from cartoloop.config import Config
from cartoloop.errors import InputError
from cartoloop.local_slam.local_slam import LocalSlam
from cartoloop.local_slam.sensor_calibration import SensorCalibration
from cartoloop.localisation.trail import SCAN_FILTER, Trail
from cartoloop.runtime.stage_timer import StageTimer
from cartoloop.sensor.events import Imu, LaserScan, Odometry, PointCloud
from cartoloop.sensor.pose import Pose
from cartoloop.sensor.range_filter import thin


class LocalScan(NamedTuple):
    """A scan as local SLAM sees it.

    Attributes
    ----------
    stamp, time : of the scan, as recorded and in order [s].
    tf_local_tracking : pose of the robot, local frame, which drifts.
    points : float64, shape (n, 2), its returns, thinned [m], tracking frame.
    returns : float64, shape (m, 2), all of them.
    beam_origin : pose of the scanner on the robot.
    """

    stamp: float
    time: float
    tf_local_tracking: Pose
    points: FloatArray
    returns: FloatArray
    beam_origin: Pose


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
        self.scan: LocalScan | None = None

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

    def begin_again(self) -> None:
        """Forget the path, and keep the calibration."""
        self._local_slam = self._new_local_slam(self.calibration)
        self.trail = Trail()

    def add_odometry(self, reading: Odometry) -> None:
        """Add a reading."""
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
            result = self._local_slam.add_scan(event)
        except InputError:
            return None
        points = thin(result.returns, self._config.local_slam.adaptive_voxel_filter)
        origin = self._beam_origin(event)
        self.trail.add(result.tf_local_tracking, thin(points, SCAN_FILTER), origin)
        self.scan = LocalScan(
            event.stamp, event.time, result.tf_local_tracking, points, result.returns, origin
        )
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
