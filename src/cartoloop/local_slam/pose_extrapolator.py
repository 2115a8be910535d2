# SPDX-License-Identifier: Apache-2.0
"""The motion prior: the predicted pose of a scan, and its uncertainty."""

from __future__ import annotations

import math
from collections import deque
from functools import partial
from typing import Any

from cartoloop.arrays import FloatArray
from cartoloop.config import LocalSlamConfig
from cartoloop.local_slam.gap import MIN_GAP_S, Gap, gap_by_odometry, gap_without_odometry, is_gap
from cartoloop.local_slam.gyroscope import Gyroscope
from cartoloop.local_slam.missed_motion import MissedMotion
from cartoloop.local_slam.odometry_motion import OdometryMotion
from cartoloop.local_slam.odometry_window import Evidence
from cartoloop.local_slam.prediction import Prediction, isotropic_information
from cartoloop.local_slam.sensor_calibration import SensorCalibration
from cartoloop.local_slam.slip import own_velocity, since_slip
from cartoloop.local_slam.sweep_prediction import SweepPrediction, middle_of_sweep
from cartoloop.local_slam.velocity_filter import VelocityFilter
from cartoloop.sensor.events import Imu
from cartoloop.sensor.pose import IDENTITY, Pose, compose, relative
from cartoloop.sensor.sweep_motion import SweepMotion

MAX_RECENT = 256
"""Number of latest scans whose poses are kept for odometry that catches up: some seconds of them.
"""

STANDING_SPEED, STANDING_RATE = 0.05, 0.03
"""Velocities below which matched scans do not contradict rest [m/s], [rad/s]: their noise."""

FAR_M, FAR_RAD = 0.5, math.radians(15.0)
"""Step from scan to scan by odometry from which it is far [m], [rad]: scans are sparse then, or the
robot turns fast."""


