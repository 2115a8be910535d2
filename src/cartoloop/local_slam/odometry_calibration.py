# SPDX-License-Identifier: Apache-2.0
"""Calibration of the odometry: offset of its clock, scales, veer, yaw and lever arm.

Odometry stored with a scan is often newer than the scan (0.14 to 0.64 s in the Radish logs) and
its rotation is wrong by 5 to 20%. Scanners are mounted with errors of up to a degree, so that the
predictions are biased to one side, which bends long corridors. These errors follow from comparing
the motion between matched scans with the motion that the odometry reports, and are estimated
repeatedly while mapping.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import replace

import numpy as np

from cartoloop.arrays import BoolArray, FloatArray
from cartoloop.local_slam.clock_offset import (
    FIRST_ESTIMATE,
    MIN_TURN_RAD,
    clock_offset,
    next_estimate,
)
from cartoloop.local_slam.matched_scans import MatchedScans, ScanSeries, latest
from cartoloop.local_slam.measured_distance import MeasuredDistance
from cartoloop.local_slam.odometry_parameters import OdometryParameters
from cartoloop.local_slam.odometry_readings import are_measured
from cartoloop.local_slam.odometry_scale import (
    MATCHED_ERROR,
    MAX_SCALE,
    MIN_DISTANCES,
    MIN_SCALE,
    NUM_DISTANCES,
    with_measured_scale,
)
from cartoloop.local_slam.odometry_track import OdometryTrack
from cartoloop.local_slam.odometry_veer import estimate_veer
from cartoloop.sensor.pose import Pose, relative_all

WINDOW = 1500
"""Number of latest scans that are used: some minutes, so that a drifting clock is followed."""

VEER_WINDOW = 6000
"""The same for the veer, which does not change, and shows only after several headings."""

MIN_STEPS = 25
"""Number of turning steps needed for the clock offset, and of moving steps for the rest."""

MAX_OPEN_STEPS = 150
"""Number of turning steps for which a clock offset may stay open. Meanwhile the rotation is not
known: matches that follow the odometry closely turn when it does, and would hide the offset."""

MIN_MOVE_M = 0.02
"""Steps shorter than this and without a turn are not used [m]: the noise of a match."""

SCALE_ROUNDS, LEVER_ROUNDS = 5, 8
"""Rounds of reweighting, after which the estimates change by less than their noise."""

SCALE_SIGMA, SHORT_M = 0.05, 3.0
"""Standard deviation of the scale of odometry from 1 while the path is shorter than the second [m]:
on the first metre, the noise of some steps would show scales of 0.8."""

SCALE_PRIOR, LEVER_PRIOR = 1e-3, 0.02
"""Least weight of the prior of the scale, and that of a lever arm of zero, which without turns the
equations leave undetermined; a lever arm of half a metre is large."""

USUAL_SCALES = (0.7, 1.4)
"""Turns that are other than reported by up to these factors are compared as they are."""

MOST_FAULTY, EXPLAINED_SHARE = 0.5, 0.25
"""Once this share of the steps is left out, another calibration is tried: this one may be what is
wrong. It is if errors by the other one are below the second share of the steps, in the median."""

NOTED_CHANGE = 0.002
"""Changes of the scale that are noted, as a share of it."""

MIN_TYPICAL_ERROR_M = 1e-4
"""Lower limit of the typical error of a step [m], so that exact data do not divide by zero."""


class OdometryCalibration:
    """Collects matched scan poses and estimates the :class:`OdometryParameters` from them.

    Parameters
    ----------
    model : what is known before; by default nothing.
    window : number of latest scans that are used, but for the veer.
    first : number of scans before the first estimate.

    Attributes
    ----------
    model : the present estimate.
    scales : translation scales that were used, each with the time of the first scan [s]. They
        change while it is learnt.
    """

    def __init__(
        self,
        model: OdometryParameters | None = None,
        window: int = WINDOW,
        first: int = FIRST_ESTIMATE,
    ) -> None:
        self.model = model or OdometryParameters()
        self._window = window
        self._due = first
        self._series: dict[str, ScanSeries] = {}
        self._known = self.model
        self._distances: deque[MeasuredDistance] = deque(maxlen=NUM_DISTANCES)
        self._num_scans = 0
        self._num_tried = 0
        self.scales: list[tuple[float, float]] = []

    def shift(self, scanner: str, by: float) -> None:
        """Correct the times of a scanner's scans so far, since its clock offset changes [s]."""
        series = self._series.get(scanner)
        if series is not None:
            series.shift(by)

    def add_distance(self, distance: MeasuredDistance) -> None:
        """Add a distance that scans measured."""
        self._distances.append(distance)

    def used_times(self) -> FloatArray:
        """Return the times at which it will ask for the odometry again, up to clock offsets [s]."""
        ends = [(one.begin, one.end) for one in self._distances]
        scans = [series.times for series in self._series.values()]
        every = (ends, *scans)
        return np.concatenate([np.array(times, dtype=np.float64).ravel() for times in every])

    def add(
        self,
        time: float,
        tf_local_tracking: Pose,
        track: OdometryTrack,
        num_faulty: int = 0,
        scanner: str = "",
        *,
        is_matched: bool = True,
    ) -> None:
        """Add a scan's pose; from time to time, estimate again.

        `num_faulty` of the latest steps of this scanner, up to this scan, are not used, nor those
        to and from a scan that was not matched. Steps are taken between scans of one scanner, since
        the clocks of scanners differ.
        """
        self._num_scans += 1
        self._note_scale(time)
        series = self._series.setdefault(scanner, ScanSeries())
        series.add(time, tf_local_tracking, is_matched=is_matched)
        if num_faulty:
            series.leave_out(num_faulty)
        if self._num_scans >= self._due:
            self._due = next_estimate(self._num_scans)
            self.model = self._estimated(track)
        elif self._may_show_first_scale():
            self.model = self._with_scale(self.model, track, matched_error=math.inf)

    def _note_scale(self, time: float) -> None:
        scale = self.model.translation_scale
        if not self.scales or abs(scale / self.scales[-1][1] - 1.0) > NOTED_CHANGE:
            self.scales.append((time, scale))

    def _may_show_first_scale(self) -> bool:
        """Return whether a further distance may be the one that shows the scale at last.

        Until then the robot is where uncalibrated odometry says, wherever scans hardly measure the
        distance: along corridors, the map is too long by as much.
        """
        count = len(self._distances)
        if self.model.knows_scale or count < max(MIN_DISTANCES, self._num_tried + 1):
            return False
        self._num_tried = count
        return True

    def _estimated(self, track: OdometryTrack) -> OdometryParameters:
        """Return what scans and odometry so far show."""
        every = list(self._series.values())
        for one in every:
            one.cut(max(self._window, VEER_WINDOW))
        odometry, before = track.arrays(), self.model
        veer, num_stretches = estimate_veer(
            latest(every, VEER_WINDOW), *odometry, before.time_offset, before.veer
        )
        known = replace(before, veer=veer, num_stretches=num_stretches)
        scans = latest(every, self._window)
        num_matched = sum(one.steps(self._window, with_faulty=True).sum() for one in every)
        if scans.is_usable.sum() < MOST_FAULTY * num_matched:
            scans = self._with_explained(scans, track)
        model = estimate(scans.times, scans.poses, *odometry, known, scans.is_usable)
        return self._with_scale(model, track, math.inf if model is known else MATCHED_ERROR)

    def _with_explained(self, scans: MatchedScans, track: OdometryTrack) -> MatchedScans:
        """Return the scans, with all steps usable if another calibration explains most of them."""
        every = latest(self._series.values(), self._window, with_faulty=True)
        start = replace(OdometryParameters(), veer=self.model.veer)
        model = estimate(every.times, every.poses, *track.arrays(), start, every.is_usable)
        return every if _explains(model, every) else scans

    def _with_scale(
        self, model: OdometryParameters, track: OdometryTrack, matched_error: float
    ) -> OdometryParameters:
        """Return a model with the scale that the distances show; its own has a standard error."""
        return with_measured_scale(
            model, self._distances, *track.arrays(), self._known, matched_error
        )


