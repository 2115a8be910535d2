# SPDX-License-Identifier: Apache-2.0
"""Where a robot may be after a gap in the recording, as where a recorder lost scans for seconds."""

from __future__ import annotations

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


class Gap(NamedTuple):
    """Where the robot may be after a gap.

    Attributes
    ----------
    poses : the predicted one first, then what else buffered odometry may mean.
    linear_error, angular_error : of the predicted pose [m], [rad].
    """

    poses: tuple[Pose, ...]
    linear_error: float
    angular_error: float


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


def gap_by_odometry(poses: tuple[Pose, ...], moved: float) -> Gap:
    """Return a gap across which the odometry has reported a motion by some distance [m]."""
    error = min(max(ODOMETRY_ERROR_SHARE * moved, LEAST_ERROR_M), MAX_ERROR_M)
    return Gap(poses, error, ODOMETRY_ERROR_RAD)


def gap_without_odometry(poses: tuple[Pose, ...], duration: float) -> Gap:
    """Return a gap of some duration [s] in which nothing measured the motion."""
    return Gap(poses, min(VELOCITY_ERROR * duration, MAX_ERROR_M), VELOCITY_ERROR_RAD)
