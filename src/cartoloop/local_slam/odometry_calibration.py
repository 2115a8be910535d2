# SPDX-License-Identifier: Apache-2.0
"""How the odometry relates to the scans: offset of its clock, scale of its rotation and distance.

Odometry stored with a scan is often newer than the scan (0.14 to 0.64 s in the Radish logs) and
its rotation off by 5 to 20%. Scanners look askew by up to a degree, so that each prediction lies to
the side of the truth; matches that heed it a little bend long corridors. All this shows when the
motion between scans as matched is laid against the motion that the odometry reports, and is
estimated again and again while mapping.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from cartoloop.local_slam.clock_offset import MIN_TURN_RAD, clock_offset
from cartoloop.local_slam.odometry_track import OdometryTrack
from cartoloop.sensor.pose import FloatArray, Pose, relative_all

MIN_STEPS = 25
"""How many turning steps tell the clock offset, how many steps in motion the rest."""

MIN_MOVE_M = 0.02
"""Steps shorter than this, and without a turn, tell nothing of the distance's scale."""

MIN_SCALE, MAX_SCALE = 0.7, 1.4
"""Odometry that is further off is broken, not ill calibrated."""


@dataclass(frozen=True, slots=True)
class OdometryModel:
    """What the odometry is worth.

    Attributes
    ----------
    time_offset : odometry of a stamp shows the robot this much later than the scan of it [s].
    rotation_scale, translation_scale : true motion over reported motion.
    yaw : the direction that odometry calls forward, as seen from the tracking frame [rad].
    lever_x, lever_y : the tracking frame as seen from the point whose motion is reported [m].
    rotation_error, translation_error : median error of a step after all that [rad], [m]; NaN
        before anything is known.
    """

    time_offset: float = 0.0
    rotation_scale: float = 1.0
    translation_scale: float = 1.0
    yaw: float = 0.0
    lever_x: float = 0.0
    lever_y: float = 0.0
    rotation_error: float = math.nan
    translation_error: float = math.nan

    @property
    def is_known(self) -> bool:
        """Whether there was enough motion to tell."""
        return not math.isnan(self.rotation_error)

    def predict(self, reported: Pose) -> Pose:
        """Return the motion of the tracking frame for a motion that the odometry reports."""
        theta = self.rotation_scale * reported.theta
        cos, sin = math.cos(theta) - 1.0, math.sin(theta)
        along = self.translation_scale * math.cos(self.yaw)
        across = self.translation_scale * math.sin(self.yaw)
        return Pose(
            along * reported.x - across * reported.y + cos * self.lever_x - sin * self.lever_y,
            across * reported.x + along * reported.y + sin * self.lever_x + cos * self.lever_y,
            theta,
        )

    def predict_all(self, reported: FloatArray) -> FloatArray:
        """Return what :meth:`predict` does for each row, shape (n, 3), equal to the last bit."""
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
    """Collects matched scan poses and estimates the :class:`OdometryModel` from them."""

    def __init__(self, window: int = 1500, first: int = 50) -> None:
        self.model = OdometryModel()
        self._window = window
        self._due = first
        self._times: list[float] = []
        self._poses: list[Pose] = []

    def add(self, time: float, tf_local_tracking: Pose, track: OdometryTrack) -> None:
        """Add a scan's pose as matched; now and then, estimate anew."""
        self._times.append(time)
        self._poses.append(tf_local_tracking)
        if len(self._times) >= self._due:
            self._due = len(self._times) + max(50, min(len(self._times) // 4, 500))
            self.model = estimate(
                np.array(self._times[-self._window :]),
                np.array(self._poses[-self._window :]),
                *track.arrays(),
                self.model,
            )


def estimate(
    times: FloatArray,
    poses: FloatArray,
    odometry_times: FloatArray,
    odometry_poses: FloatArray,
    previous: OdometryModel,
) -> OdometryModel:
    """Return the model that explains the motion between scans best; `previous` if too little moves.

    Parameters
    ----------
    times, poses : float64, shapes (n,), (n, 3): scans as matched.
    odometry_times, odometry_poses : float64, shapes (k,), (k, 3), times increasing.
    """
    if len(odometry_times) < 2:
        return previous
    steps = relative_all(poses[:-1], poses[1:])
    heading = np.unwrap(odometry_poses[:, 2])
    span = (times >= odometry_times[0]) & (times <= odometry_times[-1])
    known = span[:-1] & span[1:]
    turning = (np.abs(steps[:, 2]) > MIN_TURN_RAD) & known
    offset, rotation_scale = previous.time_offset, previous.rotation_scale
    turns_enough = np.count_nonzero(turning) >= MIN_STEPS
    if turns_enough:
        found = clock_offset(times, steps[:, 2], turning, odometry_times, heading)
        if found is None:
            return previous
        offset = found
    columns = (odometry_poses[:, 0], odometry_poses[:, 1], heading)
    at_scans = np.column_stack([np.interp(times - offset, odometry_times, c) for c in columns])
    reported = relative_all(at_scans[:-1], at_scans[1:])
    if turns_enough:
        rotation_scale = _robust_scale(reported[turning, 2], steps[turning, 2])
    moving = known & (turning | (np.hypot(reported[:, 0], reported[:, 1]) > MIN_MOVE_M))
    if np.count_nonzero(moving) < MIN_STEPS:
        return previous
    model = OdometryModel(
        offset, rotation_scale, *_scale_yaw_and_lever(reported[moving], steps[moving])
    )
    errors = np.abs(model.predict_all(reported[moving]) - steps[moving])
    return replace(
        model,
        rotation_error=float(np.median(errors[:, 2])),
        translation_error=float(np.median(np.hypot(errors[:, 0], errors[:, 1]))),
    )


def _robust_scale(reported: FloatArray, true: FloatArray) -> float:
    """Return the factor from reported to true motion, by the half of the steps that agree best."""
    scale = 1.0
    for _ in range(5):
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
    """Return scale of the distance, yaw [rad], lever arm (x, y) [m], by reweighted least squares.

    With s the scale, Y the rotation by the yaw, R that of a step and l the lever arm, the step is
    s Y t + (R - 1) l, linear in s cos(yaw), s sin(yaw) and l.
    """
    cos, sin = np.cos(true[:, 2]) - 1.0, np.sin(true[:, 2])
    rows_x = np.column_stack((reported[:, 0], -reported[:, 1], cos, -sin))
    rows_y = np.column_stack((reported[:, 1], reported[:, 0], sin, cos))
    # A lever arm of half a metre is a lot: without turns, the equations alone leave it open.
    held = np.diag((1e-3, 1e-3, 0.02, 0.02))
    solution = np.array((1.0, 0.0, 0.0, 0.0))
    for _ in range(8):
        error = np.hypot(rows_x @ solution - true[:, 0], rows_y @ solution - true[:, 1])
        typical = max(float(np.median(error)), 1e-4)
        weight = (1.0 + (error / typical) ** 2) ** -2
        normal = (rows_x.T * weight) @ rows_x + (rows_y.T * weight) @ rows_y + held
        right = rows_x.T @ (weight * true[:, 0]) + rows_y.T @ (weight * true[:, 1])
        right[0] += held[0, 0]
        solution = np.linalg.solve(normal, right)
    along, across, lever_x, lever_y = solution.tolist()
    scale = min(max(math.hypot(along, across), MIN_SCALE), MAX_SCALE)
    return scale, math.atan2(across, along), lever_x, lever_y
