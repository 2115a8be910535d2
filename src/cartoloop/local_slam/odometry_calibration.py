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
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from cartoloop.arrays import BoolArray, FloatArray
from cartoloop.local_slam.clock_offset import (
    FIRST_ESTIMATE,
    MIN_TURN_RAD,
    clock_offset,
    next_estimate,
)
from cartoloop.local_slam.matched_scans import ScanSeries, latest
from cartoloop.local_slam.odometry_track import OdometryTrack
from cartoloop.local_slam.odometry_veer import NO_VEER, Veer, estimate_veer
from cartoloop.sensor.pose import Pose, relative_all

WINDOW = 1500
"""Number of latest scans that are used: some minutes, so that a drifting clock is followed."""

VEER_WINDOW = 6000
"""The same for the veer, which does not change, and shows only after several headings."""

MIN_STEPS = 25
"""Number of turning steps needed for the clock offset, and of moving steps for the rest."""

MIN_MOVE_M = 0.02
"""Steps shorter than this and without a turn are not used [m]: the noise of a match."""

MIN_SCALE, MAX_SCALE = 0.7, 1.4
"""Limits of the scales; odometry beyond them is broken, not badly calibrated."""

SCALE_ROUNDS, LEVER_ROUNDS = 5, 8
"""Rounds of reweighting, after which the estimates change by less than their noise."""

SCALE_PRIOR, LEVER_PRIOR = 1e-3, 0.02
"""Weights of the priors of a scale of 1 and of a lever arm of zero, which without turns the
equations leave undetermined; a lever arm of half a metre is large."""

MIN_TYPICAL_ERROR_M = 1e-4
"""Lower limit of the typical error of a step [m], so that exact data do not divide by zero."""


