# SPDX-License-Identifier: Apache-2.0
"""From the predicted to the matched pose: least squares, then wider searches if it fits poorly."""

from __future__ import annotations

import math
from typing import NamedTuple

from cartoloop.arrays import FloatArray
from cartoloop.config import CorrelativeMatcherConfig, LocalSlamConfig
from cartoloop.local_slam.degenerate_direction import (
    constrain_degenerate_direction,
    degenerate_direction,
    where_prior_leads,
)
from cartoloop.local_slam.lost_heading import (
    HEADINGS_RAD,
    MAX_STEP_M,
    MIN_LOST_SCANS,
    LostHeading,
)
from cartoloop.local_slam.match_records import MatcherMemory
from cartoloop.local_slam.prediction import Prediction, isotropic_information
from cartoloop.local_slam.seen_points import residual_of_seen, share_of_seen
from cartoloop.scan_matching import correlative, least_squares
from cartoloop.scan_matching.least_squares import LeastSquaresMatch
from cartoloop.sensor.pose import Pose, compose, relative, wrap_angle
from cartoloop.submaps.submap import Submap

LARGE_TURN_RAD = 0.05
"""Turn against the odometry from which a match must fit better where the map is known [rad]: many
times what dense scans turn, and a fraction of what sparse ones do where they overlap wrongly."""


class MatchedScan(NamedTuple):
    """A scan's pose and its match.

    Attributes
    ----------
    tf_local_tracking : its pose.
    match : the match to the submap, in the submap's frame.
    is_relocated : whether it was found at another heading than expected, after scans that were
        lost: the robot did not move so.
    """

    tf_local_tracking: Pose
    match: LeastSquaresMatch
    is_relocated: bool = False


