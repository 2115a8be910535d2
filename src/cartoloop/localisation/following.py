# SPDX-License-Identifier: Apache-2.0
"""Following a robot from a place that is claimed, for as long as its scans agree with the map."""

from __future__ import annotations

import math

import numpy as np

from cartoloop.arrays import FloatArray
from cartoloop.config import LocalSlamConfig
from cartoloop.localisation.decision import MIN_POINTS, Claim
from cartoloop.localisation.doubt import Doubt
from cartoloop.localisation.known_map import KnownMap
from cartoloop.localisation.local_motion import LocalScan
from cartoloop.localisation.tracking import MAP_SIGMA_M, MAP_SIGMA_RAD, Tracker
from cartoloop.sensor.pose import IDENTITY, Pose, compose, relative

CLAIMED_SHARE = 0.95
"""Share of the agreement at a claim that is expected from then on, if that was low."""

FIRST_SIGMA_M, FIRST_SIGMA_RAD = 2.0 * MAP_SIGMA_M, 3.0 * MAP_SIGMA_RAD
"""Standard deviations of a claimed pose [m], [rad]."""


class Following:
    """The tracked pose, and how far it is believed.

    Parameters
    ----------
    known : the map.
    config : of local SLAM, whose matcher is used.
    claim : the claimed pose, of the scan that is followed first.
    is_given : whether a user gave the pose.

    Attributes
    ----------
    doubt : that the pose is right.
    shown : the pose where a scan has last shown it, tf_map_tracking.
    """

    def __init__(
        self,
        known: KnownMap,
        config: LocalSlamConfig,
        claim: Claim,
        *,
        is_given: bool,
    ) -> None:
        variances = np.square((FIRST_SIGMA_M, FIRST_SIGMA_M, FIRST_SIGMA_RAD))
        self._known = known
        self._tracker = Tracker(known, config, claim.tf_map_tracking, np.diag(variances))
        self._last: LocalScan | None = None
        self.shown = claim.tf_map_tracking
        self._agreement = math.nan
        low = known.low_agreement
        if not math.isnan(claim.agreement):
            low = min(low, CLAIMED_SHARE * claim.agreement)
        self.doubt = Doubt(low / known.usual.agreement, is_given=is_given)

    @property
    def pose(self) -> Pose:
        """The pose, tf_map_tracking."""
        return self._tracker.pose

    @property
    def covariance(self) -> FloatArray:
        """Its covariance, map frame; no pose is better than the map."""
        floor = np.diag((MAP_SIGMA_M**2, MAP_SIGMA_M**2, MAP_SIGMA_RAD**2))
        return self._tracker.covariance + 0.25 * floor

    def begin(self, scan: LocalScan) -> None:
        """Note the scan whose pose was claimed."""
        self._last = scan

    def predicted(self, scan: LocalScan) -> Pose:
        """Return the pose at the next scan by local SLAM alone."""
        if self._last is None:
            return self.pose
        step = relative(self._last.tf_local_tracking, scan.tf_local_tracking)
        return compose(self.pose, step)

    def add(self, scan: LocalScan) -> None:
        """Move and correct the pose by the next scan."""
        step, duration = IDENTITY, 0.0
        if self._last is not None:
            step = relative(self._last.tf_local_tracking, scan.tf_local_tracking)
            duration = scan.time - self._last.time
        self._last = scan
        if scan.unseen is None:
            self._tracker.move(step, max(duration, 0.0), has_odometry=scan.has_odometry)
        else:
            self._tracker.move_unseen(step, scan.unseen)
        self._agreement = math.nan
        if len(scan.points) < MIN_POINTS:
            return
        self._agreement = self._tracker.correct(scan.points, scan.beam_origin)
        self.shown = self.pose
        usual = self._known.usual.agreement
        standing = self._agreement / usual
        if not self.doubt.is_proved and scan.moving.any():
            fit = self._known.fit(scan.points[~scan.moving], scan.beam_origin, self.pose)
            standing = fit.agreement / usual
        length = math.hypot(step.x, step.y)
        self.doubt.add(self._agreement / usual, length, duration, standing)

    def fit(self, scan: LocalScan) -> tuple[float, float]:
        """Return score and agreement of the last scan; the agreement is that of the correction."""
        if math.isnan(self._agreement):
            fit = self._known.fit(scan.points, scan.beam_origin, self.pose)
            return fit.score, fit.agreement
        return self._known.score(scan.points, self.pose), self._agreement