@dataclass(frozen=True, slots=True)
class OdometryParameters:
    """The estimated errors of the odometry.

    Attributes
    ----------
    time_offset : a reading is this much newer than the scan of the same stamp [s].
    rotation_scale, translation_scale : true motion over reported motion.
    yaw : forward direction of the odometry in the tracking frame [rad].
    lever_x, lever_y : the tracking frame relative to the point whose motion is reported [m].
    rotation_error : median error of the rotation of a calibrated step [rad]; NaN before the robot
        has turned enough, because straight steps do not show it.
    num_turns : number of turning steps that it was estimated from.
    translation_error : the same of the distance [m]; NaN before the first estimate.
    veer : turn on each metre that is not reported.
    num_stretches : number of metres that it was estimated from.
    """

    time_offset: float = 0.0
    rotation_scale: float = 1.0
    translation_scale: float = 1.0
    yaw: float = 0.0
    lever_x: float = 0.0
    lever_y: float = 0.0
    rotation_error: float = math.nan
    translation_error: float = math.nan
    num_turns: int = 0
    veer: Veer = NO_VEER
    num_stretches: int = 0

    @property
    def is_known(self) -> bool:
        """Whether there was enough motion for an estimate."""
        return not math.isnan(self.translation_error)

    @property
    def knows_rotation(self) -> bool:
        """Whether the robot has turned enough for an estimate of clock offset and rotation."""
        return not math.isnan(self.rotation_error)

    @property
    def veer_by_name(self) -> dict[str, float]:
        """The veer, for documents [rad/m]: constant, cos, sin."""
        return self.veer._asdict()

    def summary(self) -> dict[str, Any]:
        """Return the estimates, for the report."""
        return {
            "time_offset_s": self.time_offset,
            "rotation_scale": self.rotation_scale,
            "translation_scale": self.translation_scale,
            "yaw_rad": self.yaw,
            "lever_m": [self.lever_x, self.lever_y],
            "veer_rad_per_m": self.veer_by_name,
            "rotation_error_rad": self.rotation_error if self.knows_rotation else None,
            "translation_error_m": self.translation_error if self.is_known else None,
        }

    def to_dict(self) -> dict[str, Any]:
        """Return all fields as values of JSON, None for what is not known."""
        values = {**asdict(self), "veer": list(self.veer)}
        return {
            name: None if isinstance(value, float) and math.isnan(value) else value
            for name, value in values.items()
        }

    @classmethod
    def from_dict(cls, content: Mapping[str, Any]) -> OdometryParameters:
        """Return what :meth:`to_dict` made values of JSON of; what is missing is not known.

        Raises
        ------
        ValueError, TypeError, AttributeError
            They are of something else.
        """
        values: dict[str, Any] = {
            name: math.nan if value is None else float(value)
            for name, value in content.items()
            if name not in ("veer", "num_turns", "num_stretches")
        }
        for name in ("num_turns", "num_stretches"):
            values[name] = int(content.get(name, 0))
        constant, cos, sin = content.get("veer", NO_VEER)
        return cls(**values, veer=Veer(float(constant), float(cos), float(sin)))

    def predict(self, reported: Pose, heading: float = 0.0) -> Pose:
        """Return the motion of the tracking frame for a motion that the odometry reports.

        Parameters
        ----------
        reported : the motion.
        heading : of the odometry at its begin [rad].
        """
        reported = self.veer.corrected(reported, heading)
        theta = self.rotation_scale * reported.theta
        cos, sin = math.cos(theta) - 1.0, math.sin(theta)
        along = self.translation_scale * math.cos(self.yaw)
        across = self.translation_scale * math.sin(self.yaw)
        return Pose(
            along * reported.x - across * reported.y + cos * self.lever_x - sin * self.lever_y,
            across * reported.x + along * reported.y + sin * self.lever_x + cos * self.lever_y,
            theta,
        )

    def predict_all(self, reported: FloatArray, headings: FloatArray) -> FloatArray:
        """Return :meth:`predict` of each row, shape (n, 3), equal to the last bit."""
        return self.without_veer_all(self.veer.corrected_all(reported, headings))

    def without_veer_all(self, reported: FloatArray) -> FloatArray:
        """Return the same of reported motions that are corrected for veer, shape (n, 3)."""
        theta = self.rotation_scale * reported[:, 2]
        # numpy's sine and cosine differ from the C library's in the last digit.
        cos = np.array([math.cos(angle) for angle in theta.tolist()]) - 1.0
        sin = np.array([math.sin(angle) for angle in theta.tolist()])
        along = self.translation_scale * math.cos(self.yaw)
        across = self.translation_scale * math.sin(self.yaw)
        x, y = reported[:, 0], reported[:, 1]
        return np.column_stack(
            (
                along * x - across * y + cos * self.lever_x - sin * self.lever_y,
                across * x + along * y + sin * self.lever_x + cos * self.lever_y,
                theta,
            )
        )


