# SPDX-License-Identifier: Apache-2.0
"""From the predicted to the matched pose: least squares, then wider searches if it fits poorly."""

from __future__ import annotations

import math
from typing import NamedTuple

from cartoloop.arrays import FloatArray
from cartoloop.config import LocalSlamConfig
from cartoloop.local_slam.degenerate_direction import (
    constrain_degenerate_direction,
    shows_heading,
)
from cartoloop.local_slam.gap_search import search_after_gap
from cartoloop.local_slam.lost_heading import LostHeading, is_searched
from cartoloop.local_slam.lost_search import search_as_lost
from cartoloop.local_slam.match_records import MatcherMemory
from cartoloop.local_slam.prediction import Prediction, with_rotation_sigma
from cartoloop.local_slam.scan_fit import MatcherSettings, ScanFit
from cartoloop.scan_matching.least_squares import LeastSquaresMatch
from cartoloop.sensor.pose import Pose, compose, wrap_angle
from cartoloop.sensor.spread import show_little
from cartoloop.submaps.submap import Submap

LARGE_TURN_RAD = 0.05
"""Turn against the odometry from which a match must fit better where the map is known [rad]: many
times what dense scans turn, and a fraction of what sparse ones do where they overlap wrongly."""

MAX_IGNORED_LOST = 50
"""Number of lost scans in turn from which their residuals are taken for usual: the surroundings
have changed, and not the place alone."""

MISFIT_RATIO = 1.65
"""Residual over the typical one of a match that may be wrong by decimetres. After gaps of seconds,
matches with less were right to some centimetres."""


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


MIN_MOTION_M = 0.03
"""A robot that moves by less from scan to scan may stop at once [m]."""


class ScanMatcher:
    """Matches scans to a submap, and keeps the typical residual of a match.

    The search widens as needed: least squares from the prediction; if the residual is larger than
    usual, the correlative matcher around it; if that is no better, the correlative matcher in a
    wider window around the fallback poses of the prediction, since the odometry may have jumped
    (:mod:`lost_search`); if scans in turn fit nowhere, all headings (:class:`LostHeading`).

    Attributes
    ----------
    num_correlative : number of scans for which the correlative matcher ran.
    num_lost : number of scans that were searched in the wider window.
    lost_in_turn : number of latest scans by odometry that fitted nowhere as scans do.
    """

    def __init__(self, config: LocalSlamConfig) -> None:
        self._settings = MatcherSettings.of(config)
        self._typical_residual = config.correlative_matcher.initial_residual
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
        fit = ScanFit(self._settings, submap, points, prediction, self._typical_residual)
        best = self._near_prediction(fit)
        found, is_relocated = self._elsewhere(fit, best) if fit.is_lost(best) else (best, False)
        is_lost, best = found is not best, found
        if is_lost or not fit.is_lost(best):
            self.lost_in_turn = 0
        if not is_searched(self.lost_in_turn):
            self._lost_heading.tf_found_predicted = None
        self._learn_residual(fit, best)
        if not is_lost:
            pose = constrain_degenerate_direction(
                best,
                fit.prior,
                prediction.information,
                fit.point_weight,
                self._settings.prediction,
                self._pixel_information(prediction, submap.grid.resolution),
            )
            best = best._replace(tf_submap_scan=pose)
        return matched_scan(submap, best, is_relocated=is_relocated)

    def is_misfit(self, match: LeastSquaresMatch) -> bool:
        """Return whether the latest scan fits worse than one that only shows new places."""
        return match.residual > MISFIT_RATIO * self._typical_residual

    def _learn_residual(self, fit: ScanFit, match: LeastSquaresMatch) -> None:
        """Learn how well scans fit.

        Those that the odometry leads to where the map is known, and that do not fit there, do not
        count, unless they go on: they are elsewhere.
        """
        if 0 < self.lost_in_turn <= MAX_IGNORED_LOST and fit.is_amply_seen(match):
            return
        change = match.residual - self._typical_residual
        self._typical_residual += self._settings.window.residual_memory * change

    def _near_prediction(self, fit: ScanFit) -> LeastSquaresMatch:
        """Return the match by (CS) from the prediction, or from the best pixel if that is better.

        Pixels are searched where the match is poor, or the robot moved far since the last scan. A
        scan that shows no heading is turned as the odometry says, be it calibrated or not.
        """
        prediction, window = fit.prediction, self._settings.window
        best = fit.refine(fit.prior, fit.prior, prediction.information)
        is_poor = best.residual > self._typical_residual * window.poor_residual_ratio
        if is_poor or prediction.is_far:
            self.num_correlative += 1
            start = fit.search(fit.prior, window)
            found = fit.refine(start, fit.prior, prediction.information)
            if found.cost < best.cost and (
                not prediction.by_odometry or _may_correct(fit, best, found)
            ):
                best = found
        if prediction.stands and prediction.by_odometry:
            best = self._moving(fit, best)
        if follows_odometry(best, prediction, fit.points):
            stiff = with_rotation_sigma(
                prediction.information, self._settings.prediction.min_rotation_sigma
            )
            best = fit.refine(fit.prior, fit.prior, stiff)
        return best

    def _moving(self, fit: ScanFit, best: LeastSquaresMatch) -> LeastSquaresMatch:
        """Return the match of a robot that has not stopped, if it fits much better than at rest.

        Along a corridor, odometry that has stopped leads to a match at rest, which fits worse and
        worse, but not so badly that the scan is lost.
        """
        rest, moving = fit.prediction.fallbacks()
        if math.hypot(moving.x - rest.x, moving.y - rest.y) < MIN_MOTION_M:
            return best
        found = fit.refine_freely(fit.in_submap(moving))
        if found.residual < self._settings.window.lost_improvement * best.residual:
            return found
        return best

    def _elsewhere(self, fit: ScanFit, best: LeastSquaresMatch) -> tuple[LeastSquaresMatch, bool]:
        """Return the match of a lost scan, or `best`, and whether it is at another heading."""
        self.num_lost += 1
        self.lost_in_turn = self.lost_in_turn + 1 if fit.prediction.by_odometry else 0
        found = search_as_lost(fit, best, self.lost_in_turn)
        gap = fit.prediction.gap
        if gap is not None and (found is best or not fit.fits_as_usual(found)):
            found = search_after_gap(fit, found, gap)
        if found is best and is_searched(self.lost_in_turn):
            found = self._lost_heading.search(fit, best, self.lost_in_turn)
            return found, found is not best
        return found, False

    def _pixel_information(self, prediction: Prediction, resolution: float) -> float:
        """Return the information of pixel noise along a degenerate direction [1/m^2].

        Zero with odometry, which is better. Without it: pixel noise counts where scans come fast,
        and without limit where they come slowly, because it is better than constant velocity.
        """
        if prediction.by_odometry:
            return 0.0
        noise = 1.0 / (self._settings.prediction.pixel_noise * resolution) ** 2
        return noise if prediction.information[0] >= noise else math.inf


