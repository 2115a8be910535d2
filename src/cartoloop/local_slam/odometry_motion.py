# SPDX-License-Identifier: Apache-2.0
"""The motion between two times as calibrated odometry measured it, and whether it is trusted."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from cartoloop.arrays import FloatArray
from cartoloop.config import PredictionConfig
from cartoloop.local_slam.measured_distance import MeasuredDistance
from cartoloop.local_slam.odometry_calibration import OdometryCalibration
from cartoloop.local_slam.odometry_parameters import OdometryParameters, step_information
from cartoloop.local_slam.odometry_pauses import OdometryPauses
from cartoloop.local_slam.odometry_rest import OdometryRest
from cartoloop.local_slam.odometry_track import MAX_EXTRAPOLATION_S, OdometryTrack
from cartoloop.local_slam.odometry_trust import OdometryFault, OdometryTrust, differ, follows
from cartoloop.local_slam.odometry_window import Evidence
from cartoloop.local_slam.turn_comparison import TurnsByScanner
from cartoloop.sensor.pose import IDENTITY, Pose, relative

STOOD_M, STOOD_RAD = 0.2, 0.1
"""Odometry that has not moved so far is wrong once the scans have moved by this [m], [rad]: those
of a noisy scanner move by some centimetres while the robot stands."""

STALE_M, STALE_RAD, STALE_SHARE = 0.03, 0.03, 0.5
"""Odometry that does not change at all while the scans move by more than this [m], [rad] repeats an
old reading. It is new again when it agrees with the scans up to that and a share of the motion."""

ODOMETRY_REACH_S = 4.0
"""Time around a scan for which the odometry is asked [s]: as many seconds as the clock offsets and
delays that are tried add up to, and half a sweep."""

KNOWN_SHIFTS_S: tuple[float, ...] = (-0.1, 0.1)
"""Times by which odometry may be late once its clock is known [s]."""

UNKNOWN_SHIFTS_S: tuple[float, ...] = tuple(0.1 * k for k in range(-12, 13) if k)
"""The same before its clock is known [s]."""

BUFFERED_S = 0.5
"""Readings as near to the ends of a gap may be of other times than their stamps say [s]."""


class OdometryMotion:
    """Wheel odometry, calibrated and compared with matched scans.

    Parameters
    ----------
    model : what is known about it before; by default nothing.
    score : largest score against its predictions in an earlier pass.
    held_s : how long its readings are held, by an earlier pass; 0 if they are not [s].
    is_mirrored : whether it turned to the other side than the scans in an earlier pass.
    """

    def __init__(
        self,
        model: OdometryParameters | None = None,
        score: float = 0.0,
        held_s: float = 0.0,
        *,
        is_mirrored: bool = False,
    ) -> None:
        self._known_before = model, score
        self._is_held = held_s > 0.0
        self._track = OdometryTrack(held_s)
        self._calibration = OdometryCalibration(model)
        self._trust = OdometryTrust(score)
        self._turns = TurnsByScanner(were_opposite=is_mirrored)
        self._pauses = OdometryPauses()
        self._information: tuple[OdometryParameters, FloatArray] | None = None
        self._step_key: _StepKey | None = None
        self._step: Pose | None = None
        self._is_stale = self._misses_motion = False
        self._rest = OdometryRest()
        self._stood_at: Pose | None = None
        self._made_up_for = -math.inf  # begin of the latest rest whose motion was asked for
        self._num_late = 0

    @property
    def model(self) -> OdometryParameters:
        """Its estimated calibration."""
        return self._calibration.model

    @property
    def score(self) -> float:
        """The largest score against its predictions so far."""
        return self._trust.largest_score

    @property
    def held_s(self) -> float:
        """How long its readings are held [s]; 0 if they are not."""
        return self._track.period.held_s

    @property
    def faults(self) -> list[OdometryFault]:
        """The times at which it did not move as the scans did, so far."""
        return self._trust.faults

    @property
    def has_readings(self) -> bool:
        """Whether there is any."""
        return self._track.latest > -math.inf

    @property
    def is_stale(self) -> bool:
        """Whether it repeats an old reading while the scans move, jumps often, or is mirrored."""
        return self._is_stale or self._misses_motion or self._track.jumps_often or self.is_mirrored

    @property
    def is_mirrored(self) -> bool:
        """Whether it turns to the other side than the scans, as far as is known by now."""
        return self._turns.are_opposite

    @property
    def shows_motion(self) -> bool:
        """Whether there is odometry that moves when the scans do, and turns to the same side."""
        return self.has_readings and not self.is_stale

    @property
    def is_trusted(self) -> bool:
        """Whether there is odometry that moves as the scans do."""
        return self.shows_motion and self._trust.is_trusted

    @property
    def is_long(self) -> bool:
        """Whether it is time to forget some of it."""
        return self._track.is_long

    def summary(self) -> dict[str, Any]:
        """Return the estimates about it, for the report."""
        track = {
            "readings": len(self._track),
            "jumps": self._track.num_jumps,
            "catch_ups": self._track.num_late,
            "pauses": [asdict(pause) for pause in self._pauses.found],
            "faults": [asdict(fault) for fault in self._trust.faults],
            "scales": [
                {"begin": begin, "translation_scale": scale}
                for begin, scale in self._calibration.scales
            ],
        }
        return self.model.summary() | track | {"turn_ratio": self._turns.ratio}

    def add(self, time: float, tf_odom_tracking: Pose) -> None:
        """Add a reading."""
        self._track.add(time, tf_odom_tracking)
        if self._track.period.are_held and not self._is_held:
            # Until now, the motion of several scans was compared with that of one.
            self._is_held = True
            model, score = self._known_before
            self._calibration, self._trust = OdometryCalibration(model), OdometryTrust(score)

    def forget(self, needed: Sequence[float]) -> None:
        """Forget what cannot change any pose or calibration any more.

        Parameters
        ----------
        needed : times of earlier scans from which a distance will be measured [s].
        """
        used = np.concatenate((self._calibration.used_times(), needed))
        self._track.forget(used, ODOMETRY_REACH_S + abs(self.model.time_offset))

    def reaches(self, time: float) -> bool:
        """Return whether it has been read up to a time of the scans, or there is none.

        Beyond its readings it is extrapolated, and what that is wrong by stays in the next step.
        """
        return not self.has_readings or self._track.known_until + self.model.time_offset >= time

    @property
    def longest_wait_s(self) -> float:
        """How long a scan waits for the reading after it [s]: as long as it may take to come."""
        return max(MAX_EXTRAPOLATION_S, self._track.period.longest_s)

    def add_pose(
        self, time: float, pose: Pose, num_faulty: int, scanner: str, *, is_matched: bool
    ) -> None:
        """Calibrate with a scan's pose; `num_faulty` of the latest steps are left out."""
        if not self.has_readings:
            return
        self._pauses.add(time, self._track)
        self._calibration.add(time, pose, self._track, num_faulty, scanner, is_matched=is_matched)
        reported = self._track.at(time - self.model.time_offset)
        self._turns.add(scanner, pose.theta, None if reported is None else reported.theta)

    def add_distance(self, distance: MeasuredDistance) -> None:
        """Add a distance between two scans that these alone measure."""
        self._calibration.add_distance(distance)

    def shift(self, scanner: str, by: float) -> None:
        """Correct the times of a scanner's scans so far, since its clock offset changes [s]."""
        self._calibration.shift(scanner, by)

    def compare(
        self,
        last: tuple[float, Pose] | None,
        time: float,
        pose: Pose,
        evidence: Evidence | None,
        scanner: str,
        expected: Pose | None,
    ) -> int:
        """Compare it with a matched pose; return how many latest steps are faulty.

        Parameters
        ----------
        last : time and pose of the scanner's last scan.
        time, pose : of this one.
        evidence : of its match; None if it was not matched.
        expected : the motion at constant velocity; None where that is not known.
        """
        if not self.has_readings:
            return 0
        reported = None if last is None else self.measured_step(last[0], time)
        if last is None or reported is None:
            self._misses_motion = False
        else:
            seen = evidence if self._track.has_moved else None
            self._misses_motion = self._rest.misses_motion(last[0], time, reported, seen)
        is_known = self.model.is_known
        num_faulty = self._trust.add(
            time, pose, reported, evidence, self._is_late, is_known, scanner, expected
        )
        if last is None or reported is None or evidence is None or not evidence.is_determined:
            return max(num_faulty, int(self._misses_motion))
        matched = relative(last[1], pose)
        apart = math.hypot(matched.x - reported.x, matched.y - reported.y)
        turned_apart = abs(matched.theta - reported.theta)
        if not self._track.has_moved:
            first = self._stood_at = self._stood_at or last[1]
            moved = relative(first, pose)
            self._is_stale = math.hypot(moved.x, moved.y) > STOOD_M or abs(moved.theta) > STOOD_RAD
        elif self._is_stale:
            self._is_stale = apart > STALE_M + STALE_SHARE * math.hypot(
                matched.x, matched.y
            ) or turned_apart > STALE_RAD + STALE_SHARE * abs(matched.theta)
        elif reported == IDENTITY:
            self._is_stale = apart > STALE_M or turned_apart > STALE_RAD
        return max(num_faulty, int(self.is_stale))

    def _is_late(self, begin: float, end: float, matched: Pose) -> bool:
        """Return whether the odometry reports about such a motion shortly before or after."""
        shifts = KNOWN_SHIFTS_S if self.model.knows_rotation else UNKNOWN_SHIFTS_S
        length = math.hypot(matched.x, matched.y)
        for shift in shifts:
            step = self.measured_step(begin - shift, end - shift)
            if step is not None and not differ(
                Pose(length, 0.0, matched.theta),
                Pose(math.hypot(step.x, step.y), 0.0, step.theta),
                is_calibrated=False,
            ):
                return True
        return False

    def caught_up_since(self) -> float | None:
        """Return since when it had repeated a reading [s] if it has caught up, once; else None."""
        if self._num_late == self._track.num_late:
            return None
        self._num_late = self._track.num_late
        return self._track.late_since + self.model.time_offset

    def missed_motion(self) -> tuple[float, tuple[float, float]] | None:
        """Return since when it has missed the robot's motion [s], and its velocity then [m/s].

        Once for each time in which it rests; None if it does not, or scans have not shown it yet.
        """
        if not self._misses_motion or self._made_up_for == self._rest.since:
            return None
        if not self._rest.shows_motion():
            return None
        self._made_up_for = self._rest.since
        return self._rest.driven_until, self._rest.velocity_before

    def note_slip(self, begin: float, moved: Pose, reported: Pose) -> None:
        """Leave it out from a time on, see :meth:`OdometryTrust.note_slip`."""
        self._trust.note_slip(begin, moved, reported)

    def forgive(self, since: float) -> bool:
        """Forget a fault that began after a time [s]; return whether it is trusted."""
        return self._trust.forgive(since)

    def renew(self) -> None:
        """Note that it repeats no old reading any more."""
        self._is_stale = False

    def information(self, config: PredictionConfig) -> FloatArray:
        """Return the information of a step, upper triangle, shape (6,); not to be changed."""
        model = self.model
        if self._information is None or self._information[0] is not model:
            self._information = model, step_information(model, config)
        return self._information[1]

    def step(self, begin: float, end: float) -> Pose | None:
        """Return the calibrated motion between two times, None if it is not known or trusted."""
        if self.is_stale or not self._trust.is_trusted or not self._track.has_moved:
            return None
        return self.measured_step(begin, end)

    def has_stood(self, begin: float, end: float) -> bool:
        """Return whether it has reported no motion so far, and contradicts no scans.

        It may be broken, so that it predicts nothing, or of a robot that has not set off.
        """
        if self._track.has_moved or self._is_stale or self._trust.has_fault:
            return False
        return self.measured_step(begin, end) is not None

    def agreed_step(self, begin: float, end: float, expected: Pose) -> Pose | None:
        """Return the step of odometry with a fault where it moves as expected, or None.

        Along bare walls it cannot show that it is good again, and is better than what they show.
        """
        if self.is_stale or not self._trust.has_fault:
            return None
        step = self.measured_step(begin, end)
        return step if step is not None and follows(step, expected) else None

    def unsteady_step(self, begin: float, end: float) -> Pose | None:
        """Return the step of odometry that is left out only since its steps are noisy, or None.

        Their sum is right, so that it is better where the scans do not show how far the robot
        moves: constant velocity does not notice that it becomes faster or slower.
        """
        if self.is_stale or not self._trust.is_unsteady or not self._track.has_moved:
            return None
        return self.measured_step(begin, end)

    def doubtful_step(self, begin: float, end: float) -> Pose | None:
        """Return the step of odometry that is not trusted, or None if it still repeats a reading.

        Across a gap between scans it is better than what nothing measures.
        """
        step = self.measured_step(begin, end)
        return None if self.is_mirrored or (self.is_stale and step == IDENTITY) else step

    def measured_step(self, begin: float, end: float) -> Pose | None:
        """Return the calibrated motion that it measured between two times, or None."""
        model = self.model
        key = begin, end, self._track.revision, model
        # The prediction of a scan and its comparison with the match ask for the same step.
        known = self._step_key
        if known is not None and key[:3] == known[:3] and model is known[3]:
            return self._step
        begin, end = begin - model.time_offset, end - model.time_offset
        begin = self._track.known_from(begin, end)
        before, after = self._track.at(begin), self._track.at(end)
        step = None
        if before is not None and after is not None and not self._track.jumps_between(begin, end):
            step = model.predict(relative(before, after), before.theta)
        self._step_key, self._step = key, step
        return step

    def step_over_jump(self, begin: float, end: float) -> Pose | None:
        """Return the motion between two times across a jump, if there is one, as it was reported.

        What seems too fast for a robot may be a motion whose stamps are wrong.
        """
        model = self.model
        begin, end = begin - model.time_offset, end - model.time_offset
        if not self.is_trusted or not self._track.jumps_between(begin, end):
            return None
        before, after = self._track.reported_at(begin), self._track.reported_at(end)
        if before is None or after is None:
            return None
        return model.predict(relative(before, after), before.theta)

    def steps_over_gap(self, begin: float, end: float) -> list[Pose]:
        """Return what may have been the motion between two times between which nothing was sent.

        What was sent right before and after a gap may have been buffered: readings that are newer
        or older than their stamps. So each of those around one time is taken with each of those
        around the other.
        """
        if self.is_mirrored:
            return []
        model = self.model
        begin, end = begin - model.time_offset, end - model.time_offset
        reach = min(BUFFERED_S, 0.5 * (end - begin))
        return [
            model.predict(relative(before, after), before.theta)
            for before in self._track.reported_around(begin, reach)
            for after in self._track.reported_around(end, reach)
        ]


_StepKey = tuple[float, float, int, OdometryParameters]
