# SPDX-License-Identifier: Apache-2.0
"""Where a robot may be after a gap in the recording, as where a recorder lost scans for seconds."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from cartoloop.sensor.pose import Pose

MIN_GAP_S, GAP_INTERVALS, MIN_SCANS = 1.0, 4.0, 10
"""A gap in the recording is longer than the first [s], and than this many of the latest intervals
between scans, of at least as many scans as the third."""

LEAST_ERROR_M, MAX_ERROR_M = 0.3, 1.5
"""Limits of the error of a pose that is predicted across a gap [m]."""

ODOMETRY_ERROR_SHARE, ODOMETRY_ERROR_RAD = 0.2, 0.1
"""The same by odometry: share of the distance, and of the heading [rad]."""

VELOCITY_ERROR, VELOCITY_ERROR_RAD = 0.6, 0.2
"""The same without odometry: of the velocity [m/s], as robots set off and stop, and of the heading
[rad]."""

TURN_SHARE, MAX_TURN_RAD = 0.2, math.pi
"""Error of the heading of a robot that turned when the gap began: share of the turn that it would
have made in the gap, and the largest such turn [rad]. It may have gone on or stopped, and what the
odometry reports right after a gap may be of before its end."""

TURN_RATE, ANY_HEADING_RAD = 1.5, math.pi / math.sqrt(3.0)
"""Rate at which a robot may turn whose motion nothing measures [rad/s], and the standard deviation
of an unknown heading [rad]."""

MAX_LOST_ERROR_M = 100.0
"""Largest error of the place of a robot that was lost [m], however long the recording paused."""


class Gap(NamedTuple):
    """Where the robot may be after a gap.

    Attributes
    ----------
    poses : the predicted one first, then what else buffered odometry may mean.
    linear_error, angular_error : of the predicted pose [m], [rad].
    turn_error : error of the heading for the search, as the robot may have turned on [rad].
    lost_linear_error, lost_angular_error : of the pose if the scan after the gap fits nowhere, so
        that it may have gone farther than was searched [m], [rad].
    """

    poses: tuple[Pose, ...]
    linear_error: float
    angular_error: float
    turn_error: float
    lost_linear_error: float
    lost_angular_error: float


def is_gap(duration: float, scan_times: Sequence[float]) -> bool:
    """Return whether a time without scans is a gap.

    Parameters
    ----------
    duration : since the last scan [s].
    scan_times : of the latest scans [s].
    """
    if duration <= MIN_GAP_S or len(scan_times) < MIN_SCANS:
        return False
    return duration > GAP_INTERVALS * float(np.median(np.diff(scan_times)))


def gap_by_odometry(poses: tuple[Pose, ...], moved: float, turn: float) -> Gap:
    """Return a gap across which the odometry has reported a motion by some distance [m].

    Parameters
    ----------
    turn : of a robot that turns in the gap as it did before [rad].
    """
    error = min(max(ODOMETRY_ERROR_SHARE * moved, LEAST_ERROR_M), MAX_ERROR_M)
    turn_error = max(ODOMETRY_ERROR_RAD, _turn_error(turn))
    return Gap(poses, error, ODOMETRY_ERROR_RAD, turn_error, error, ODOMETRY_ERROR_RAD)


def gap_without_odometry(
    poses: tuple[Pose, ...], duration: float, speed: float, turn: float, *, is_lost: bool
) -> Gap:
    """Return a gap of some duration [s] in which no trusted odometry measured the motion.

    Parameters
    ----------
    speed : of the robot when it began [m/s].
    turn : of a robot that turns in the gap as it did before [rad].
    is_lost : whether nothing else measured it either, such as doubtful odometry or a gyroscope.
    """
    error = min(VELOCITY_ERROR * duration, MAX_ERROR_M)
    turn = max(abs(turn), TURN_RATE * duration)
    turn_error = max(VELOCITY_ERROR_RAD, _turn_error(turn))
    lost_error, lost_turn = error, VELOCITY_ERROR_RAD
    if is_lost:
        lost_error = min(max(speed, VELOCITY_ERROR) * duration, MAX_LOST_ERROR_M)
        lost_turn = min(turn, ANY_HEADING_RAD)
    return Gap(poses, error, VELOCITY_ERROR_RAD, turn_error, lost_error, lost_turn)


def _turn_error(turn: float) -> float:
    return TURN_SHARE * min(abs(turn), MAX_TURN_RAD)