def estimate(
    times: FloatArray,
    poses: FloatArray,
    odometry_times: FloatArray,
    odometry_poses: FloatArray,
    previous: OdometryParameters,
    is_usable: BoolArray | None = None,
) -> OdometryParameters:
    """Return the model that fits the motion between scans best; `previous` if too few steps move.

    Parameters
    ----------
    times, poses : float64, shapes (n,), (n, 3): matched scans.
    odometry_times, odometry_poses : float64, shapes (k,), (k, 3), times increasing, headings
        continuous.
    previous : the model so far. Its veer is taken to be known.
    is_usable : shape (n,), whether the step to each scan is used; by default all are.
    """
    if len(odometry_times) < 2:
        return previous
    steps = relative_all(poses[:-1], poses[1:])
    heading = odometry_poses[:, 2]
    is_measured = are_measured(times, odometry_times)
    known = is_measured[:-1] & is_measured[1:]
    if is_usable is not None:
        known &= is_usable[1:]
    turning = (np.abs(steps[:, 2]) > MIN_TURN_RAD) & known
    offset, rotation_scale = previous.time_offset, previous.rotation_scale
    num_turns = int(np.count_nonzero(turning))
    turns_enough = num_turns >= MIN_STEPS
    is_open = False
    if turns_enough:
        rotation_scale = _coarse_scale(times, steps[:, 2], turning, odometry_times, heading)
        found = clock_offset(
            times,
            steps[:, 2],
            turning,
            odometry_times,
            rotation_scale * heading,
            previous=previous.time_offset,
        )
        if found is None:
            return previous
        offset = found.offset
        is_open = found.is_open and num_turns < MAX_OPEN_STEPS
    at_scans = np.column_stack(
        [np.interp(times - offset, odometry_times, column) for column in odometry_poses.T]
    )
    reported = relative_all(at_scans[:-1], at_scans[1:])
    reported = previous.veer.corrected_all(reported, at_scans[:-1, 2])
    if turns_enough:
        rotation_scale = _turn_scale(reported[turning, 2], steps[turning, 2], rotation_scale)
    moving = known & (turning | (np.hypot(reported[:, 0], reported[:, 1]) > MIN_MOVE_M))
    if np.count_nonzero(moving) < MIN_STEPS:
        return previous
    model = OdometryParameters(
        offset, rotation_scale, *_scale_yaw_and_lever(reported[moving], steps[moving])
    )
    errors = np.abs(model.without_veer_all(reported[moving]) - steps[moving])
    knows_rotation = not is_open if turns_enough else previous.knows_rotation
    return replace(
        model,
        veer=previous.veer,
        num_stretches=previous.num_stretches,
        num_turns=num_turns,
        rotation_error=float(np.median(errors[:, 2])) if knows_rotation else math.nan,
        translation_error=float(np.median(np.hypot(errors[:, 0], errors[:, 1]))),
    )


