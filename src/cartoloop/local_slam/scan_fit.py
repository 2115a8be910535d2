# SPDX-License-Identifier: Apache-2.0
"""How one scan fits to a submap: the matches that are tried, and what speaks for each."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from cartoloop.arrays import FloatArray
from cartoloop.config import (
    CorrelativeMatcherConfig,
    LeastSquaresMatcherConfig,
    LocalSlamConfig,
    PredictionConfig,
)
from cartoloop.local_slam.degenerate_direction import leaves_direction_open
from cartoloop.local_slam.prediction import Prediction, isotropic_information
from cartoloop.local_slam.seen_points import residual_of_seen, share_of_seen
from cartoloop.scan_matching import correlative, least_squares
from cartoloop.scan_matching.least_squares import LeastSquaresMatch
from cartoloop.sensor.pose import Pose, compose, relative, wrap_angle
from cartoloop.submaps.submap import Submap

SPARSE_SMOOTHING = 1.0
"""Smoothing of a submap of sparse scans: these saw each wall a few times only, and show more of the
noise of the ranges than of the wall."""


@dataclass(frozen=True)
class MatcherSettings:
    """What the matches of all scans share.

    Attributes
    ----------
    prediction, least_squares : parameters.
    window, lost_window : of the correlative matcher, around the prediction and for lost scans.
    lost_information : motion prior of a match far from the prediction, shape (6,).
    scratch : memory of the correlative matcher.
    """

    prediction: PredictionConfig
    least_squares: LeastSquaresMatcherConfig
    window: CorrelativeMatcherConfig
    lost_window: CorrelativeMatcherConfig
    lost_information: FloatArray
    scratch: correlative.Scratch = field(default_factory=correlative.Scratch)

    @classmethod
    def of(cls, config: LocalSlamConfig) -> MatcherSettings:
        """Return those of local SLAM."""
        window, prediction = config.correlative_matcher, config.prediction
        return cls(
            prediction,
            config.least_squares_matcher,
            window,
            window.model_copy(
                update={
                    "linear_search_window": window.lost_linear_search_window,
                    "angular_search_window_deg": window.lost_angular_search_window_deg,
                }
            ),
            isotropic_information(
                prediction.lost_translation_sigma, prediction.lost_rotation_sigma
            ),
        )


@dataclass(slots=True)
class ScanFit:
    """A scan, the submap that it is matched to, and its motion prior.

    Attributes
    ----------
    settings : parameters.
    submap : that the scan is matched to.
    points : float64, shape (n, 2), tracking frame [m]; n > 0.
    prediction : motion prior.
    typical_residual : of matches.
    prior : the predicted pose, tf_submap_scan.
    """

    settings: MatcherSettings
    submap: Submap
    points: FloatArray
    prediction: Prediction
    typical_residual: float
    prior: Pose = field(init=False)

    def __post_init__(self) -> None:
        self.prior = self.in_submap(self.prediction.tf_local_tracking)

    def in_submap(self, tf_local_tracking: Pose) -> Pose:
        """Return tf_submap_scan of a pose in the local frame."""
        return relative(self.submap.tf_local_submap, tf_local_tracking)

    def in_local(self, match: LeastSquaresMatch) -> Pose:
        """Return tf_local_tracking of a match."""
        return compose(self.submap.tf_local_submap, match.tf_submap_scan)

    def search(self, centre: Pose, window: CorrelativeMatcherConfig) -> Pose:
        """Return the best pixel of a window, tf_submap_scan."""
        found = correlative.match(
            self.submap.grid, self.points, centre, window, self.settings.scratch
        )
        return found.tf_submap_scan

    def refine(self, start: Pose, prior: Pose, information: FloatArray) -> LeastSquaresMatch:
        """Return the match by (CS) from a start, with a motion prior."""
        grid, config = self.submap.grid, self.settings.least_squares
        return least_squares.match(
            least_squares.SmoothMap(
                grid.cells,
                grid.origin_x,
                grid.origin_y,
                grid.resolution,
                SPARSE_SMOOTHING if self.submap.is_sparse else 0.0,
            ),
            self.points,
            start,
            prior,
            information,
            least_squares.MatchOptions(
                self.point_weight, config.max_num_iterations, config.tolerance
            ),
            self.settings.prediction.failure_scale,
        )

    def refine_freely(self, start: Pose) -> LeastSquaresMatch:
        """Return the match from a start that is its own, weak prior, as for lost scans."""
        return self.refine(start, start, self.settings.lost_information)

    @property
    def point_weight(self) -> float:
        """The weight of a point in (CS)."""
        return self.settings.least_squares.occupied_space_weight / self.typical_residual**2

    def is_lost(self, match: LeastSquaresMatch) -> bool:
        """Return whether a scan hardly ever fits as badly."""
        return match.residual > self.typical_residual * self.settings.window.lost_residual_ratio

    def fits_as_usual(self, match: LeastSquaresMatch) -> bool:
        """Return whether enough points fit as scans do."""
        return len(self.points) >= self.settings.window.min_num_seen and not self.is_lost(match)

    def is_determined(self, match: LeastSquaresMatch) -> bool:
        """Return whether a match shows the place in all directions, other than along a corridor."""
        return not leaves_direction_open(match, self.settings.prediction.spurious_information)

    def residual_of_seen(self, match: LeastSquaresMatch) -> float:
        """Return the residual of the points in observed cells; 0 if these are too few to judge."""
        return residual_of_seen(
            self.submap.grid, self.points, match.tf_submap_scan, self.settings.window
        )

    def is_amply_seen(self, match: LeastSquaresMatch) -> bool:
        """Return whether most points are in observed cells."""
        share = share_of_seen(self.submap.grid, self.points, match.tf_submap_scan)
        return share >= self.settings.window.ample_seen_share

    def cost_against_prior(self, match: LeastSquaresMatch, num_scans: int) -> float:
        """Return the cost of a match far from the prediction: (CS) with its motion prior.

        Parameters
        ----------
        num_scans : as often the scan counts: number of scans in turn that do not fit.
        """
        prior, pose, information = self.prior, match.tf_submap_scan, self.prediction.information
        squares = (
            float(information[0]) * ((pose.x - prior.x) ** 2 + (pose.y - prior.y) ** 2)
            + float(information[5]) * wrap_angle(pose.theta - prior.theta) ** 2
        )
        scale = self.settings.prediction.failure_scale**2
        against = self.settings.window.lost_prior_weight * scale * math.log1p(squares / scale)
        return num_scans * self.cost_of_points(match) + against

    def cost_of_points(self, match: LeastSquaresMatch) -> float:
        """Return the cost of a match without its motion prior."""
        weight = self.settings.least_squares.occupied_space_weight * len(self.points)
        usual = match.residual / self.typical_residual
        return weight * usual * usual
