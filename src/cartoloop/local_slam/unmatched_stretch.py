# SPDX-License-Identifier: Apache-2.0
"""Stretches of the path over which no scan was matched, as in a hall larger than the range.

What was seen before and after one is related by the odometry alone. In one submap it would be
rigid, whatever the odometry is wrong by, and no loop closure could correct it.
"""

from __future__ import annotations

import math

import numpy as np

from cartoloop.arrays import FloatArray
from cartoloop.local_slam.gap import Gap
from cartoloop.local_slam.odometry_parameters import OdometryParameters
from cartoloop.sensor.pose import Pose
from cartoloop.submaps.node import LOST_ROTATION_INFORMATION

MIN_STRETCH_M = 5.0
"""Shorter stretches do not end a submap [m]: the odometry is right to centimetres there."""

MAX_STRETCH_M = 1000.0
"""Longer ones are no path of a robot: the odometry jumped [m]."""

MIN_ROTATION_SIGMA = 0.002
"""Least error of the heading after a stretch [rad]: odometry that stands still errs by nothing."""

LEAST_INFORMATION = 4.0 * LOST_ROTATION_INFORMATION
"""Information of the heading after any stretch [1/rad^2]: a robot with odometry is not lost."""

SCALE_ERROR = 0.01
"""Error of the distance that calibrated odometry reports, as a share of it."""


class UnmatchedStretch:
    """The path since the last node that was matched."""

    def __init__(self) -> None:
        self._last: Pose | None = None
        self._length = 0.0
        self._num_scans = 0
        self._gap: Gap | None = None

    def add(self, tf_local_tracking: Pose) -> None:
        """Add a scan."""
        if self._last is not None:
            x, y, _ = self._last
            self._length += math.hypot(tf_local_tracking.x - x, tf_local_tracking.y - y)
            self._num_scans += 1
        self._last = tf_local_tracking

    def clear(self) -> None:
        """Note that the latest scan was matched."""
        self._length, self._num_scans = 0.0, 0

    def add_gap(self, gap: Gap) -> None:
        """Note a gap before the latest scan, which fits badly: it ends any stretch."""
        self._gap = gap

    def end(self, model: OdometryParameters, information: FloatArray) -> FloatArray | None:
        """End it at a scan that becomes a node; return the node's information after a long one.

        None if it was not long, and there was no gap.

        Parameters
        ----------
        model : of the odometry, on which the scan's pose rests.
        information : of the pose as matched, shape (3, 3): that after it where nothing is known of
            the odometry's errors.
        """
        length, num_scans, gap = self._length, self._num_scans, self._gap
        self.clear()
        self._gap = None
        if gap is not None:
            linear, angular = gap.lost_linear_error, gap.lost_angular_error
            return np.diag((linear**-2.0, linear**-2.0, angular**-2.0))
        if not MIN_STRETCH_M <= length <= MAX_STRETCH_M:
            return None
        if not (model.is_known and model.knows_rotation):
            return information
        # Errors of the steps add up at random. Those of the heading displace what comes after them.
        rotation = num_scans * model.rotation_error**2 + MIN_ROTATION_SIGMA**2
        translation = (
            num_scans * model.translation_error**2
            + (SCALE_ERROR * length) ** 2
            + rotation * length**2 / 3.0
        )
        turn = max(1.0 / rotation, LEAST_INFORMATION)
        return np.diag((1.0 / translation, 1.0 / translation, turn))
