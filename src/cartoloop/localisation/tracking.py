# SPDX-License-Identifier: Apache-2.0
"""Tracking in a map that does not change: local SLAM predicts, the map corrects.

A Kalman filter on the pose in the map. Local SLAM carries it where the map ends or has changed, and
knows the motion from scan to scan far better than odometry; the match of a scan to the map is the
measurement.
"""

from __future__ import annotations

import math

import numpy as np

from cartoloop.arrays import FloatArray
from cartoloop.config import LocalSlamConfig
from cartoloop.local_slam.degenerate_direction import degenerate_direction, is_determined
from cartoloop.local_slam.prediction import isotropic_information
from cartoloop.localisation.fit import Fit
from cartoloop.localisation.global_search import find_near
from cartoloop.localisation.known_map import KnownMap
from cartoloop.localisation.trail import SCAN_FILTER
from cartoloop.localisation.unseen_motion import MotionError, unseen_error
from cartoloop.scan_matching import least_squares
from cartoloop.scan_matching.least_squares import MatchOptions, match_information
from cartoloop.sensor.pose import Pose, compose, relative, wrap_angle
from cartoloop.sensor.range_filter import thin

DRIFT_M, DRIFT_RAD = 0.01, math.radians(0.15)
"""Standard deviation of the motion by local SLAM after a metre of path [m], [rad]; it grows with
the root of the length."""

TURN_DRIFT_RAD = math.radians(0.15)
"""The same after a turn of one radian [rad]."""

MAP_SIGMA_M, MAP_SIGMA_RAD = 0.03, math.radians(0.3)
"""Standard deviations by which a match is wrong at least [m], [rad]: walls of the map are not
straighter than this, and matches at the same wall are wrong together."""

PRIOR_SIGMA_M, PRIOR_SIGMA_RAD = 0.1, math.radians(2.0)
"""Standard deviations of the prior that a match starts from at least [m], [rad]."""

UNKNOWN_SIGMA_M = 30.0
"""Standard deviation of a match along a corridor without any feature [m]: it is where the
prediction was, and says nothing. With one metre, the many scans of some seconds would agree to
centimetres."""

MAX_PRIOR_SIGMA_M = 0.5
"""Standard deviation of the prior that a match starts from at most [m]: it searches nearby only."""

MAX_CORRECTION_SIGMAS = 5.0
"""Matches farther from the prediction than this are not used."""

FULL_TRUST_AGREEMENT = 0.75
"""Of matches that agree less, relative to the usual agreement, the variance grows with the square
of what is missing."""

MIN_AGREEMENT = 0.35
"""Matches that agree less, relative to the usual agreement, are not used."""

DROP, MEAN_SHARE = 0.1, 0.05
"""If a scan agrees less than the latest did on average by the first, relative to the usual
agreement, the pose is searched nearby: local SLAM may have slipped, as where odometry stops for a
second. The second is what a scan counts in the mean."""

NEARBY_M, NEARBY_RAD = 0.75, math.radians(10.0)
"""Window of that search, to each side [m], [rad]. It is two standard deviations of the pose where
that is more, as after a stretch without anything seen."""

MAX_NEARBY_M, MAX_NEARBY_RAD = 3.0, math.radians(45.0)
"""The largest such window [m], [rad]."""

REFUTED_AGREEMENT = 0.75
"""Agreement, relative to the usual one, below which the scan refutes the pose: from there on, what
is missing may be furniture that was moved, or people."""

NEARBY_AGREEMENT, NEARBY_SCORE = 0.85, 0.8
"""Agreement and score, relative to the usual ones, that the place nearby must have: where a scan
fits nowhere, some place always fits a little better."""

BETTER_AGREEMENT = 0.15
"""By which the agreement must be better there, relative to the usual one."""

MIN_COUNTED = 0.4
"""Share of the returns that the map must show there: where it ends, few returns fit anywhere."""