def _explains(model: OdometryParameters, scans: MatchedScans) -> bool:
    """Return whether the errors of a model are small compared with the motions of the scans."""
    if not (model.is_known and model.knows_rotation):
        return False
    steps = relative_all(scans.poses[:-1], scans.poses[1:])[scans.is_usable[1:]]
    lengths, turns = np.hypot(steps[:, 0], steps[:, 1]), np.abs(steps[:, 2])
    lengths, turns = lengths[lengths > MIN_MOVE_M], turns[turns > MIN_TURN_RAD]
    return (
        len(lengths) >= MIN_STEPS
        and model.translation_error <= EXPLAINED_SHARE * float(np.median(lengths))
        and model.rotation_error <= EXPLAINED_SHARE * float(np.median(turns))
    )


def _coarse_scale(
    times: FloatArray,
    turns: FloatArray,
    turning: BoolArray,
    odometry_times: FloatArray,
    heading: FloatArray,
) -> float:
    """Return the factor from reported to true turns if it is far from 1, else 1.

    It does not depend on the clock's offset, nor on which way the odometry turns.
    """
    reported = np.diff(np.interp(times, odometry_times, heading))[turning]
    most = float(np.abs(reported).sum())
    scale = float(np.abs(turns[turning]).sum()) / most if most > 0.0 else 1.0
    is_far = not USUAL_SCALES[0] <= scale <= USUAL_SCALES[1]
    return scale if is_far and MIN_SCALE <= scale <= MAX_SCALE else 1.0


