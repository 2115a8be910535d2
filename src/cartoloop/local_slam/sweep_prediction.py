# SPDX-License-Identifier: Apache-2.0
"""The motion of the robot while its scanner sweeps: as predicted, and as matched poses show it."""

from __future__ import annotations

import math

import numpy as np

from cartoloop.config import LocalSlamConfig
from cartoloop.local_slam.gyroscope import Gyroscope
from cartoloop.local_slam.odometry_motion import OdometryMotion
from cartoloop.local_slam.velocity_filter import VelocityFilter
from cartoloop.sensor.pose import Pose, compose, relative
from cartoloop.sensor.sweep_motion import SweepMotion

MAX_SWEEP_S = 1.0
"""Longest plausible sweep [s]: no scanner is slower than 1 Hz. A longer one is a wrong time
increment, and its beams count as measured at once."""


class SweepPrediction:
    """Predicts the motion during a sweep by what measures it, by constant velocity otherwise.

    Parameters
    ----------
    config : parameters of local SLAM.
    odometry : the motion that wheels measured.
    gyroscope : the rotation and tilt that an IMU measured.
    velocity : of the robot, as matched poses show it.

    Attributes
    ----------
    num_overlong : number of sweeps longer than `MAX_SWEEP_S`.
    """

    def __init__(
        self,
        config: LocalSlamConfig,
        odometry: OdometryMotion,
        gyroscope: Gyroscope,
        velocity: VelocityFilter,
    ) -> None:
        self._config = config
        self._odometry = odometry
        self._gyroscope = gyroscope
        self._velocity = velocity
        self.num_overlong = 0

    def predicted(self, time: float, first: float, last: float) -> SweepMotion | None:
        """Return the predicted motion and tilt during a sweep; None if neither is to be corrected.

        Parameters
        ----------
        time : of the scan [s], not before the last pose.
        first, last : begin and end of the sweep relative to `time` [s].
        """
        if last - first > MAX_SWEEP_S:
            self.num_overlong += 1
            first = last = 0.0
        imu = self._gyroscope.track if self._config.project_to_horizontal else None
        if imu is not None and not imu.measures_gravity:
            imu = None
        if imu is None and last <= first:
            return None
        motion_step = self._config.deskewing.motion_step
        num_steps = max(math.ceil((last - first) / motion_step), 1 if last > first else 0)
        moments = np.linspace(first, last, num_steps + 1)
        knots = np.zeros((num_steps + 1, 5))
        if num_steps:
            knots[:, :3] = [self._step_between(time, time + moment) for moment in moments.tolist()]
        if imu is not None:
            knots[:, 3:] = imu.at(time + moments - self._gyroscope.calibration.time_offset)[:, :2]
        return SweepMotion(first, (last - first) / num_steps if num_steps else 1.0, knots)

    def corrected(
        self,
        time: float,
        tf_local_tracking: Pose,
        motion: SweepMotion,
        last_middle: tuple[float, Pose],
    ) -> SweepMotion | None:
        """Return a better estimate of the motion during a sweep, given the matched pose.

        None where other sensors measure the motion, or where it is as assumed. The pose of the
        middle of a sweep is correct even if the assumed motion is not; so the velocity follows
        from the middles of this sweep and the last.

        Parameters
        ----------
        time, tf_local_tracking : of the scan [s], local frame.
        motion : as assumed.
        last_middle : time [s] and pose of the middle of the last sweep, local frame.
        """
        if len(motion.knots) < 2:
            return None
        if self._is_measured(time, time + motion.start + (len(motion.knots) - 1) * motion.step):
            return None
        last_time, last_pose = last_middle
        middle_time, middle = middle_of_sweep(time, tf_local_tracking, motion)
        duration = middle_time - last_time
        if not 0.0 < duration < MAX_SWEEP_S:
            return None
        step = relative(last_pose, middle)
        moments = motion.start + motion.step * np.arange(len(motion.knots))
        knots = motion.knots.copy()
        knots[:, :3] = moments[:, None] / duration * np.array(step)
        change = np.abs(knots[:, :3] - motion.knots[:, :3]).max(axis=0)
        config = self._config.deskewing
        if (
            max(change[0], change[1]) < config.min_translation_correction
            and change[2] < config.min_rotation_correction
        ):
            return None
        return SweepMotion(motion.start, motion.step, knots)

    def _is_measured(self, begin: float, end: float) -> bool:
        """Return whether odometry or gyroscope measure the rotation between two times."""
        return (
            self._odometry.step(begin, end) is not None
            or self._gyroscope.turn(begin, end) is not None
        )

    def _step_between(self, begin: float, end: float) -> Pose:
        """Return the motion from one time to another, which may be earlier."""
        step = self._odometry.step(begin, end)
        if step is None:
            step = self._velocity.step(end - begin)
        return self._gyroscope.with_turn(step, begin, end)


def middle_of_sweep(time: float, pose: Pose, motion: SweepMotion | None) -> tuple[float, Pose]:
    """Return time [s] and pose of the middle of a sweep that began at a pose."""
    if motion is None or len(motion.knots) < 2:
        return time, pose
    last = len(motion.knots) - 1
    half = 0.5 * (motion.knots[last // 2] + motion.knots[(last + 1) // 2])
    x, y, theta = half[:3].tolist()
    return time + motion.start + 0.5 * last * motion.step, compose(pose, Pose(x, y, theta))
