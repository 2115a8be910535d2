# SPDX-License-Identifier: Apache-2.0
"""Where a scan is searched that fits nowhere near its prediction."""

from __future__ import annotations

import math

from cartoloop.local_slam.degenerate_direction import where_prior_leads
from cartoloop.local_slam.lost_heading import fits_clearly
from cartoloop.local_slam.scan_fit import ScanFit
from cartoloop.scan_matching.least_squares import LeastSquaresMatch
from cartoloop.sensor.pose import Pose, relative, wrap_angle

AROUND_STEP, LONGEST_STEP_M = 1.2, 2.5
"""Radius of the search around the last pose, in steps of the odometry: it may report the right
distance in a wrong direction, such as driving backwards as driving forwards. After longer steps [m]
scans overlap too little for a window of that size."""

FAR_TURN_RAD = math.radians(6.0)
"""From the heading of the odometry to that of a match: a slip of a wheel hardly ever turns the
robot more from scan to scan [rad]. Scans with a short view, which fit badly at any heading, would
turn it further and further."""

MAX_TURNED_RESIDUAL_SHARE = 0.75
"""Largest residual of a match at such a heading, as a share of that near the prediction."""

ONE_SEARCH_M, ONE_SEARCH_RAD = 0.1, math.radians(3.0)
"""Fallback poses that differ by no more [m], [rad] are searched together: the window around one
covers most of that around the other. Where scans come fast, they hardly ever differ by more."""


def search_as_lost(fit: ScanFit, best: LeastSquaresMatch, num_lost: int) -> LeastSquaresMatch:
    """Return the best match elsewhere, or `best` if none fits much better.

    A prediction may lead to where little has been observed yet. The points there fit badly, and
    would fit better wherever the scan overlaps more of the map, but they contradict nothing. So
    only points in observed cells count, unless the scan fits as usual elsewhere, and those near the
    prediction do not. Against odometry the points must outweigh the motion prior, too: those of all
    scans in turn that do not fit, since the odometry that has missed one motion of the robot does
    not learn of it later. Far from its heading they must fit clearly.

    Parameters
    ----------
    best : the match near the prediction.
    num_lost : number of scans by odometry in turn that fit nowhere.
    """
    window = fit.settings.window
    weight = min(num_lost, window.max_lost_scans)
    by_odometry = fit.prediction.by_odometry
    cost = weight * best.cost
    limit = best.residual * window.lost_improvement
    residual_of_seen = fit.residual_of_seen(best)
    limit_of_seen = window.lost_improvement * residual_of_seen
    is_contradicted = not 0.0 < residual_of_seen <= fit.typical_residual
    for centre in _fallbacks(fit):
        found = _near_fallback(fit, centre)
        if by_odometry and _is_doubtful_turn(fit, found, best):
            continue
        if (
            found.residual < min(limit, best.residual)
            and (not by_odometry or fit.cost_against_prior(found, weight) < cost)
            and (
                (is_contradicted and fit.fits_as_usual(found))
                or fit.residual_of_seen(found) < limit_of_seen
            )
        ):
            best = found
    if by_odometry and not fit.fits_as_usual(best):
        found = _around_last_pose(fit, best)
        # A wide window holds more places that look alike: all must speak for this one.
        if (
            found.residual < window.lost_improvement * best.residual
            and fit.residual_of_seen(found) < limit_of_seen
            and fit.fits_as_usual(found)
            and fit.is_determined(found)
            and fit.cost_against_prior(found, weight) < cost
        ):
            best = found
    if fit.prediction.over_jump is not None:
        # Where the odometry and the scan agree, the jump was a motion with wrong stamps.
        centre = fit.in_submap(fit.prediction.over_jump)
        found = fit.refine_freely(fit.search(centre, window))
        if found.residual < best.residual and fit.is_determined(found):
            best = found
    return best


def _is_doubtful_turn(fit: ScanFit, found: LeastSquaresMatch, best: LeastSquaresMatch) -> bool:
    """Return whether a match is far from the heading of the odometry, and not clear enough.

    Where a robot with a short view enters a room, its scans fit nowhere, and badly anywhere.
    """
    turn = abs(wrap_angle(found.tf_submap_scan.theta - fit.prior.theta))
    if turn <= FAR_TURN_RAD:
        return False
    return not fits_clearly(fit, found, MAX_TURNED_RESIDUAL_SHARE * best.residual)


def _fallbacks(fit: ScanFit) -> tuple[Pose, ...]:
    """Return the fallback poses to search around, tf_submap_scan: one of those nearly the same."""
    rest, moving = map(fit.in_submap, fit.prediction.fallbacks())
    step = relative(rest, moving)
    if math.hypot(step.x, step.y) <= ONE_SEARCH_M and abs(step.theta) <= ONE_SEARCH_RAD:
        return (rest,)
    return rest, moving


def _near_fallback(fit: ScanFit, centre: Pose) -> LeastSquaresMatch:
    """Return the match near a fallback pose, tf_submap_scan.

    Along a corridor it is where the odometry leads, unless what has been observed there contradicts
    that clearly, as where wheels slip. Not after a gap in the recording: metres ahead, little of a
    corridor has been observed, and that far away.
    """
    found = fit.refine_freely(fit.search(centre, fit.settings.lost_window))
    if not fit.prediction.by_odometry:
        return found
    start = where_prior_leads(found, fit.prior, fit.settings.prediction.spurious_information)
    if start == found.tf_submap_scan:
        return found
    led = fit.refine_freely(start)
    if fit.prediction.gap is not None:
        return led
    limit = fit.settings.window.lost_improvement * fit.residual_of_seen(led)
    return found if found.residual < limit else led


def _around_last_pose(fit: ScanFit, best: LeastSquaresMatch) -> LeastSquaresMatch:
    """Return the match as far around the last pose as the odometry says that the robot moved.

    `best` where it moved no farther than lost scans are searched anyway, or too far.
    """
    last, _ = fit.prediction.fallbacks()
    rest = fit.in_submap(last)
    step = math.hypot(fit.prior.x - rest.x, fit.prior.y - rest.y)
    window = fit.settings.lost_window
    if not window.linear_search_window < step <= LONGEST_STEP_M:
        return best
    wide = window.model_copy(update={"linear_search_window": AROUND_STEP * step})
    return fit.refine_freely(fit.search(rest, wide))
