# SPDX-License-Identifier: Apache-2.0
"""The motion prior: the predicted pose of a scan, its uncertainty, and the motion of a sweep."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import asdict
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from cartoloop.arrays import FloatArray
from cartoloop.config import LocalSlamConfig
from cartoloop.local_slam.imu_calibration import ImuCalibration
from cartoloop.local_slam.measured_distance import MeasuredDistance
from cartoloop.local_slam.odometry_calibration import OdometryCalibration
from cartoloop.local_slam.odometry_parameters import OdometryParameters
from cartoloop.local_slam.odometry_track import OdometryTrack
from cartoloop.local_slam.odometry_trust import (
    Evidence,
    OdometryFault,
    OdometryTrust,
    differ,
    follows,
)
from cartoloop.local_slam.velocity_filter import VelocityFilter
from cartoloop.sensor.events import Imu
from cartoloop.sensor.imu_track import ImuTrack
from cartoloop.sensor.pose import IDENTITY, Pose, compose, relative
from cartoloop.sensor.sweep_motion import SweepMotion

MAX_SWEEP_S = 1.0
"""Longest plausible sweep [s]: no scanner is slower than 1 Hz. A longer one is a wrong time
increment, and its beams count as measured at once."""

STALE_M, STALE_RAD, STALE_SHARE = 0.03, 0.03, 0.5
"""Odometry that does not change at all while the scans move by more than this [m], [rad] repeats an
old reading. It is new again when it agrees with the scans up to that and a share of the motion."""

ODOMETRY_REACH_S = 4.0
"""Time around a scan for which the odometry is asked [s]: as many seconds as the clock offsets and
delays that are tried add up to, and half a sweep."""

MAX_RECENT = 256
"""Number of latest scans whose poses are kept for odometry that catches up: some seconds of them.
"""

KNOWN_SHIFTS_S: tuple[float, ...] = (-0.1, 0.1)
"""Times by which odometry may be late once its clock is known [s]."""

UNKNOWN_SHIFTS_S: tuple[float, ...] = tuple(0.1 * k for k in range(-4, 13) if k)
"""The same before its clock is known [s]."""

STANDING_SPEED, STANDING_RATE = 0.05, 0.03
"""Velocities below which matched scans do not contradict rest [m/s], [rad/s]: their noise."""


class Prediction(NamedTuple):
    """The motion prior of a scan: all that the scan matcher needs besides scan and submap.

    Attributes
    ----------
    tf_local_tracking : predicted pose.
    by_odometry : whether it is predicted by odometry; by constant velocity otherwise.
    information : float64, shape (6,), information matrix of the pose, upper triangle (xx, xy, xt,
        yy, yt, tt).
    fallbacks : returns other poses to try if the prediction fails: at rest and at constant
        velocity. Valid until the pose of the scan is added.
    stands : whether the odometry reports no motion at all.
    """

    tf_local_tracking: Pose
    by_odometry: bool
    information: FloatArray
    fallbacks: Callable[[], tuple[Pose, Pose]]
    stands: bool = False


def isotropic_information(translation_sigma: float, rotation_sigma: float) -> FloatArray:
    """Return an information matrix as its upper triangle (xx, xy, xt, yy, yt, tt), shape (6,)."""
    translation, rotation = 1.0 / translation_sigma**2, 1.0 / rotation_sigma**2
    return np.array((translation, 0.0, 0.0, translation, 0.0, rotation))


class PoseExtrapolator:
    """Predicts by odometry where it is available, by constant velocity otherwise.

    Where there is an IMU, the heading is predicted by its gyroscope.

    Parameters
    ----------
    config : parameters of local SLAM.
    odometry_model : what is known about the odometry before; by default nothing.
    odometry_score : largest score against its predictions in an earlier pass.

    Attributes
    ----------
    imu : readings of the IMU; None without any.
    imu_calibration : clock offset and plausibility of the gyroscope.
    num_overlong_sweeps : number of sweeps longer than `MAX_SWEEP_S`.
    """

    def __init__(
        self,
        config: LocalSlamConfig,
        odometry_model: OdometryParameters | None = None,
        odometry_score: float = 0.0,
    ) -> None:
        self._config = config
        self._prediction = config.prediction
        self._odometry = OdometryTrack()
        self._calibration = OdometryCalibration(odometry_model)
        self._trust = OdometryTrust(odometry_score)
        self._step_key: _StepKey | None = None
        self._step: Pose | None = None
        self._is_stale = False
        self._extrapolated: tuple[float, Pose] | None = None
        self._time = 0.0
        self._tf_local_tracking = IDENTITY
        self._velocity = VelocityFilter(config.prediction)
        self._middle_time, self._middle = 0.0, IDENTITY
        self._middles: dict[str, tuple[float, Pose]] = {}
        self._recent: deque[tuple[float, Pose]] = deque(maxlen=MAX_RECENT)
        self._num_late = 0
        self._num_poses = 0
        self.imu: ImuTrack | None = None
        self.imu_calibration = ImuCalibration()
        self.num_overlong_sweeps = 0

    @property
    def odometry_model(self) -> OdometryParameters:
        """The estimated calibration of the odometry."""
        return self._calibration.model

    @property
    def odometry_score(self) -> float:
        """The largest score against the odometry's predictions so far."""
        return self._trust.largest_score

    @property
    def odometry_faults(self) -> list[OdometryFault]:
        """The times at which the odometry did not move as the scans did, so far."""
        return self._trust.faults

    @property
    def trusts_odometry(self) -> bool:
        """Whether there is odometry that moves as the scans do."""
        return len(self._odometry) > 0 and not self._is_stale and self._trust.is_trusted

    @property
    def measures_motion(self) -> bool:
        """Whether odometry or an IMU measures the motion between scans."""
        return len(self._odometry) > 0 or self.imu is not None

    def summary(self) -> dict[str, Any]:
        """Return the estimates about odometry and IMU, for the report."""
        track = {
            "jumps": self._odometry.num_jumps,
            "catch_ups": self._odometry.num_late,
            "faults": [asdict(fault) for fault in self._trust.faults],
        }
        summary: dict[str, Any] = {"odometry": self.odometry_model.summary() | track}
        if self.imu is not None:
            summary["imu"] = self.imu.summary() | self.imu_calibration.summary()
        if self.num_overlong_sweeps:
            summary["sweeps_too_long"] = self.num_overlong_sweeps
        return summary

    def add_odometry(self, time: float, tf_odom_tracking: Pose) -> None:
        """Add a wheel-odometry reading."""
        if self._config.use_odometry:
            self._odometry.add(time, tf_odom_tracking)

    def has_odometry_until(self, time: float) -> bool:
        """Return whether odometry has been read up to a time of the scans, or there is none.

        Beyond its readings it is extrapolated, and what that is wrong by stays in the next step.
        """
        latest = self._odometry.latest + self._calibration.model.time_offset
        return len(self._odometry) == 0 or latest >= time

    @property
    def has_much_odometry(self) -> bool:
        """Whether it is time to forget some of the odometry."""
        return self._odometry.is_long

    def forget_odometry(self, needed: Sequence[float]) -> None:
        """Forget the odometry that cannot change any pose or calibration any more.

        Parameters
        ----------
        needed : times of earlier scans from which a distance will be measured [s].
        """
        used = np.concatenate((self._calibration.used_times(), needed))
        reach = ODOMETRY_REACH_S + abs(self._calibration.model.time_offset)
        self._odometry.forget(used, reach)

    def add_imu(self, imu: Imu) -> None:
        """Add an inertial reading."""
        if not self._config.use_imu:
            return
        if self.imu is None:
            self.imu = ImuTrack(self._config.imu_gravity_time_constant)
        self.imu.add(imu)

    def add_pose(
        self,
        time: float,
        tf_local_tracking: Pose,
        motion: SweepMotion | None = None,
        evidence: Evidence | None = None,
        scanner: str = "",
    ) -> None:
        """Add the matched pose of a scan, the motion assumed in its sweep, and what it determines.

        A sweep is matched as a whole, so the pose of its middle is correct even if the assumed
        motion is not. Velocity, clock offsets and biases are therefore estimated from the middles.
        """
        middle_time, middle = _middle(time, tf_local_tracking, motion)
        num_faulty = 0
        last = self._middles.get(scanner)
        expected = None
        if last is not None:
            if not self._is_stale:
                expected = self._velocity.step(middle_time - last[0])
            self._velocity.update(relative(last[1], middle), middle_time - last[0])
        if len(self._odometry):
            num_faulty = self._compare_odometry(middle_time, middle, evidence, scanner, expected)
        if evidence is None or evidence.is_determined:
            self._extrapolated = None
        self._middle_time, self._middle = middle_time, middle
        self._middles[scanner] = middle_time, middle
        self._time, self._tf_local_tracking = time, tf_local_tracking
        self._recent.append((time, tf_local_tracking))
        self._num_poses += 1
        if len(self._odometry):
            self._calibration.add(middle_time, middle, self._odometry, num_faulty, scanner)
        if self.imu is not None:
            x, y, rate = self._velocity.step(1.0)
            self.imu.note_standing(math.hypot(x, y) < STANDING_SPEED and abs(rate) < STANDING_RATE)
            self.imu_calibration.add(middle_time, middle, self.imu)

    def add_distance(self, distance: MeasuredDistance) -> None:
        """Add a distance between two scans that these alone measure."""
        self._calibration.add_distance(distance)

    def shift(self, scanner: str, by: float) -> None:
        """Correct the times of a scanner's scans so far, since its clock offset changes [s]."""
        time, middle = self._middles[scanner]
        self._middles[scanner] = time + by, middle
        self._calibration.shift(scanner, by)

    def _compare_odometry(
        self,
        time: float,
        pose: Pose,
        evidence: Evidence | None,
        scanner: str,
        expected: Pose | None,
    ) -> int:
        """Compare the odometry with a matched pose; return how many latest steps are faulty."""
        last = self._middles.get(scanner)
        reported = None if last is None else self._measured_step(last[0], time)
        is_known = self.odometry_model.is_known
        num_faulty = self._trust.add(
            time, pose, reported, evidence, self._is_late, is_known, scanner, expected
        )
        if last is None or reported is None or evidence is None or not evidence.is_determined:
            return num_faulty
        matched = relative(last[1], pose)
        apart = math.hypot(matched.x - reported.x, matched.y - reported.y)
        turned_apart = abs(matched.theta - reported.theta)
        if self._is_stale:
            self._is_stale = apart > STALE_M + STALE_SHARE * math.hypot(
                matched.x, matched.y
            ) or turned_apart > STALE_RAD + STALE_SHARE * abs(matched.theta)
        elif reported == IDENTITY:
            self._is_stale = apart > STALE_M or turned_apart > STALE_RAD
        return max(num_faulty, int(self._is_stale))

    def _is_late(self, begin: float, end: float, matched: Pose) -> bool:
        """Return whether the odometry reports about such a motion shortly before or after."""
        shifts = KNOWN_SHIFTS_S if self.odometry_model.knows_rotation else UNKNOWN_SHIFTS_S
        length = math.hypot(matched.x, matched.y)
        for shift in shifts:
            step = self._measured_step(begin - shift, end - shift)
            if step is not None and not differ(
                Pose(length, 0.0, matched.theta),
                Pose(math.hypot(step.x, step.y), 0.0, step.theta),
                is_calibrated=False,
            ):
                return True
        return False

    def predict(self, time: float) -> Prediction:
        """Return the motion prior of a scan at a time not before the last pose."""
        if self._num_poses == 0:
            return self.prediction_from(time, IDENTITY)
        if self._num_late < self._odometry.num_late:
            self._num_late = self._odometry.num_late
            caught_up = self._caught_up(time)
            if caught_up is not None:
                return caught_up
        step = self._odometry_step(self._time, time)
        if step is None:
            step = self._agreed_step(time)
        if step is None:
            self._extrapolated = None
            return self.prediction_from(time, self._at_constant_velocity(time))
        step = self._with_overdue_motion(step)
        self._extrapolated = None if self.has_odometry_until(time) else (self._time, step)
        pose = compose(self._tf_local_tracking, self._with_gyro_turn(step, self._time, time))
        return Prediction(
            pose,
            True,
            self._odometry_information(),
            partial(self._fallbacks, time),
            stands=step == IDENTITY,
        )

    def _with_overdue_motion(self, step: Pose) -> Pose:
        """Return a step, and by how much the odometry was extrapolated wrongly to the last scan.

        Only live: recorded scans wait for it. A match along bare walls has followed the odometry.
        """
        if self._extrapolated is None:
            return step
        begin, assumed = self._extrapolated
        known = self._odometry_step(begin, self._time)
        if known is None:
            return step
        missed = relative(assumed, known)
        return compose(Pose(missed.x, missed.y, 0.0), step)

    def _caught_up(self, time: float) -> Prediction | None:
        """Return the motion prior once the odometry has caught up, None if that is not possible.

        While it repeated a reading, matches along bare walls could not know how far the robot
        moved. So the motion since the last scan before is taken, not since the last scan.
        """
        since = self._odometry.late_since + self._calibration.model.time_offset
        number = sum(1 for scan_time, _ in self._recent if scan_time > since)
        if number == len(self._recent):
            return None
        begin, pose = self._recent[len(self._recent) - number - 1]
        step = self._measured_step(begin, time)
        self._is_stale = False
        if step is None or not self._trust.forgive(since):
            return None
        return Prediction(
            compose(pose, self._with_gyro_turn(step, begin, time)),
            True,
            self._odometry_information() / (number + 1),
            partial(self._fallbacks, time),
        )

    def prediction_from(self, time: float, tf_local_tracking: Pose) -> Prediction:
        """Return the motion prior around a pose that does not rely on odometry."""
        information = self._velocity_information(time, tf_local_tracking)
        return Prediction(tf_local_tracking, False, information, partial(self._fallbacks, time))

    def _odometry_information(self) -> FloatArray:
        """Return the information of a step of the odometry."""
        config, model = self._prediction, self._calibration.model
        translation = config.unknown_translation_sigma
        if model.is_known:
            translation = max(
                config.translation_error_factor * model.translation_error,
                config.min_translation_sigma,
            )
        rotation = config.unknown_rotation_sigma
        if model.knows_rotation:
            rotation = max(
                config.rotation_error_factor * model.rotation_error, config.min_rotation_sigma
            )
        return isotropic_information(translation, rotation)

    def _velocity_information(self, time: float, moved: Pose) -> FloatArray:
        config, rest = self._prediction, self._tf_local_tracking
        pixel, duration = self._config.submaps.resolution, time - self._time
        translation, rotation = self._velocity.sigmas(duration)
        if self._gyro_turn(self._time, time) is not None:
            rotation = min(rotation, config.gyro_turn_sigma + config.gyro_rate_sigma * duration)
        is_slow = math.hypot(moved.x - rest.x, moved.y - rest.y) < config.slow_step * pixel
        # Scans that come slowly show a motion of pixels, however slow the robot was before.
        if is_slow and config.acceleration * duration**2 <= config.pixel_noise * pixel:
            translation = config.lost_translation_sigma
        return isotropic_information(
            min(translation, config.lost_translation_sigma),
            min(rotation, config.lost_rotation_sigma),
        )

    def _fallbacks(self, time: float) -> tuple[Pose, Pose]:
        return self._tf_local_tracking, self._at_constant_velocity(time)

    def _at_constant_velocity(self, time: float) -> Pose:
        """Return the pose at constant velocity, with the gyroscope's rotation if there is one."""
        step = self._velocity.step(time - self._time)
        return compose(self._tf_local_tracking, self._with_gyro_turn(step, self._time, time))

    def sweep_motion(self, time: float, first: float, last: float) -> SweepMotion | None:
        """Return the predicted motion and tilt during a sweep; None if neither is to be corrected.

        Parameters
        ----------
        time : of the scan [s], not before the last pose.
        first, last : begin and end of the sweep relative to `time` [s].
        """
        if last - first > MAX_SWEEP_S:
            self.num_overlong_sweeps += 1
            first = last = 0.0
        imu = self.imu if self._config.project_to_horizontal else None
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
            knots[:, 3:] = imu.at(time + moments - self.imu_calibration.time_offset)[:, :2]
        return SweepMotion(first, (last - first) / num_steps if num_steps else 1.0, knots)

    def corrected_motion(
        self, time: float, tf_local_tracking: Pose, motion: SweepMotion | None
    ) -> SweepMotion | None:
        """Return a better estimate of the motion during a sweep, given the matched pose.

        None where other sensors measure the motion, or where it is as assumed. The pose of the
        middle of a sweep is correct even if the assumed motion is not; so the velocity follows
        from the middles of this sweep and the last.
        """
        if motion is None or len(motion.knots) < 2 or not self._num_poses:
            return None
        if self._is_measured(time, time + motion.start + (len(motion.knots) - 1) * motion.step):
            return None
        middle_time, middle = _middle(time, tf_local_tracking, motion)
        duration = middle_time - self._middle_time
        if not 0.0 < duration < MAX_SWEEP_S:
            return None
        step = relative(self._middle, middle)
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
            self._odometry_step(begin, end) is not None or self._gyro_turn(begin, end) is not None
        )

    def _step_between(self, begin: float, end: float) -> Pose:
        """Return the motion from one time to another, which may be earlier."""
        step = self._odometry_step(begin, end)
        if step is None:
            step = self._velocity.step(end - begin)
        return self._with_gyro_turn(step, begin, end)

    def _with_gyro_turn(self, step: Pose, begin: float, end: float) -> Pose:
        """Return a step with the rotation that the gyroscope measured, if it did."""
        turn = self._gyro_turn(begin, end)
        return step if turn is None else Pose(step.x, step.y, turn)

    def _gyro_turn(self, begin: float, end: float) -> float | None:
        """Return the rotation [rad] that the gyroscope measured between two times, or None."""
        if self.imu is None or not self.imu_calibration.agrees:
            return None
        # Upside down, or with a wrong sign: not used before it is compared with matched scans.
        if self.imu.is_askew and not self.imu_calibration.is_measured:
            return None
        begin -= self.imu_calibration.time_offset
        end -= self.imu_calibration.time_offset
        if not self.imu.covers(min(begin, end), max(begin, end)):
            return None
        turned = self.imu.at(np.array((begin, end)))[:, 2]
        return float(turned[1] - turned[0])

    def _odometry_step(self, begin: float, end: float) -> Pose | None:
        """Return the calibrated motion between two times, None if it is not known or trusted."""
        if self._is_stale or not self._trust.is_trusted or not self._odometry.has_moved:
            return None
        return self._measured_step(begin, end)

    def _agreed_step(self, time: float) -> Pose | None:
        """Return the step of odometry with a fault where it moves at the last velocity, or None.

        Along bare walls it cannot show that it is good again, and is better than what they show.
        """
        if self._is_stale or not self._trust.has_fault:
            return None
        step = self._measured_step(self._time, time)
        expected = self._velocity.step(time - self._time)
        return step if step is not None and follows(step, expected) else None

    def _measured_step(self, begin: float, end: float) -> Pose | None:
        """Return the calibrated motion that the odometry measured between two times, or None."""
        model = self._calibration.model
        key = begin, end, len(self._odometry), model
        # The prediction of a scan and its comparison with the match ask for the same step.
        if self._step_key is not None and _same(key, self._step_key):
            return self._step
        begin, end = begin - model.time_offset, end - model.time_offset
        before, after = self._odometry.at(begin), self._odometry.at(end)
        step = None
        if (
            before is not None
            and after is not None
            and not self._odometry.jumps_between(begin, end)
        ):
            step = model.predict(relative(before, after), before.theta)
        self._step_key, self._step = key, step
        return step


_StepKey = tuple[float, float, int, OdometryParameters]


def _same(key: _StepKey, other: _StepKey) -> bool:
    return key[:3] == other[:3] and key[3] is other[3]


def _middle(time: float, pose: Pose, motion: SweepMotion | None) -> tuple[float, Pose]:
    """Return time and pose of the middle of a sweep that began at a pose."""
    if motion is None or len(motion.knots) < 2:
        return time, pose
    last = len(motion.knots) - 1
    half = 0.5 * (motion.knots[last // 2] + motion.knots[(last + 1) // 2])
    x, y, theta = half[:3].tolist()
    return time + motion.start + 0.5 * last * motion.step, compose(pose, Pose(x, y, theta))