class Tracker:
    """The pose in the map, and its covariance.

    Parameters
    ----------
    known : the map.
    config : of local SLAM, whose least-squares matcher is used.
    tf_map_tracking : first pose.
    covariance : float64, shape (3, 3), of it [m^2, m rad, rad^2].

    Attributes
    ----------
    pose : tf_map_tracking.
    covariance : of x, y, theta, map frame.
    """

    def __init__(
        self,
        known: KnownMap,
        config: LocalSlamConfig,
        tf_map_tracking: Pose,
        covariance: FloatArray,
    ) -> None:
        self._known = known
        self._mean = 1.0
        self._matcher = config.least_squares_matcher
        self._prediction = config.prediction
        self._open_direction: float | None = None
        self.pose = tf_map_tracking
        self.covariance = covariance

    def move(self, step: Pose, duration: float = 0.0, *, has_odometry: bool = True) -> None:
        """Move by what local SLAM measured since the last scan, in the robot's frame.

        Parameters
        ----------
        duration : since the last scan [s].
        has_odometry : whether the motion along bare walls was measured at all.
        """
        pose = compose(self.pose, step)
        length = math.hypot(step.x, step.y)
        dx, dy = pose.x - self.pose.x, pose.y - self.pose.y
        jacobian = np.array(((1.0, 0.0, -dy), (0.0, 1.0, dx), (0.0, 0.0, 1.0)))
        translation = DRIFT_M**2 * length
        rotation = DRIFT_RAD**2 * length + TURN_DRIFT_RAD**2 * abs(step.theta)
        noise = np.diag((translation, translation, rotation))
        self.covariance = jacobian @ self.covariance @ jacobian.T + noise
        self.pose = pose
        if self._open_direction is not None:
            error = unseen_error(step, duration, has_odometry=has_odometry)
            self._widen(_along(self._open_direction), error.position)

    def move_unseen(self, step: Pose, error: MotionError) -> None:
        """Move by a step that no scan has measured, given by how much it may be wrong."""
        self._open_direction = None
        self.move(step)
        for axis in (_along(0.0), _along(0.5 * math.pi)):
            self._widen(axis, error.position)
        self._widen(np.array((0.0, 0.0, 1.0)), error.heading)

    def _widen(self, along: FloatArray, sigma: float) -> None:
        """Add to the standard deviation along an axis of x, y, theta."""
        before = math.sqrt(max(float(along @ self.covariance @ along), 0.0))
        more = (before + sigma) ** 2 - before**2
        self.covariance = self.covariance + more * np.outer(along, along)

    def correct(self, points: FloatArray, beam_origin: Pose) -> float:
        """Correct the pose by a match to the map; return the agreement there, NaN if none counts.

        Parameters
        ----------
        points : float64, shape (n, 2), returns of the scan [m], tracking frame; n > 0.
        beam_origin : pose of the scanner on the robot.
        """
        known = self._known
        pose, covariance = self._matched(points)
        fit = known.fit(points, beam_origin, pose)
        usual = fit.agreement / known.usual.agreement
        is_refuted = usual < min(self._mean - DROP, REFUTED_AGREEMENT)
        if is_refuted and self._finds_nearby(points, beam_origin, fit):
            pose, covariance = self._matched(points)
            fit = known.fit(points, beam_origin, pose)
            usual = fit.agreement / known.usual.agreement
        if not math.isnan(usual):
            self._mean += MEAN_SHARE * (min(usual, 1.0) - self._mean)
        share = fit.num_counted / len(points)
        if math.isnan(usual) or usual < MIN_AGREEMENT:
            return known.fit(points, beam_origin, self.pose).agreement
        missing = max(FULL_TRUST_AGREEMENT / max(usual, 1e-3), 1.0) / max(share, 0.1)
        self._fuse(pose, covariance * missing**2)
        return fit.agreement

    def _finds_nearby(self, points: FloatArray, beam_origin: Pose, fit: Fit) -> bool:
        """Move the pose to where the scan fits better nearby; return whether there is such a place.

        Parameters
        ----------
        fit : where least squares led to.
        """
        known = self._known
        usual, thinned = known.usual, thin(points, SCAN_FILTER)
        window, turn = self._window()
        found = find_near(known, thinned, self.pose, window, turn, NEARBY_SCORE * usual.score)
        if found is None:
            return False
        better = known.fit(points, beam_origin, found.tf_map_tracking)
        least = max(NEARBY_AGREEMENT, fit.agreement / usual.agreement + BETTER_AGREEMENT)
        if (
            better.num_counted < MIN_COUNTED * len(points)
            or better.agreement < least * usual.agreement
            or better.score < NEARBY_SCORE * usual.score
        ):
            return False
        # The match that follows says how well the place is known; the pose before, nothing.
        jump = relative(self.pose, found.tf_map_tracking)
        sigma = max(math.hypot(jump.x, jump.y), known.grid.resolution)
        heading = max(abs(jump.theta), PRIOR_SIGMA_RAD)
        self.pose = found.tf_map_tracking
        self.covariance = np.diag((sigma**2, sigma**2, heading**2))
        return True

    def _window(self) -> tuple[float, float]:
        """Return the window of the search nearby, to each side [m], [rad]."""
        sigma, turn = self._sigmas()
        return (
            min(max(NEARBY_M, 2.0 * sigma), MAX_NEARBY_M),
            min(max(NEARBY_RAD, 2.0 * turn), MAX_NEARBY_RAD),
        )

    def _sigmas(self) -> tuple[float, float]:
        """Return the standard deviations of the pose [m], [rad]."""
        variances = self.covariance.diagonal()
        return math.sqrt(float(variances[:2].sum())), math.sqrt(float(variances[2]))

    def _matched(self, points: FloatArray) -> tuple[Pose, FloatArray]:
        """Return where the scan fits best near the predicted pose, and the covariance of that."""
        known = self._known
        sigma, turn = self._sigmas()
        prior = known.to_grid(self.pose)
        prior_information = isotropic_information(
            min(max(sigma, PRIOR_SIGMA_M), MAX_PRIOR_SIGMA_M), max(turn, PRIOR_SIGMA_RAD)
        )
        residual = math.sqrt(max(1.0 - known.usual.score, 0.05))
        match = least_squares.match(
            known.smooth_map,
            points,
            prior,
            prior,
            prior_information,
            MatchOptions(
                self._matcher.occupied_space_weight / residual**2,
                self._matcher.max_num_iterations,
                self._matcher.tolerance,
            ),
        )
        ratio, direction = degenerate_direction(match)
        is_open = not is_determined(ratio, self._prediction.spurious_information)
        self._open_direction = direction + known.tf_map_grid.theta if is_open else None
        information = self._without_spurious(match_information(match), ratio, direction)
        cos, sin = math.cos(known.tf_map_grid.theta), math.sin(known.tf_map_grid.theta)
        rotation = np.array(((cos, -sin, 0.0), (sin, cos, 0.0), (0.0, 0.0, 1.0)))
        covariance = rotation @ np.linalg.inv(information) @ rotation.T
        floor = np.diag((MAP_SIGMA_M**2, MAP_SIGMA_M**2, MAP_SIGMA_RAD**2))
        return known.to_map(match.tf_submap_scan), covariance + floor

    def _without_spurious(
        self, information: FloatArray, ratio: float, direction: float
    ) -> FloatArray:
        """Return information without that along a corridor, where it is due to pixel noise."""
        true_share = max(ratio - self._prediction.spurious_information, 0.0) / max(ratio, 1e-9)
        along = np.array((math.cos(direction), math.sin(direction), 0.0))
        covariance = np.asarray(np.linalg.inv(information), dtype=np.float64)
        variance = float(along @ covariance @ along)
        more = min(variance / max(true_share, 1e-6), UNKNOWN_SIGMA_M**2) - variance
        covariance = covariance + max(more, 0.0) * np.outer(along, along)
        return np.asarray(np.linalg.inv(covariance), dtype=np.float64)

    def _fuse(self, measured: Pose, covariance: FloatArray) -> None:
        """Correct the pose by a measured one, unless that is too far away."""
        pose = self.pose
        innovation = np.array(
            (measured.x - pose.x, measured.y - pose.y, wrap_angle(measured.theta - pose.theta))
        )
        inverse = np.linalg.inv(self.covariance + covariance)
        squares = float(innovation @ inverse @ innovation)
        if squares > MAX_CORRECTION_SIGMAS**2:
            # The prediction was worse than assumed: it loses weight until they agree.
            self.covariance = self.covariance * 2.0
            return
        gain = self.covariance @ inverse
        x, y, theta = (gain @ innovation).tolist()
        self.pose = Pose(pose.x + x, pose.y + y, wrap_angle(pose.theta + theta))
        updated = (np.eye(3) - gain) @ self.covariance
        self.covariance = 0.5 * (updated + updated.T)


def _along(direction: float) -> FloatArray:
    """Return a direction of the map as an axis of x, y, theta."""
    return np.array((math.cos(direction), math.sin(direction), 0.0))
