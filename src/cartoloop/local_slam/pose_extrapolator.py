# SPDX-License-Identifier: Apache-2.0
"""Where the robot is expected to be, before its scan is matched."""

from __future__ import annotations

from dataclasses import dataclass

from cartoloop.config import PredictionConfig
from cartoloop.local_slam.odometry_calibration import OdometryCalibration, OdometryModel
from cartoloop.local_slam.odometry_track import OdometryTrack
from cartoloop.local_slam.velocity_filter import VelocityFilter
from cartoloop.sensor.events import Imu
from cartoloop.sensor.pose import IDENTITY, Pose, compose, relative


@dataclass(frozen=True, slots=True)
class Prediction:
    """Where the robot is expected.

    Attributes
    ----------
    tf_local_tracking : the best guess.
    by_odometry : whether odometry was at hand for it; constant velocity otherwise.
    """

    tf_local_tracking: Pose
    by_odometry: bool


class PoseExtrapolator:
    """Predicts by odometry where it is at hand, by constant velocity otherwise."""

    def __init__(self, config: PredictionConfig, *, use_odometry: bool) -> None:
        self._use_odometry = use_odometry
        self._odometry = OdometryTrack()
        self._calibration = OdometryCalibration()
        self._time = 0.0
        self._tf_local_tracking = IDENTITY
        self._velocity = VelocityFilter(config.acceleration, config.angular_acceleration)
        self._num_poses = 0

    @property
    def last_time(self) -> float:
        """Time of the last pose [s]."""
        return self._time

    @property
    def odometry_model(self) -> OdometryModel:
        """What the odometry has turned out to be worth."""
        return self._calibration.model

    def add_odometry(self, time: float, tf_odom_tracking: Pose) -> None:
        """Take in a wheel-odometry reading."""
        if self._use_odometry:
            self._odometry.add(time, tf_odom_tracking)

    def add_imu(self, imu: Imu) -> None:
        """Take in an inertial reading."""
        del imu

    def add_pose(self, time: float, tf_local_tracking: Pose) -> None:
        """Take in the pose of a scan as matched."""
        if self._num_poses:
            step = relative(self._tf_local_tracking, tf_local_tracking)
            self._velocity.update(step, time - self._time)
        self._time, self._tf_local_tracking = time, tf_local_tracking
        self._num_poses += 1
        if len(self._odometry):
            self._calibration.add(time, tf_local_tracking, self._odometry)

    def predict(self, time: float) -> Prediction:
        """Return where the robot is expected at a time not before the last pose."""
        if self._num_poses == 0:
            return Prediction(IDENTITY, by_odometry=False)
        step = self._odometry_step(time)
        if step is not None:
            return Prediction(compose(self._tf_local_tracking, step), by_odometry=True)
        return Prediction(self.at_constant_velocity(time), by_odometry=False)

    def at_constant_velocity(self, time: float) -> Pose:
        """Return the pose if the robot moves on as it did."""
        return compose(self._tf_local_tracking, self._velocity.step(time - self._time))

    def velocity_sigmas(self, time: float) -> tuple[float, float]:
        """Return how far that pose may be off: distance [m] and angle [rad]; inf if not known."""
        return self._velocity.sigmas(time - self._time)

    def at_rest(self) -> Pose:
        """Return the pose if the robot has not moved since the last scan."""
        return self._tf_local_tracking

    def _odometry_step(self, time: float) -> Pose | None:
        model = self._calibration.model
        before = self._odometry.at(self._time - model.time_offset)
        after = self._odometry.at(time - model.time_offset)
        if before is None or after is None:
            return None
        return model.predict(relative(before, after))
