# SPDX-License-Identifier: Apache-2.0
"""From the predicted to the matched pose: least squares, then wider searches if it fits poorly."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from cartoloop.config import CorrelativeMatcherConfig, LocalSlamConfig, PredictionConfig
from cartoloop.local_slam.pose_extrapolator import PoseExtrapolator, Prediction
from cartoloop.scan_matching import correlative, least_squares
from cartoloop.scan_matching.least_squares import LeastSquaresMatch
from cartoloop.sensor.pose import FloatArray, Pose, compose, relative
from cartoloop.submaps.submap import Submap

FIRST_RESIDUAL = 0.5
"""What a match's residual is taken to be usually, until there are matches."""

PIXEL_NOISE_PIXELS = 0.5
"""How far off, in pixels, a scan is found along a direction that only pixels' noise tells of."""

SLOW_STEP_PIXELS = 1.0
"""A robot without odometry that is predicted to move less than this may as well set off: pixels
hold a standing robot fast, and a velocity of nought that is trusted would do so all the more."""

RESIDUAL_MEMORY = 0.02
"""Share of a new residual in what counts as usual."""


class MatchedScan(NamedTuple):
    """Where a scan was found.

    Attributes
    ----------
    tf_local_tracking : its pose.
    match : the match to the submap, in the submap's frame.
    """

    tf_local_tracking: Pose
    match: LeastSquaresMatch


class ScanMatcher:
    """Matches scans to a submap, knowing how well they usually fit.

    The search widens as needed: least squares from the prediction; if that fits worse than usual,
    the correlative matcher around it; if that is no better, the same in a wider window around the
    last pose and where constant velocity would have led, since the odometry may have jumped.
    """

    def __init__(self, config: LocalSlamConfig) -> None:
        self._config = config
        self._window = config.correlative_matcher
        self._lost_window = CorrelativeMatcherConfig(
            **self._window.model_dump()
            | {
                "linear_search_window": self._window.lost_linear_search_window,
                "angular_search_window_deg": self._window.lost_angular_search_window_deg,
            }
        )
        self._usual_residual = FIRST_RESIDUAL
        self._scratch = correlative.Scratch()
        self.num_correlative = 0
        self.num_lost = 0

    def match(
        self,
        submap: Submap,
        points: FloatArray,
        prediction: Prediction,
        extrapolator: PoseExtrapolator,
        time: float,
    ) -> MatchedScan:
        """Return where in the submap the scan fits best.

        Parameters
        ----------
        points : float64, shape (n, 2), tracking frame [m]; n > 0.
        """
        prior = relative(submap.tf_local_submap, prediction.tf_local_tracking)
        pull = self._pull(prediction, extrapolator, time, submap.grid.resolution)
        is_lost = False
        best = self._refine(submap, points, prior, prior, pull)
        if best.residual > self._usual_residual * self._window.poor_residual_ratio:
            self.num_correlative += 1
            coarse = self._search(submap, points, prior, self._window)
            found = self._refine(submap, points, coarse, prior, pull)
            if found.cost < best.cost:
                best = found
        if best.residual > self._usual_residual * self._window.lost_residual_ratio:
            self.num_lost += 1
            guesses = (extrapolator.at_rest(), extrapolator.at_constant_velocity(time))
            found = self._search_as_lost(submap, points, guesses, best)
            is_lost = found is not best
            best = found
        weight = self._config.least_squares_matcher.occupied_space_weight / self._usual_residual**2
        self._usual_residual += RESIDUAL_MEMORY * (best.residual - self._usual_residual)
        if not is_lost:
            noise = _pixel_information(prediction, pull, submap)
            held = hold_open_direction(best, prior, pull, weight, self._config.prediction, noise)
            best = best._replace(tf_submap_scan=held)
        return MatchedScan(compose(submap.tf_local_submap, best.tf_submap_scan), best)

    def _search_as_lost(
        self, submap: Submap, points: FloatArray, guesses: Iterable[Pose], best: LeastSquaresMatch
    ) -> LeastSquaresMatch:
        """Return the best match near the guesses, or `best` where none fits much better."""
        limit = best.residual * self._window.lost_improvement
        for tf_local_guess in guesses:
            centre = relative(submap.tf_local_submap, tf_local_guess)
            coarse = self._search(submap, points, centre, self._lost_window)
            found = self._refine(submap, points, coarse, coarse, self._lost_pull())
            if found.residual < min(limit, best.residual):
                best = found
        return best

    def _search(
        self, submap: Submap, points: FloatArray, centre: Pose, window: CorrelativeMatcherConfig
    ) -> Pose:
        return correlative.match(submap.grid, points, centre, window, self._scratch).tf_submap_scan

    def _refine(
        self, submap: Submap, points: FloatArray, start: Pose, prior: Pose, pull: FloatArray
    ) -> LeastSquaresMatch:
        grid, config = submap.grid, self._config.least_squares_matcher
        return least_squares.match(
            least_squares.SmoothMap(grid.cells, grid.origin_x, grid.origin_y, grid.resolution),
            points,
            start,
            prior,
            pull,
            least_squares.MatchOptions(
                config.occupied_space_weight / self._usual_residual**2,
                config.max_num_iterations,
                config.tolerance,
            ),
            self._config.prediction.failure_scale,
        )

    def _pull(
        self, prediction: Prediction, extrapolator: PoseExtrapolator, time: float, pixel: float
    ) -> FloatArray:
        """Return the information of the prediction, upper triangle, shape (6,)."""
        config, model = self._config.prediction, extrapolator.odometry_model
        if not prediction.by_odometry:
            translation, rotation = extrapolator.velocity_sigmas(time)
            rest, moved = extrapolator.at_rest(), prediction.tf_local_tracking
            is_slow = math.hypot(moved.x - rest.x, moved.y - rest.y) < SLOW_STEP_PIXELS * pixel
            gained = config.acceleration * (time - extrapolator.last_time) ** 2
            if is_slow and gained <= PIXEL_NOISE_PIXELS * pixel:
                translation = config.lost_translation_sigma
            return _information(
                min(translation, config.lost_translation_sigma),
                min(rotation, config.lost_rotation_sigma),
            )
        if not model.is_known:
            return _information(config.unknown_translation_sigma, config.unknown_rotation_sigma)
        return _information(
            max(
                config.translation_error_factor * model.translation_error,
                config.min_translation_sigma,
            ),
            max(config.rotation_error_factor * model.rotation_error, config.min_rotation_sigma),
        )

    def _lost_pull(self) -> FloatArray:
        config = self._config.prediction
        return _information(config.lost_translation_sigma, config.lost_rotation_sigma)