def _turn_scale(reported: FloatArray, true: FloatArray, coarse: float) -> float:
    """Return the factor from reported to true turns, found from a coarse one or from 1.

    Noise of matches adds to what the scans turn, and makes the coarse one too large.
    """
    scales = [_robust_scale(reported, true, start) for start in dict.fromkeys((1.0, coarse))]
    return min(scales, key=lambda scale: float(np.abs(true - scale * reported).sum()))


def _robust_scale(reported: FloatArray, true: FloatArray, scale: float) -> float:
    """Return the factor from reported to true motion, from the better half of the steps.

    Parameters
    ----------
    scale : the factor, coarsely.
    """
    for _ in range(SCALE_ROUNDS):
        error = np.abs(true - scale * reported)
        agreeing = error <= np.median(error)
        weight = float(np.sum(reported[agreeing] ** 2))
        if weight == 0.0:
            return 1.0
        scale = float(np.sum(true[agreeing] * reported[agreeing])) / weight
    return min(max(scale, MIN_SCALE), MAX_SCALE)


def _scale_yaw_and_lever(
    reported: FloatArray, true: FloatArray
) -> tuple[float, float, float, float]:
    """Return scale of the distance, yaw [rad] and lever arm (x, y) [m]: reweighted least squares.

    With s the scale, Y the rotation by the yaw, R that of a step and l the lever arm, the step is
    s Y t + (R - 1) l, linear in s cos(yaw), s sin(yaw) and l.
    """
    cos, sin = np.cos(true[:, 2]) - 1.0, np.sin(true[:, 2])
    rows_x = np.column_stack((reported[:, 0], -reported[:, 1], cos, -sin))
    rows_y = np.column_stack((reported[:, 1], reported[:, 0], sin, cos))
    prior = np.diag((SCALE_PRIOR, SCALE_PRIOR, LEVER_PRIOR, LEVER_PRIOR))
    solution = np.array((1.0, 0.0, 0.0, 0.0))
    path = np.hypot(reported[:, 0], reported[:, 1]).sum()
    for _ in range(LEVER_ROUNDS):
        error = np.hypot(rows_x @ solution - true[:, 0], rows_y @ solution - true[:, 1])
        typical = max(float(np.median(error)), MIN_TYPICAL_ERROR_M)
        weight = (1.0 + (error / typical) ** 2) ** -2
        if path < SHORT_M:
            prior[0, 0] = prior[1, 1] = max((typical / SCALE_SIGMA) ** 2, SCALE_PRIOR)
        normal = (rows_x.T * weight) @ rows_x + (rows_y.T * weight) @ rows_y + prior
        right = rows_x.T @ (weight * true[:, 0]) + rows_y.T @ (weight * true[:, 1])
        right[0] += prior[0, 0]
        solution = np.linalg.solve(normal, right)
    along, across, lever_x, lever_y = solution.tolist()
    scale = min(max(math.hypot(along, across), MIN_SCALE), MAX_SCALE)
    return scale, math.atan2(across, along), lever_x, lever_y