def follows_odometry(match: LeastSquaresMatch, prediction: Prediction, points: FloatArray) -> bool:
    """Return whether a match says nothing that the odometry has not said: it shows no heading.

    Its curvature alone does not decide: it vanishes where points lie on the ridge of a wall, too.

    Parameters
    ----------
    points : that were matched, float64, shape (n, 2) [m].
    """
    return prediction.by_odometry and not shows_heading(match) and show_little(points)


def _may_correct(fit: ScanFit, best: LeastSquaresMatch, found: LeastSquaresMatch) -> bool:
    """Return whether a match near the prediction may replace the one at the odometry's word.

    A scan that leads to where little has been observed fits better wherever it overlaps more of the
    map. So there only a small turn, a scan that fits as usual, or points in observed cells may
    correct the odometry. Where scans are sparse, nearly each fits as usual, and the turns are
    large: those of more than some degrees must fit better in observed cells.
    """
    turn = abs(wrap_angle(found.tf_submap_scan.theta - fit.prior.theta))
    if turn * turn * float(fit.prediction.information[5]) <= 1.0:
        return True
    at_prediction = fit.residual_of_seen(best)
    if fit.residual_of_seen(found) < at_prediction:
        return True
    if at_prediction > 0.0 and turn > LARGE_TURN_RAD:
        return False
    return fit.fits_as_usual(found) or fit.is_amply_seen(best)


def matched_scan(
    submap: Submap, match: LeastSquaresMatch, *, is_relocated: bool = False
) -> MatchedScan:
    """Return a match to a submap with the scan's pose."""
    pose = compose(submap.tf_local_submap, match.tf_submap_scan)
    return MatchedScan(pose, match, is_relocated)