def _information(translation_sigma: float, rotation_sigma: float) -> FloatArray:
    """Return an isotropic information matrix as its upper triangle (xx, xy, xt, yy, yt, tt)."""
    translation, rotation = 1.0 / translation_sigma**2, 1.0 / rotation_sigma**2
    return np.array((translation, 0.0, 0.0, translation, 0.0, rotation))


def _pixel_information(prediction: Prediction, pull: FloatArray, submap: Submap) -> float:
    """Return what the noise of the pixels is still worth along an open direction [1/m^2].

    Odometry knows better. A velocity does so only where scans come fast; where they come slowly,
    what the pixels say, poor as it is, is better than the guess that the robot goes on as it did.
    """
    if prediction.by_odometry:
        return 0.0
    noise = 1.0 / (PIXEL_NOISE_PIXELS * submap.grid.resolution) ** 2
    return noise if pull[0] >= noise else math.inf


def hold_open_direction(
    match: LeastSquaresMatch,
    prior: Pose,
    pull: FloatArray,
    point_weight: float,
    config: PredictionConfig,
    pixel_information: float = 0.0,
) -> Pose:
    """Return the pose of a match, held to the prediction along a direction that it leaves open.

    Along a featureless corridor the pixels' noise still gives (CS) a curvature, a share of that
    across it, which ties the scan to where the map happens to be rough. That share is no
    information. What is left of the curvature is weighed anew against the prediction.

    Parameters
    ----------
    prior, pull : the prediction and its information, upper triangle, shape (6,).
    point_weight : factor of the points' information.
    pixel_information : what that share is worth nevertheless [1/m^2].
    """
    ratio, direction = degenerate_direction(match)
    if not 0.0 < ratio < 1.0:
        return match.tf_submap_scan
    (xx, xy), (_, yy) = match.information[:2, :2].tolist()
    strong = 0.5 * (xx + yy) + math.hypot(0.5 * (xx - yy), xy)
    seeming = point_weight * ratio * strong
    true = point_weight * max(ratio - config.spurious_information, 0.0) * strong
    true = min(seeming, true + pixel_information)
    cos, sin = math.cos(direction), math.sin(direction)
    pose = match.tf_submap_scan
    along = cos * (pose.x - prior.x) + sin * (pose.y - prior.y)
    trust = float(pull[0]) / (1.0 + along * along * float(pull[0]) / config.failure_scale**2)
    kept = true / (true + trust) * (seeming + trust) / seeming
    back = (min(kept, 1.0) - 1.0) * along
    return Pose(pose.x + back * cos, pose.y + back * sin, pose.theta)


def degenerate_direction(match: LeastSquaresMatch) -> tuple[float, float]:
    """Return the ratio of the eigenvalues of a match's translation, and the weaker's direction.

    A small ratio tells of a corridor: along the direction [rad, grid axes] the scan says little.
    """
    (xx, xy), (_, yy) = match.information[:2, :2].tolist()
    mean, half = 0.5 * (xx + yy), math.hypot(0.5 * (xx - yy), xy)
    ratio = max(mean - half, 0.0) / (mean + half) if mean + half > 0.0 else 0.0
    return ratio, 0.5 * math.atan2(2.0 * xy, xx - yy) + 0.5 * math.pi
