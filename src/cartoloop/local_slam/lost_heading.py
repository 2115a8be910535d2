# SPDX-License-Identifier: Apache-2.0
"""Where scans fit that fit nowhere near their predictions: at another heading, in agreement.

A robot that is turned by hand, or whose odometry reports a wrong turn, stands where it stood, but
no scan fits at the heading that is expected. One scan may fit at a wrong heading by chance. The
next one then fits at another: only what two in turn say is believed.
"""

from __future__ import annotations

import math

from cartoloop.local_slam.scan_fit import ScanFit
from cartoloop.scan_matching.least_squares import LeastSquaresMatch
from cartoloop.sensor.pose import Pose, compose, inverse, wrap_angle

HEADINGS_RAD = (2.0 * math.pi / 3.0, -2.0 * math.pi / 3.0)
"""Centres of the searches, from the predicted heading: with the window of lost scans they and the
search there cover all headings [rad]."""

MAX_RESIDUAL_SHARE = 0.55
"""Largest residual of a match at another heading, as a share of that near the prediction. It is not
enough that it is usual: what scans usually have rises while they fit nowhere. At the opposite
heading of a corridor, scans of a new place have fitted with 0.56 and 0.7 of it."""

MAX_AGREED_SHARE, MAX_AGREED_TURN_RAD = 0.92, math.radians(150.0)
"""Largest residual of two scans in turn that show different walls and agree closely, as such a
share, and the largest turn from the predicted heading [rad]. After turns on the spot that the
odometry missed by 75 degrees, three scans of a hall had shares of 0.84 to 0.9 at the right heading,
and agreed to a degree; at other headings all had 0.94 and more."""

OTHER_VIEW_RAD = math.radians(15.0)
"""Turn from scan to scan after which they show different walls [rad]: two of the same view agree in
any case."""

ON_THE_SPOT_M = 0.1
"""A robot that moves by more from scan to scan drives [m], and its wheels show the heading. Where
scans come fast, a slow robot that drives moves less."""

AGREE_M, AGREE_RAD = 0.3, math.radians(10.0)
"""Difference of the poses that two scans show up to which they agree [m], [rad]."""

CLOSE_M, CLOSE_RAD = 0.15, math.radians(5.0)
"""The same up to which they agree closely [m], [rad]."""


def is_searched(num_lost: int) -> bool:
    """Return whether other headings are searched for a lost scan.

    That is the 2nd and 3rd in turn, the 6th and 7th, the 14th and 15th, and so on: scans that fit
    at no other heading are mostly of a place that has changed or is new.
    """
    # The first of each pair is by two less than a power of two.
    first = num_lost if _is_first_of_pair(num_lost) else num_lost - 1
    return first > 0 and (first + 2).bit_count() == 1


def _is_first_of_pair(num_lost: int) -> bool:
    """Return whether a lost scan that is searched is the first of two in turn."""
    return num_lost % 2 == 0


class LostHeading:
    """Where the latest lost scan fits at another heading.

    Attributes
    ----------
    tf_found_predicted : from where the robot was predicted to where it was found, in the local
        frame; None if the latest scan is not lost, or fits at no other heading.
    """

    def __init__(self) -> None:
        self.tf_found_predicted: Pose | None = None

    def search(self, fit: ScanFit, best: LeastSquaresMatch, num_lost: int) -> LeastSquaresMatch:
        """Return the match at another heading that two scans in turn agree on, or `best`.

        The robot must stand or turn on the spot. Each scan must fit as scans usually do, in
        observed cells, and outweigh the motion prior as any match of a lost scan. A corridor, which
        looks alike in both directions, does not count. Scans of different views may fit less well
        if they agree closely.

        Parameters
        ----------
        best : the match near the prediction.
        num_lost : number of scans by odometry in turn that fit nowhere.
        """
        if self.tf_found_predicted is None and not _is_first_of_pair(num_lost):
            return best  # whatever this scan shows, no other one agrees with it
        predicted, (rest, _) = fit.prediction.tf_local_tracking, fit.prediction.fallbacks()
        if math.hypot(predicted.x - rest.x, predicted.y - rest.y) > ON_THE_SPOT_M:
            self.tf_found_predicted = None
            return best
        is_other_view = abs(wrap_angle(predicted.theta - rest.theta)) >= OTHER_VIEW_RAD
        turned, is_clear = _at_other_headings(fit, best, is_other_view=is_other_view)
        weight = min(num_lost, fit.settings.window.max_lost_scans)
        if turned is not None and weight * best.cost <= fit.cost_against_prior(turned, weight):
            turned = None
        found = None if turned is None else fit.in_local(turned)
        is_agreed = self.add(predicted, found, is_clear=is_clear)
        return turned if turned is not None and is_agreed else best

    def add(self, predicted: Pose, found: Pose | None, *, is_clear: bool = True) -> bool:
        """Add a lost scan; return whether the one before shows the same.

        Parameters
        ----------
        predicted, found : tf_local_tracking, predicted and as it fits at another heading; None if
            it fits at none.
        is_clear : whether it fits clearly there; otherwise the two must agree closely.
        """
        before, self.tf_found_predicted = self.tf_found_predicted, None
        if found is None:
            return False
        self.tf_found_predicted = compose(found, inverse(predicted))
        if before is None:
            return False
        expected = compose(before, predicted)
        most, most_turned = (AGREE_M, AGREE_RAD) if is_clear else (CLOSE_M, CLOSE_RAD)
        return (
            math.hypot(found.x - expected.x, found.y - expected.y) <= most
            and abs(wrap_angle(found.theta - expected.theta)) <= most_turned
        )


def fits_clearly(fit: ScanFit, found: LeastSquaresMatch, limit: float) -> bool:
    """Return whether a match may say that the robot turned although its odometry did not.

    Parameters
    ----------
    limit : its residual must be smaller.
    """
    return (
        found.residual < limit
        and fit.fits_as_usual(found)
        and fit.is_determined(found)
        and fit.is_amply_seen(found)
    )


def _at_other_headings(
    fit: ScanFit, best: LeastSquaresMatch, *, is_other_view: bool
) -> tuple[LeastSquaresMatch | None, bool]:
    """Return the match at a heading far from the predicted one that is better, and if clearly.

    Parameters
    ----------
    is_other_view : whether the scan before shows other walls, so that it counts if they agree.
    """
    clear, limit = None, MAX_RESIDUAL_SHARE * best.residual
    turned, most = None, MAX_AGREED_SHARE * best.residual
    for angle in HEADINGS_RAD:
        centre = fit.prior._replace(theta=wrap_angle(fit.prior.theta + angle))
        found = fit.refine_freely(fit.search(centre, fit.settings.lost_window))
        if fits_clearly(fit, found, limit):
            clear, limit = found, found.residual
        if found.residual < most:
            turned, most = found, found.residual
    if clear is not None or turned is None or not is_other_view:
        return clear, clear is not None
    turn = abs(wrap_angle(turned.tf_submap_scan.theta - fit.prior.theta))
    is_supported = fit.is_determined(turned) and fit.is_amply_seen(turned)
    return (turned if turn <= MAX_AGREED_TURN_RAD and is_supported else None), False
