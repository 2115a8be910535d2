# SPDX-License-Identifier: Apache-2.0
"""The latest metres of a robot's path, with what its scans showed, in bounded memory."""

from __future__ import annotations

import math
from collections import deque
from typing import NamedTuple

import numpy as np

from cartoloop.arrays import FloatArray
from cartoloop.config import AdaptiveVoxelFilterConfig
from cartoloop.sensor.pose import Pose, relative, transform_points, wrap_angle
from cartoloop.sensor.range_filter import thin
from cartoloop.sensor.scan_points import ScanPoints

MIN_STEP_M, MIN_TURN_RAD = 0.25, math.radians(15.0)
"""A scan is kept if the robot has moved by the first, or turned by the second, since the last."""

LENGTH_M = 10.0
"""Path length that is kept [m]: local SLAM drifts by less than a cell or two on it."""

MAX_SCANS = 60
"""Scans that are kept: a robot may turn on the spot for hours."""

SCAN_FILTER = AdaptiveVoxelFilterConfig(max_length=0.9, min_num_points=100, max_range=30.0)
"""Of the returns of a scan that is searched."""

COMPOSITE_FILTER = AdaptiveVoxelFilterConfig(max_length=0.9, min_num_points=200, max_range=30.0)
"""Of the returns of several scans that are searched as one."""


class TrailScan(NamedTuple):
    """A scan of the path.

    Attributes
    ----------
    tf_local_tracking : its pose, which drifts.
    points : float64, shape (n, 2), its returns [m], tracking frame.
    beam_origin : pose of the scanner on the robot.
    travelled : path length of the robot so far [m].
    """

    tf_local_tracking: Pose
    points: FloatArray
    beam_origin: Pose
    travelled: float


class Composite(NamedTuple):
    """Several scans as one, in the frame of the robot at the newest.

    Attributes
    ----------
    points : float64, shape (n, 2) [m].
    scans : the returns of each, in its own frame.
    tf_newest_scans : float64, shape (k, 3), poses of the scans.
    beam_origins : float64, shape (k, 2), where their beams start, own frames [m].
    """

    points: FloatArray
    scans: ScanPoints
    tf_newest_scans: FloatArray
    beam_origins: FloatArray


class Trail:
    """Scans along the latest metres of the path.

    Attributes
    ----------
    travelled : path length of the robot so far [m].
    turned : sum of its turns so far [rad].
    """

    def __init__(self) -> None:
        self._scans: deque[TrailScan] = deque(maxlen=MAX_SCANS)
        self._last: Pose | None = None
        self._newest: TrailScan | None = None
        self.travelled = 0.0
        self.turned = 0.0

    @property
    def length(self) -> float:
        """Path length from the oldest scan that is kept to the newest [m]."""
        return self.travelled - self._scans[0].travelled if self._scans else 0.0

    def clear(self) -> None:
        """Forget all scans."""
        self._scans.clear()
        self._last = self._newest = None

    def add(self, tf_local_tracking: Pose, points: FloatArray, beam_origin: Pose) -> None:
        """Add the next scan, whose returns are thinned."""
        if self._last is not None:
            step = relative(self._last, tf_local_tracking)
            self.travelled += math.hypot(step.x, step.y)
            self.turned += abs(step.theta)
        self._last = tf_local_tracking
        scan = TrailScan(tf_local_tracking, points, beam_origin, self.travelled)
        self._newest = scan
        if not self._scans or self._is_new(scan):
            self._scans.append(scan)
        while self._scans[0].travelled < self.travelled - LENGTH_M:
            self._scans.popleft()

    def composite(self, length: float) -> Composite | None:
        """Return the scans of the latest metres as one; None without any returns.

        Parameters
        ----------
        length : of the path that they come from [m]; 0: the newest scan alone.
        """
        newest = self._newest
        if newest is None:
            return None
        first = newest.travelled - length
        kept = [scan for scan in self._scans if scan.travelled >= first and scan is not newest]
        scans = [newest, *reversed(kept)] if length > 0.0 else [newest]
        steps = [relative(newest.tf_local_tracking, scan.tf_local_tracking) for scan in scans]
        parts = [transform_points(step, s.points) for step, s in zip(steps, scans, strict=True)]
        points = np.concatenate(parts)
        if len(points) == 0:
            return None
        return Composite(
            parts[0] if len(parts) == 1 else thin(points, COMPOSITE_FILTER),
            ScanPoints.of([scan.points for scan in scans]),
            np.array(steps),
            np.array([scan.beam_origin[:2] for scan in scans]),
        )

    def _is_new(self, scan: TrailScan) -> bool:
        step = relative(self._scans[-1].tf_local_tracking, scan.tf_local_tracking)
        return (
            math.hypot(step.x, step.y) >= MIN_STEP_M or abs(wrap_angle(step.theta)) >= MIN_TURN_RAD
        )