class OdometryCalibration:
    """Collects matched scan poses and estimates the :class:`OdometryParameters` from them.

    Parameters
    ----------
    model : what is known before; by default nothing.
    window : number of latest scans that are used, but for the veer.
    first : number of scans before the first estimate.
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
        self._num_scans = 0

    def shift(self, scanner: str, by: float) -> None:
        """Correct the times of a scanner's scans so far, since its clock offset changes [s]."""
        series = self._series.get(scanner)
        if series is not None:
            series.times = [time + by for time in series.times]

    def add(
        self,
        time: float,
        tf_local_tracking: Pose,
        track: OdometryTrack,
        num_faulty: int = 0,
        scanner: str = "",
    ) -> None:
        """Add a scan's pose as matched; from time to time, estimate again.

        `num_faulty` of the latest steps of this scanner, up to this scan, are not used. Steps are
        taken between scans of one scanner, since the clocks of scanners differ.
        """
        self._num_scans += 1
        series = self._series.setdefault(scanner, ScanSeries())
        series.times.append(time)
        series.poses.append(tf_local_tracking)
        series.is_usable.append(bool(series.is_usable))
        if num_faulty:
            series.is_usable[-num_faulty:] = [False] * min(num_faulty, len(series.is_usable))
        if self._num_scans >= self._due:
            self._due = next_estimate(self._num_scans)
            every = list(self._series.values())
            for one in every:
                one.cut(max(self._window, VEER_WINDOW))
            odometry, before = track.arrays(), self.model
            veer, num_stretches = estimate_veer(
                latest(every, VEER_WINDOW), *odometry, before.time_offset, before.veer
            )
            known = replace(before, veer=veer, num_stretches=num_stretches)
            scans = latest(every, self._window)
            self.model = estimate(scans.times, scans.poses, *odometry, known, scans.is_usable)


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
    odometry_times, odometry_poses : float64, shapes (k,), (k, 3), times increasing.
    previous : the model so far. Its veer is taken to be known.
    is_usable : shape (n,), whether the step to each scan is used; by default all are.
    """
    if len(odometry_times) < 2:
        return previous
    steps = relative_all(poses[:-1], poses[1:])
    heading = np.unwrap(odometry_poses[:, 2])
    span = (times >= odometry_times[0]) & (times <= odometry_times[-1])
    known = span[:-1] & span[1:]
    if is_usable is not None:
        known &= is_usable[1:]
    turning = (np.abs(steps[:, 2]) > MIN_TURN_RAD) & known
    offset, rotation_scale = previous.time_offset, previous.rotation_scale
    turns_enough = np.count_nonzero(turning) >= MIN_STEPS
    if turns_enough:
        found = clock_offset(
            times, steps[:, 2], turning, odometry_times, heading, previous=previous.time_offset
        )
        if found is None:
            return previous
        offset = found
    columns = (odometry_poses[:, 0], odometry_poses[:, 1], heading)
    at_scans = np.column_stack([np.interp(times - offset, odometry_times, c) for c in columns])
    reported = relative_all(at_scans[:-1], at_scans[1:])
    reported = previous.veer.corrected_all(reported, at_scans[:-1, 2])
    if turns_enough:
        rotation_scale = _robust_scale(reported[turning, 2], steps[turning, 2])
    moving = known & (turning | (np.hypot(reported[:, 0], reported[:, 1]) > MIN_MOVE_M))
    if np.count_nonzero(moving) < MIN_STEPS:
        return previous
    model = OdometryParameters(
        offset, rotation_scale, *_scale_yaw_and_lever(reported[moving], steps[moving])
    )
    errors = np.abs(model.without_veer_all(reported[moving]) - steps[moving])
    knows_rotation = turns_enough or previous.knows_rotation
    return replace(
        model,
        veer=previous.veer,
        num_stretches=previous.num_stretches,
        num_turns=int(np.count_nonzero(turning)),
        rotation_error=float(np.median(errors[:, 2])) if knows_rotation else math.nan,
        translation_error=float(np.median(np.hypot(errors[:, 0], errors[:, 1]))),
    )


def _robust_scale(reported: FloatArray, true: FloatArray) -> float:
    """Return the factor from reported to true motion, from the better half of the steps."""
    scale = 1.0
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
    for _ in range(LEVER_ROUNDS):
        error = np.hypot(rows_x @ solution - true[:, 0], rows_y @ solution - true[:, 1])
        typical = max(float(np.median(error)), MIN_TYPICAL_ERROR_M)
        weight = (1.0 + (error / typical) ** 2) ** -2
        normal = (rows_x.T * weight) @ rows_x + (rows_y.T * weight) @ rows_y + prior
        right = rows_x.T @ (weight * true[:, 0]) + rows_y.T @ (weight * true[:, 1])
        right[0] += prior[0, 0]
        solution = np.linalg.solve(normal, right)
    along, across, lever_x, lever_y = solution.tolist()
    scale = min(max(math.hypot(along, across), MIN_SCALE), MAX_SCALE)
    return scale, math.atan2(across, along), lever_x, lever_y
