# SPDX-License-Identifier: Apache-2.0
"""Where the robot is expected to be, before its scan is matched, and how it moves meanwhile."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from cartoloop.config import PredictionConfig
from cartoloop.local_slam.imu_calibration import ImuCalibration
from cartoloop.local_slam.odometry_calibration import OdometryCalibration, OdometryModel
from cartoloop.local_slam.odometry_track import OdometryTrack
from cartoloop.local_slam.velocity_filter import VelocityFilter
from cartoloop.sensor.events import Imu
from cartoloop.sensor.imu_track import ImuTrack
from cartoloop.sensor.pose import IDENTITY, Pose, compose, relative
from cartoloop.sensor.sweep_motion import SweepMotion

KNOT_S = 0.01
"""During a sweep the motion is told so often: walking hardly turns in between."""

MAX_SWEEP_S = 1.0
"""No scanner sweeps for longer; one that says so is taken to measure all at once."""

GYRO_RATE_ERROR = 0.02
"""How far off an angular velocity is at the most, bias and scale together [rad/s]."""

MIN_CORRECTION_M, MIN_CORRECTION_RAD = 0.005, 0.002
"""A sweep is not taken anew for a smaller change of its motion."""

STANDING_SPEED, STANDING_RATE = 0.05, 0.03
"""Scans that tell of less motion tell of none [m/s], [rad/s]."""


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
    """Predicts by odometry where it is at hand, by constant velocity otherwise.

    Where there is an IMU, the heading is predicted by its gyroscope.

    Attributes
    ----------
    imu : what the IMU told; None without any.
    imu_calibration : how it relates to the scans.
    num_overlong_sweeps : how many sweeps were said to last longer than any does.
    """

    def __init__(
        self,
        config: PredictionConfig,
        *,
        use_odometry: bool,
        use_imu: bool = True,
        imu_gravity_time_constant: float = 10.0,
        project_to_horizontal: bool = True,
    ) -> None:
        self._use_odometry = use_odometry
        self._use_imu = use_imu
        self._time_constant = imu_gravity_time_constant
        self._projects = project_to_horizontal
        self._odometry = OdometryTrack()
        self._calibration = OdometryCalibration()
        self._time = 0.0
        self._tf_local_tracking = IDENTITY
        self._velocity = VelocityFilter(config.acceleration, config.angular_acceleration)
        self._middle_time, self._middle = 0.0, IDENTITY
        self._num_poses = 0
        self.imu: ImuTrack | None = None
        self.imu_calibration = ImuCalibration()
        self.num_overlong_sweeps = 0

    @property
    def last_time(self) -> float:
        """Time of the last pose [s]."""
        return self._time

    @property
    def odometry_model(self) -> OdometryModel:
        """What the odometry has turned out to be worth."""
        return self._calibration.model

    @property
    def num_odometry_jumps(self) -> int:
        """How often the odometry jumped further than a robot can go."""
        return self._odometry.num_jumps

    @property
    def follows_motion(self) -> bool:
        """Whether odometry or an IMU tells how the robot moves between scans."""
        return len(self._odometry) > 0 or self.imu is not None

    def add_odometry(self, time: float, tf_odom_tracking: Pose) -> None:
        """Take in a wheel-odometry reading."""
        if self._use_odometry:
            self._odometry.add(time, tf_odom_tracking)

    def add_imu(self, imu: Imu) -> None:
        """Take in an inertial reading."""
        if not self._use_imu:
            return
        if self.imu is None:
            self.imu = ImuTrack(self._time_constant)
        self.imu.add(imu)

    def add_pose(
        self, time: float, tf_local_tracking: Pose, motion: SweepMotion | None = None
    ) -> None:
        """Take in the pose of a scan as matched, and the motion during its sweep.

        A sweep is found as a whole: that its middle is where it is holds whatever the motion, and
        so velocity, offsets and biases are read off the middles.
        """
        middle_time, middle = _middle(time, tf_local_tracking, motion)
        if self._num_poses:
            self._velocity.update(relative(self._middle, middle), middle_time - self._middle_time)
        self._middle_time, self._middle = middle_time, middle
        self._time, self._tf_local_tracking = time, tf_local_tracking
        self._num_poses += 1
        if len(self._odometry):
            self._calibration.add(middle_time, middle, self._odometry)
        if self.imu is not None:
            x, y, rate = self._velocity.step(1.0)
            self.imu.note_standing(math.hypot(x, y) < STANDING_SPEED and abs(rate) < STANDING_RATE)
            self.imu_calibration.add(middle_time, middle, self.imu)

    def predict(self, time: float) -> Prediction:
        """Return where the robot is expected at a time not before the last pose."""
        if self._num_poses == 0:
            return Prediction(IDENTITY, by_odometry=False)
        step = self._odometry_step(self._time, time)
        if step is not None:
            step = self._turned_by_imu(step, self._time, time)
            return Prediction(compose(self._tf_local_tracking, step), by_odometry=True)
        return Prediction(self.at_constant_velocity(time), by_odometry=False)

    def at_constant_velocity(self, time: float) -> Pose:
        """Return the pose if the robot moves on as it did; it turns as its gyroscope tells."""
        step = self._velocity.step(time - self._time)
        return compose(self._tf_local_tracking, self._turned_by_imu(step, self._time, time))

    def velocity_sigmas(self, time: float) -> tuple[float, float]:
        """Return how far that pose may be off: distance [m] and angle [rad]; inf if not known."""
        translation, rotation = self._velocity.sigmas(time - self._time)
        if self._imu_turn(self._time, time) is not None:
            rotation = min(rotation, 0.005 + GYRO_RATE_ERROR * (time - self._time))
        return translation, rotation

    def at_rest(self) -> Pose:
        """Return the pose if the robot has not moved since the last scan."""
        return self._tf_local_tracking

    def sweep_motion(self, time: float, first: float, last: float) -> SweepMotion | None:
        """Return how the robot moves and tilts during a sweep; None if nothing tells of either.

        Parameters
        ----------
        time : of the scan [s], not before the last pose.
        first, last : when the sweep begins and ends, from `time` on [s].
        """
        if last - first > MAX_SWEEP_S:
            self.num_overlong_sweeps += 1
            first = last = 0.0
        imu = self.imu if self._projects else None
        if imu is not None and not imu.tells_gravity:
            imu = None
        if imu is None and last <= first:
            return None
        num_steps = max(math.ceil((last - first) / KNOT_S), 1 if last > first else 0)
        moments = np.linspace(first, last, num_steps + 1)
        knots = np.zeros((num_steps + 1, 5))
        if num_steps:
            knots[:, :3] = [self._step_between(time, time + moment) for moment in moments.tolist()]
        if imu is not None:
            knots[:, 3:] = imu.at(time + moments - self.imu_calibration.time_offset)[:, :2]
        return SweepMotion(first, (last - first) / num_steps if num_steps else 1.0, knots)

    def corrected_motion(
        self, time: float, tf_local_tracking: Pose, motion: SweepMotion | None
    ) -> SweepMotion | None:
        """Return the motion during a sweep anew, given where it was matched.

        None where the motion is known from other sensors, or is as it was assumed. The middle of a
        sweep is where it was found, however wrong the motion was; so the velocity follows from the
        middles of this sweep and the last.
        """
        if motion is None or len(motion.knots) < 2 or not self._num_poses:
            return None
        if self._is_told(time, time + motion.start + (len(motion.knots) - 1) * motion.step):
            return None
        middle_time, middle = _middle(time, tf_local_tracking, motion)
        duration = middle_time - self._middle_time
        if not 0.0 < duration < MAX_SWEEP_S:
            return None
        step = relative(self._middle, middle)
        moments = motion.start + motion.step * np.arange(len(motion.knots))
        knots = motion.knots.copy()
        knots[:, :3] = moments[:, None] / duration * np.array(step)
        off = np.abs(knots[:, :3] - motion.knots[:, :3]).max(axis=0)
        if max(off[0], off[1]) < MIN_CORRECTION_M and off[2] < MIN_CORRECTION_RAD:
            return None
        return SweepMotion(motion.start, motion.step, knots)

    def _is_told(self, begin: float, end: float) -> bool:
        """Return whether odometry or gyroscope tell how the robot turned between two times."""
        return self._odometry_step(begin, end) is not None or self._imu_turn(begin, end) is not None

    def _step_between(self, begin: float, end: float) -> Pose:
        """Return the motion from one time to another, which may be earlier."""
        step = self._odometry_step(begin, end)
        if step is None:
            step = self._velocity.step(end - begin)
        return self._turned_by_imu(step, begin, end)

    def _turned_by_imu(self, step: Pose, begin: float, end: float) -> Pose:
        """Return a step with the rotation that the gyroscope tells, if it does."""
        turn = self._imu_turn(begin, end)
        return step if turn is None else Pose(step.x, step.y, turn)

    def _imu_turn(self, begin: float, end: float) -> float | None:
        if self.imu is None or not self.imu_calibration.agrees:
            return None
        # Turned over, or of the wrong sign: the scans must have told first.
        if self.imu.is_askew and not self.imu_calibration.is_measured:
            return None
        begin -= self.imu_calibration.time_offset
        end -= self.imu_calibration.time_offset
        if not self.imu.covers(min(begin, end), max(begin, end)):
            return None
        turned = self.imu.at(np.array((begin, end)))[:, 2]
        return float(turned[1] - turned[0])

    def _odometry_step(self, begin: float, end: float) -> Pose | None:
        model = self._calibration.model
        begin, end = begin - model.time_offset, end - model.time_offset
        before, after = self._odometry.at(begin), self._odometry.at(end)
        if before is None or after is None or self._odometry.jumps_between(begin, end):
            return None
        return model.predict(relative(before, after))


def _middle(time: float, pose: Pose, motion: SweepMotion | None) -> tuple[float, Pose]:
    """Return time and pose of the middle of a sweep that began at a pose."""
    if motion is None or len(motion.knots) < 2:
        return time, pose
    last = len(motion.knots) - 1
    half = 0.5 * (motion.knots[last // 2] + motion.knots[(last + 1) // 2])
    x, y, theta = half[:3].tolist()
    return time + motion.start + 0.5 * last * motion.step, compose(pose, Pose(x, y, theta))