class PoseExtrapolator:
    """Predicts by odometry where it is available, by constant velocity otherwise.

    Where there is an IMU, the heading is predicted by its gyroscope.

    Parameters
    ----------
    config : parameters of local SLAM.
    known : what is known about the sensors before; by default nothing.

    Attributes
    ----------
    odometry : the motion that wheels measured.
    gyroscope : the rotation that an IMU measured.
    """

    def __init__(self, config: LocalSlamConfig, known: SensorCalibration | None = None) -> None:
        self._config = config
        self._prediction = config.prediction
        self.odometry = OdometryMotion()
        if known is not None:
            self.odometry = OdometryMotion(
                known.odometry,
                known.odometry_score,
                known.odometry_held_s,
                is_mirrored=known.odometry_is_mirrored,
            )
        self.gyroscope = Gyroscope(config.imu_gravity_time_constant)
        # begin and motion of the last step by odometry
        self._assumed: tuple[float, Pose] | None = None
        self._time = 0.0
        self._tf_local_tracking = IDENTITY
        self._velocity = VelocityFilter(config.prediction)
        self._middle_time, self._middle = 0.0, IDENTITY
        self._middles: dict[str, tuple[float, Pose]] = {}
        self._recent: deque[tuple[float, Pose]] = deque(maxlen=MAX_RECENT)
        self._num_poses = 0
        self._is_determined = True
        self._was_made_up_for = False
        self._sweeps = SweepPrediction(config, self.odometry, self.gyroscope, self._velocity)

    @property
    def measures_motion(self) -> bool:
        """Whether odometry or an IMU measures the motion between scans."""
        return self.odometry.has_readings or self.gyroscope.track is not None

    def summary(self) -> dict[str, Any]:
        """Return the estimates about odometry and IMU, for the report."""
        summary: dict[str, Any] = {"odometry": self.odometry.summary()} | self.gyroscope.summary()
        if self._sweeps.num_overlong:
            summary["sweeps_too_long"] = self._sweeps.num_overlong
        return summary

    def add_odometry(self, time: float, tf_odom_tracking: Pose) -> None:
        """Add a wheel-odometry reading."""
        if self._config.use_odometry:
            self.odometry.add(time, tf_odom_tracking)

    def add_imu(self, imu: Imu) -> None:
        """Add an inertial reading."""
        if self._config.use_imu:
            self.gyroscope.add(imu)

    def add_pose(
        self,
        time: float,
        tf_local_tracking: Pose,
        motion: SweepMotion | None = None,
        evidence: Evidence | None = None,
        scanner: str = "",
        missed_velocity: tuple[float, float] | None = None,
    ) -> None:
        """Add the matched pose of a scan, the motion assumed in its sweep, and what it determines.

        Also what the odometry has missed of the velocity [m/s], local frame, where scans have shown
        along walls that wheels slip: the step to the pose makes up for earlier ones as well.

        A sweep is matched as a whole, so the pose of its middle is correct even if the assumed
        motion is not. Velocity, clock offsets and biases are therefore estimated from the middles.
        """
        middle_time, middle = middle_of_sweep(time, tf_local_tracking, motion)
        last = self._middles.get(scanner)
        expected = None
        if last is not None:
            if not self.odometry.is_stale:
                expected = self._velocity.step(middle_time - last[0])
            self._velocity.update(relative(last[1], middle), middle_time - last[0])
        num_faulty = self.odometry.compare(last, middle_time, middle, evidence, scanner, expected)
        if last is None or self._was_made_up_for:
            num_faulty = max(num_faulty, 1)  # the poses show no step to this scan
        if last is not None and missed_velocity is not None:
            self._note_slip(last, middle_time, missed_velocity)
        self._was_made_up_for = False
        self._is_determined = evidence is None or evidence.is_determined
        if self._is_determined:
            self._assumed = None
        self._middle_time, self._middle = middle_time, middle
        self._middles[scanner] = middle_time, middle
        self._time, self._tf_local_tracking = time, tf_local_tracking
        self._recent.append((time, tf_local_tracking))
        self._num_poses += 1
        is_matched = evidence is not None
        self.odometry.add_pose(middle_time, middle, num_faulty, scanner, is_matched=is_matched)
        if self.gyroscope.track is not None:
            x, y, rate = self._velocity.step(1.0)
            may_stand = math.hypot(x, y) < STANDING_SPEED and abs(rate) < STANDING_RATE
            self.gyroscope.add_pose(middle_time, middle, is_matched=is_matched, may_stand=may_stand)

    def since_slip(
        self, time: float, matched: Pose, shown: Pose, missed_velocity: tuple[float, float]
    ) -> Pose:
        """Return a pose that makes up for all since the wheels slip, see :func:`since_slip`."""
        return since_slip((*self._recent, (time, matched)), shown, missed_velocity)

    def _note_slip(
        self, last: tuple[float, Pose], time: float, missed_velocity: tuple[float, float]
    ) -> None:
        """Leave the odometry out until it agrees with the scans again; correct the velocity."""
        begin, pose = last
        reported = self.odometry.measured_step(begin, time)
        if reported is None or time <= begin:
            return
        duration = time - begin
        x, y = own_velocity(reported, duration, pose.theta, missed_velocity)
        self._velocity.resume(x, y)
        moved = Pose(duration * x, duration * y, reported.theta)
        self.odometry.note_slip(begin, moved, reported)

    def relocate(self) -> None:
        """Note that the next pose does not follow from the latest: these were wrong."""
        self._middles.clear()
        self._recent.clear()

    def shift(self, scanner: str, by: float) -> None:
        """Correct the times of a scanner's scans so far, since its clock offset changes [s]."""
        time, middle = self._middles[scanner]
        self._middles[scanner] = time + by, middle
        self.odometry.shift(scanner, by)

    def predict(self, time: float) -> Prediction:
        """Return the motion prior of a scan at a time not before the last pose."""
        if self._num_poses == 0:
            return self.prediction_from(time, IDENTITY)
        since = self.odometry.caught_up_since()
        if since is not None and (caught_up := self._caught_up(since, time)) is not None:
            self._assumed = None
            return caught_up
        step = self.odometry.step(self._time, time)
        if step is None:
            expected = self._velocity.step(time - self._time)
            step = self.odometry.agreed_step(self._time, time, expected)
            if step is None and not self._is_determined:
                step = self._unsteady_step(time, expected)
        if step is None:
            self._assumed = None
            stands = self.odometry.has_stood(self._time, time)
            # Along bare walls, constant velocity would go on for ever with what noise began.
            rests = stands and not self._is_determined
            expected = self._tf_local_tracking if rests else self._without_trusted_odometry(time)
            prediction = self.prediction_from(time, expected)
            step = self.odometry.step_over_jump(self._time, time)
            over_jump = step and compose(self._tf_local_tracking, step)
            gap = self._gap(time, prediction.tf_local_tracking, by_odometry=False)
            return prediction._replace(over_jump=over_jump, stands=stands, gap=gap)
        step, self._assumed = self._with_missed_motion(step), (self._time, step)
        pose = compose(self._tf_local_tracking, self.gyroscope.with_turn(step, self._time, time))
        return Prediction(
            pose,
            True,
            self.odometry.information(self._prediction),
            partial(self._fallbacks, time),
            stands=step == IDENTITY,
            is_far=math.hypot(step.x, step.y) > FAR_M or abs(step.theta) > FAR_RAD,
            gap=self._gap(time, pose, by_odometry=True),
        )

    def _gap(self, time: float, predicted: Pose, *, by_odometry: bool) -> Gap | None:
        """Return the gap in the recording before a scan, if there is one."""
        duration, last = time - self._time, self._tf_local_tracking
        if duration <= MIN_GAP_S or not is_gap(duration, [when for when, _ in self._recent]):
            return None
        steps = self.odometry.steps_over_gap(self._time, time)
        poses = (predicted, *(compose(last, step) for step in steps))
        x, y, rate = self._velocity.step(1.0)
        turn = duration * rate
        if by_odometry:
            moved = math.hypot(predicted.x - last.x, predicted.y - last.y)
            return gap_by_odometry(poses, moved, turn)
        no_turn = self.gyroscope.turn(self._time, time) is None
        is_lost = no_turn and self._doubtful_step(time) is None
        return gap_without_odometry(poses, duration, math.hypot(x, y), turn, is_lost=is_lost)

    def _unsteady_step(self, time: float, expected: Pose) -> Pose | None:
        """Return a step as long as noisy odometry says, with the turn of constant velocity."""
        step = self.odometry.unsteady_step(self._time, time)
        return None if step is None else step._replace(theta=expected.theta)

    def _without_trusted_odometry(self, time: float) -> Pose:
        """Return the pose at constant velocity; after a gap, where doubtful odometry says."""
        if time - self._time > self._prediction.velocity_horizon:
            step = self._doubtful_step(time)
            if step is not None:
                turned = self.gyroscope.with_turn(step, self._time, time)
                return compose(self._tf_local_tracking, turned)
        return self._at_constant_velocity(time)

    def _doubtful_step(self, time: float) -> Pose | None:
        """Return the step of odometry that is not trusted, or None if there is none."""
        return self.odometry.doubtful_step(self._time, time)

    def _with_missed_motion(self, step: Pose) -> Pose:
        """Return a step, and by how much the odometry's last step was wrong, as is known by now.

        Live, it was extrapolated; and readings give way to others with the same stamp. Along bare
        walls the last match has followed it, so that errors would add up.
        """
        if self._assumed is None:
            return step
        begin, assumed = self._assumed
        known = self.odometry.step(begin, self._time)
        if known is None or known == assumed:
            return step
        missed = relative(assumed, known)
        return compose(Pose(missed.x, missed.y, 0.0), step)

    def make_up(self) -> MissedMotion | None:
        """Correct the latest pose where odometry has stopped alone; return the motion it missed.

        The matches of scans were held where the robot was, most of all along bare walls.
        """
        found = self.odometry.missed_motion()
        if found is None:
            return None
        since, velocity = found
        before = [entry for entry in self._recent if entry[0] <= since]
        if not before:
            return None
        missed = MissedMotion(*before[-1], velocity)
        if not missed.is_held(self._time, self._tf_local_tracking):
            return None
        self._tf_local_tracking = missed.corrected(self._time, self._tf_local_tracking)
        self._middle = missed.corrected(self._middle_time, self._middle)
        self._middles = {
            scanner: (time, missed.corrected(time, middle))
            for scanner, (time, middle) in self._middles.items()
        }
        self._recent = deque(
            ((time, missed.corrected(time, pose)) for time, pose in self._recent), maxlen=MAX_RECENT
        )
        self._velocity.resume(*velocity)
        self._was_made_up_for = True
        return missed

    def _caught_up(self, since: float, time: float) -> Prediction | None:
        """Return the motion prior once the odometry has caught up, None if that is not possible.

        While it repeated a reading, matches along bare walls could not know how far the robot
        moved. So the motion since the last scan before is taken, not since the last scan.
        """
        number = sum(1 for scan_time, _ in self._recent if scan_time > since)
        if number == len(self._recent):
            return None
        begin, pose = self._recent[len(self._recent) - number - 1]
        step = self.odometry.measured_step(begin, time)
        self.odometry.renew()
        if step is None or not self.odometry.forgive(since):
            return None
        predicted = compose(pose, self.gyroscope.with_turn(step, begin, time))
        return Prediction(
            predicted,
            True,
            self.odometry.information(self._prediction) / (number + 1),
            partial(self._fallbacks, time),
            gap=self._gap(time, predicted, by_odometry=True),
        )

    def prediction_from(self, time: float, tf_local_tracking: Pose) -> Prediction:
        """Return the motion prior around a pose that does not rely on odometry."""
        information = self._velocity_information(time, tf_local_tracking)
        return Prediction(tf_local_tracking, False, information, partial(self._fallbacks, time))

    def _velocity_information(self, time: float, moved: Pose) -> FloatArray:
        config, rest = self._prediction, self._tf_local_tracking
        pixel, duration = self._config.submaps.resolution, time - self._time
        translation, rotation = self._velocity.sigmas(duration)
        if self.gyroscope.turn(self._time, time) is not None:
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
        return compose(self._tf_local_tracking, self.gyroscope.with_turn(step, self._time, time))

    def sweep_motion(self, time: float, first: float, last: float) -> SweepMotion | None:
        """Return the predicted motion during a sweep, see :meth:`SweepPrediction.predicted`."""
        return self._sweeps.predicted(time, first, last)

    def corrected_motion(
        self, time: float, tf_local_tracking: Pose, motion: SweepMotion | None
    ) -> SweepMotion | None:
        """Return a better estimate of that motion, see :meth:`SweepPrediction.corrected`."""
        if motion is None or not self._num_poses:
            return None
        last_middle = self._middle_time, self._middle
        return self._sweeps.corrected(time, tf_local_tracking, motion, last_middle)
