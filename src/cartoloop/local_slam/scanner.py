# SPDX-License-Identifier: Apache-2.0
"""What local SLAM remembers of each scanner."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field
from functools import partial
from typing import Self

import numpy as np

from cartoloop.arrays import FloatArray
from cartoloop.config import LocalSlamConfig
from cartoloop.kernels.order_statistics import distance_quantile
from cartoloop.local_slam.degenerate_direction import degenerate_direction, is_determined
from cartoloop.local_slam.measured_distance import DistanceMeter
from cartoloop.local_slam.motion_filter import MotionFilter
from cartoloop.local_slam.moving_gain import (
    ALL_BY_REST,
    Explained,
    SeenScan,
    explained,
    have_changed,
)
from cartoloop.local_slam.odometry_window import Evidence
from cartoloop.local_slam.scan_matcher import ScanMatcher
from cartoloop.local_slam.wall_step import WallStep
from cartoloop.scan_matching.least_squares import LeastSquaresMatch
from cartoloop.sensor.events import LaserScan, PointCloud
from cartoloop.sensor.range_noise import NO_NOISE, Noise
from cartoloop.sensor.wall_normals import normal_ratio

MAX_RECENT = 64
"""Number of scans of a scanner that are kept for a comparison: more than a second of them."""


@dataclass(slots=True)
class Scanner:
    """One scanner of the robot.

    Attributes
    ----------
    matcher : holds the typical residual of its scans.
    motion_filter : one for each scanner, so that each contributes to the map.
    wall_step : compares its scans with each other where nothing else measures the motion.
    distance_meter : measures the distance between scans about a metre apart.
    num_scans : number of its scans.
    is_in_map : whether one of its scans was inserted.
    noise : of its ranges, if they are noisy.
    recent : its latest scans.
    """

    matcher: ScanMatcher
    motion_filter: MotionFilter
    wall_step: WallStep
    distance_meter: DistanceMeter = field(default_factory=DistanceMeter)
    num_scans: int = 0
    is_in_map: bool = False
    noise: Noise = NO_NOISE
    recent: deque[SeenScan] = field(default_factory=lambda: deque(maxlen=MAX_RECENT))

    def noise_of(self, returns: FloatArray, share: float) -> float:
        """Return the noise at a quantile of the ranges of returns, shape (n, 2) [m]; 0 if small."""
        if self.noise == NO_NOISE or not len(returns):
            return 0.0
        typical = distance_quantile(returns, share)
        return math.hypot(self.noise.constant, self.noise.share * typical)

    def change_since(self, time: float) -> float:
        """Return the median change of the ranges since a time [m]; inf if it is not known."""
        before, now = self._ranges_since(time)
        return float(np.median(np.abs(now - before))) if before.size else math.inf

    def changed_share_since(self, time: float) -> float:
        """Return the share of the ranges that have changed since a time; 0 if it is not known."""
        first = self._first_since(time)
        if first is None or not first.differs(self.recent[-1], self.noise):
            return 0.0
        before, now = self._ranges_since(time)
        if not before.size:
            return 0.0
        return int(np.count_nonzero(have_changed(before, now, self.noise))) / before.size

    def explained_since(self, time: float, velocity: tuple[float, float]) -> Explained:
        """Return how much of the scan rest and motion since a time explain; all if not known.

        Parameters
        ----------
        velocity : that is expected of the robot, along x and y of the tracking frame [m/s].
        """
        first = self._first_since(time)
        if first is None:
            return ALL_BY_REST
        return explained(first, self.recent[-1], self.noise, velocity)

    def evidence(
        self, match: LeastSquaresMatch, theta: float, points: FloatArray, spurious: float
    ) -> Evidence:
        """Return what the match of the latest scan says about the motion.

        Parameters
        ----------
        match : to a submap.
        theta : heading of that submap, local frame [rad].
        points : as matched, shape (n, 2) [m], tracking frame.
        spurious : share of the curvature that pixel noise alone makes.
        """
        ratio, direction = degenerate_direction(match)
        return Evidence(
            is_determined(ratio, spurious),
            direction + theta,
            self.change_since,
            partial(normal_ratio, points, math.inf),
            self.changed_share_since,
            self.explained_since,
        )

    def evidence_by_walls(self) -> Evidence:
        """Return what a match says where the scan before has shown the step along bare walls."""
        return Evidence(
            True,
            0.0,
            self.change_since,
            lambda: math.inf,
            self.changed_share_since,
            self.explained_since,
        )

    def _first_since(self, time: float) -> SeenScan | None:
        """Return the first scan since a time, None if it is the last one or has other beams."""
        first = next((seen for seen in self.recent if seen.scan.time >= time), None)
        if first is None or first is self.recent[-1]:
            return None
        return first if len(first.scan.ranges) == len(self.recent[-1].scan.ranges) else None

    def _ranges_since(self, time: float) -> tuple[FloatArray, FloatArray]:
        """Return ranges of the same beams in the first scan since a time and now, shapes (n,)."""
        first = self._first_since(time)
        if first is None:
            return np.empty(0), np.empty(0)
        last = self.recent[-1]
        is_both = first.is_comparable & last.is_comparable
        return first.scan.ranges[is_both], last.scan.ranges[is_both]

    @classmethod
    def of(cls, config: LocalSlamConfig) -> Self:
        """Return a scanner that has sent nothing yet."""
        return cls(
            ScanMatcher(config), MotionFilter(config.motion_filter), WallStep(config.wall_step)
        )

    def count(self, scan: LaserScan | PointCloud) -> None:
        """Count a scan, and keep it for comparisons."""
        self.num_scans += 1
        if isinstance(scan, LaserScan):
            self.recent.append(SeenScan(scan))