class ScanMatcher:
    """Matches scans to a submap, and keeps the typical residual of a match.

    The search widens as needed: least squares from the prediction; if the residual is larger than
    usual, the correlative matcher around it; if that is no better, the correlative matcher in a
    wider window around the fallback poses of the prediction, since the odometry may have jumped;
    if scans in turn fit nowhere, all headings: :class:`LostHeading`.

    Attributes
    ----------
    num_correlative : number of scans for which the correlative matcher ran.
    num_lost : number of scans that were searched in the wider window.
    lost_in_turn : number of latest scans by odometry that fitted nowhere as scans do.
    """

    def __init__(self, config: LocalSlamConfig) -> None:
        self._prediction = config.prediction
        self._least_squares = config.least_squares_matcher
        self._window = config.correlative_matcher
        self._lost_window = self._window.model_copy(
            update={
                "linear_search_window": self._window.lost_linear_search_window,
                "angular_search_window_deg": self._window.lost_angular_search_window_deg,
            }
        )
        self._lost_information = isotropic_information(
            config.prediction.lost_translation_sigma, config.prediction.lost_rotation_sigma
        )
        self._typical_residual = self._window.initial_residual
        self._scratch = correlative.Scratch()
        self._lost_heading = LostHeading()
        self.num_correlative = 0
        self.num_lost = 0
        self.lost_in_turn = 0

    @property
    def memory(self) -> MatcherMemory:
        """What it remembers from scan to scan."""
        return MatcherMemory(
            self._typical_residual,
            self.num_correlative,
            self.num_lost,
            self.lost_in_turn,
            self._lost_heading.tf_found_predicted,
        )

    @memory.setter
    def memory(self, memory: MatcherMemory) -> None:
        (
            self._typical_residual,
            self.num_correlative,
            self.num_lost,
            self.lost_in_turn,
            self._lost_heading.tf_found_predicted,
        ) = memory

    def match(self, submap: Submap, points: FloatArray, prediction: Prediction) -> MatchedScan:
        """Return where in the submap the scan fits best.

        Parameters
        ----------
        points : float64, shape (n, 2), tracking frame [m]; n > 0.
        """
        window, information = self._window, prediction.information
        prior = relative(submap.tf_local_submap, prediction.tf_local_tracking)
        is_lost = is_relocated = False
        best = self._refine(submap, points, prior, prior, information)
        if best.residual > self._typical_residual * window.poor_residual_ratio:
            self.num_correlative += 1
            start = self._search(submap, points, prior, window)
            found = self._refine(submap, points, start, prior, information)
            if found.cost < best.cost and (
                not prediction.by_odometry
                or self._may_correct(submap, points, prior, information, best, found)
            ):
                best = found
        if best.residual > self._typical_residual * window.lost_residual_ratio:
            self.num_lost += 1
            self.lost_in_turn = self.lost_in_turn + 1 if prediction.by_odometry else 0
            found = self._search_as_lost(submap, points, prediction, best)
            if found is best and self.lost_in_turn >= MIN_LOST_SCANS:
                found = self._search_all_headings(submap, points, prediction, best)
                is_relocated = found is not best
            is_lost = found is not best
            best = found
        if is_lost or best.residual <= self._typical_residual * window.lost_residual_ratio:
            self.lost_in_turn = 0
        if self.lost_in_turn < MIN_LOST_SCANS:
            self._lost_heading.tf_found_predicted = None
        point_weight = self._least_squares.occupied_space_weight / self._typical_residual**2
        self._typical_residual += window.residual_memory * (best.residual - self._typical_residual)
        if not is_lost:
            pose = constrain_degenerate_direction(
                best,
                prior,
                information,
                point_weight,
                self._prediction,
                self._pixel_information(prediction, submap.grid.resolution),
            )
            best = best._replace(tf_submap_scan=pose)
        return matched_scan(submap, best, is_relocated=is_relocated)

    def _may_correct(
        self,
        submap: Submap,
        points: FloatArray,
        prior: Pose,
        information: FloatArray,
        best: LeastSquaresMatch,
        found: LeastSquaresMatch,
    ) -> bool:
        """Return whether a match near the prediction may replace the one at the odometry's word.

        A scan that leads to where little has been observed fits better wherever it overlaps more
        of the map. So there only a small turn, a scan that fits as usual, or points in observed
        cells may correct the odometry. Where scans are sparse, nearly each fits as usual, and the
        turns are large: those of more than some degrees must fit better in observed cells.
        """
        turn = abs(wrap_angle(found.tf_submap_scan.theta - prior.theta))
        if turn * turn * float(information[5]) <= 1.0:
            return True
        at_prediction = self._of_seen(submap, points, best)
        if self._of_seen(submap, points, found) < at_prediction:
            return True
        if at_prediction > 0.0 and turn > LARGE_TURN_RAD:
            return False
        return self._fits_as_usual(points, found) or (
            share_of_seen(submap.grid, points, best.tf_submap_scan) >= self._window.ample_seen_share
        )

    def _search_as_lost(
        self, submap: Submap, points: FloatArray, prediction: Prediction, best: LeastSquaresMatch
    ) -> LeastSquaresMatch:
        """Return the best match near the fallback poses, or `best` if none fits much better.

        Odometry may lead to where little has been observed yet. The points there fit badly, and
        would fit better wherever the scan overlaps more of the map, but they contradict nothing.
        So against odometry only points in observed cells count, unless the scan fits as usual, and
        the points must outweigh the motion prior: those of all scans in turn that do not fit, since
        the odometry that has missed one motion of the robot does not learn of it later.
        """
        ratio = self._window.lost_improvement
        limit, limit_of_seen = best.residual * ratio, math.inf
        weight = min(self.lost_in_turn, self._window.max_lost_scans)
        cost = weight * best.cost
        if prediction.by_odometry:
            limit_of_seen = ratio * self._of_seen(submap, points, best)
        prior = relative(submap.tf_local_submap, prediction.tf_local_tracking)
        for tf_local_fallback in prediction.fallbacks():
            centre = relative(submap.tf_local_submap, tf_local_fallback)
            start = self._search(submap, points, centre, self._lost_window)
            found = self._refine(submap, points, start, start, self._lost_information)
            if prediction.by_odometry:
                spurious = self._prediction.spurious_information
                start = where_prior_leads(found, prior, spurious)
                if start != found.tf_submap_scan:
                    found = self._refine(submap, points, start, start, self._lost_information)
            if found.residual < min(limit, best.residual) and (
                not prediction.by_odometry
                or (
                    self._cost_against(submap, points, prediction, found, weight) < cost
                    and (
                        self._fits_as_usual(points, found)
                        or self._of_seen(submap, points, found) < limit_of_seen
                    )
                )
            ):
                best = found
        if prediction.over_jump is not None:
            # Where the odometry and the scan agree, the jump was a motion with wrong stamps.
            centre = relative(submap.tf_local_submap, prediction.over_jump)
            start = self._search(submap, points, centre, self._window)
            found = self._refine(submap, points, start, start, self._lost_information)
            if found.residual < best.residual and self._is_determined(found):
                best = found
        return best

    def _search_all_headings(
        self, submap: Submap, points: FloatArray, prediction: Prediction, best: LeastSquaresMatch
    ) -> LeastSquaresMatch:
        """Return the match at another heading that two scans in turn agree on, or `best`.

        The robot must stand or turn on the spot. Each scan must fit as scans usually do, in
        observed cells, and outweigh the motion prior as any match of a lost scan. A corridor, which
        looks alike in both directions, does not count.
        """
        predicted, (rest, _) = prediction.tf_local_tracking, prediction.fallbacks()
        if math.hypot(predicted.x - rest.x, predicted.y - rest.y) > MAX_STEP_M:
            self._lost_heading.tf_found_predicted = None
            return best
        prior = relative(submap.tf_local_submap, predicted)
        turned = None
        for angle in HEADINGS_RAD:
            centre = prior._replace(theta=wrap_angle(prior.theta + angle))
            start = self._search(submap, points, centre, self._lost_window)
            found = self._refine(submap, points, start, start, self._lost_information)
            if (
                found.residual < (best if turned is None else turned).residual
                and self._fits_as_usual(points, found)
                and self._is_determined(found)
                and share_of_seen(submap.grid, points, found.tf_submap_scan)
                >= self._window.ample_seen_share
            ):
                turned = found
        weight = min(self.lost_in_turn, self._window.max_lost_scans)
        if turned is not None and weight * best.cost <= self._cost_against(
            submap, points, prediction, turned, weight
        ):
            turned = None
        pose = turned and compose(submap.tf_local_submap, turned.tf_submap_scan)
        is_agreed = self._lost_heading.add(predicted, pose)
        return turned if turned is not None and is_agreed else best

    def _cost_against(
        self,
        submap: Submap,
        points: FloatArray,
        prediction: Prediction,
        match: LeastSquaresMatch,
        num_scans: int,
    ) -> float:
        """Return the cost of a match far from the prediction: (CS) with its motion prior.

        The scan counts as often as there are scans in turn that do not fit.
        """
        prior = relative(submap.tf_local_submap, prediction.tf_local_tracking)
        pose, information = match.tf_submap_scan, prediction.information
        squares = (
            float(information[0]) * ((pose.x - prior.x) ** 2 + (pose.y - prior.y) ** 2)
            + float(information[5]) * wrap_angle(pose.theta - prior.theta) ** 2
        )
        scale = self._prediction.failure_scale**2
        weight = num_scans * self._least_squares.occupied_space_weight * len(points)
        usual = match.residual / self._typical_residual
        against = self._window.lost_prior_weight * scale * math.log1p(squares / scale)
        return weight * usual * usual + against

    def _is_determined(self, match: LeastSquaresMatch) -> bool:
        """Return whether a match shows the place in all directions, other than along a corridor."""
        return degenerate_direction(match)[0] > self._prediction.spurious_information

    def _fits_as_usual(self, points: FloatArray, match: LeastSquaresMatch) -> bool:
        limit = self._typical_residual * self._window.lost_residual_ratio
        return len(points) >= self._window.min_num_seen and match.residual <= limit

    def _of_seen(self, submap: Submap, points: FloatArray, match: LeastSquaresMatch) -> float:
        return residual_of_seen(submap.grid, points, match.tf_submap_scan, self._window)

    def _search(
        self, submap: Submap, points: FloatArray, centre: Pose, window: CorrelativeMatcherConfig
    ) -> Pose:
        return correlative.match(submap.grid, points, centre, window, self._scratch).tf_submap_scan

    def _refine(
        self,
        submap: Submap,
        points: FloatArray,
        start: Pose,
        prior: Pose,
        prior_information: FloatArray,
    ) -> LeastSquaresMatch:
        grid, config = submap.grid, self._least_squares
        return least_squares.match(
            least_squares.SmoothMap(grid.cells, grid.origin_x, grid.origin_y, grid.resolution),
            points,
            start,
            prior,
            prior_information,
            least_squares.MatchOptions(
                config.occupied_space_weight / self._typical_residual**2,
                config.max_num_iterations,
                config.tolerance,
            ),
            self._prediction.failure_scale,
        )

    def _pixel_information(self, prediction: Prediction, resolution: float) -> float:
        """Return the information of pixel noise along a degenerate direction [1/m^2].

        Zero with odometry, which is better. Without it: pixel noise counts where scans come fast,
        and without limit where they come slowly, because it is better than constant velocity.
        """
        if prediction.by_odometry:
            return 0.0
        noise = 1.0 / (self._prediction.pixel_noise * resolution) ** 2
        return noise if prediction.information[0] >= noise else math.inf


def matched_scan(
    submap: Submap, match: LeastSquaresMatch, *, is_relocated: bool = False
) -> MatchedScan:
    """Return a match to a submap with the scan's pose."""
    pose = compose(submap.tf_local_submap, match.tf_submap_scan)
    return MatchedScan(pose, match, is_relocated)
