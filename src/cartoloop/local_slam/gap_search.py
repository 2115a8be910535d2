# SPDX-License-Identifier: Apache-2.0
"""Where a scan is searched that fits nowhere after a gap in the recording.

What wheels are wrong by grows with the motion in the gap, which may be metres. And readings next to
it may have been buffered, so that a part of the motion is reported before or after it.
"""

from __future__ import annotations

import math

from cartoloop.local_slam.scan_fit import ScanFit
from cartoloop.scan_matching.least_squares import LeastSquaresMatch
from cartoloop.sensor.pose import Pose, relative

ERROR_SHARE, LEAST_ERROR_M, MAX_ERROR_M = 0.2, 0.3, 1.0
"""Error of the odometry in a gap: a share of the distance that it reports, and limits [m]."""

ERROR_RAD, WINDOW_DEG = 0.1, 30.0
"""Error of its heading [rad], and how far from it is searched."""

MAX_RESIDUAL_SHARE, MAX_UNSEEN_SHARE = 0.97, 0.92
"""Largest residual of a match, as a share of that near the prediction, and where nothing has been
observed there: any overlap with the map fits better. Scans after a gap show much that is new, and
hardly ever fit as usual, but the right place fits best."""

SAME_M, SAME_RAD = 0.1, math.radians(5.0)
"""Poses that differ by no more are searched once [m], [rad]."""


def search_after_gap(fit: ScanFit, best: LeastSquaresMatch) -> LeastSquaresMatch:
    """Return the match where the robot may be after a gap, or `best` if none fits better.

    Around the predicted pose a window as wide as the odometry may be wrong is searched, and a small
    one around what else it may have reported.

    Parameters
    ----------
    best : the match near the prediction.
    """
    error = _error_of(fit)
    tried: list[Pose] = []
    for pose in fit.prediction.after_gap:
        if any(_are_same(pose, other) for other in tried):
            continue
        reach = fit.settings.window.linear_search_window if tried else error
        tried.append(pose)
        window = fit.settings.lost_window.model_copy(
            update={"linear_search_window": reach, "angular_search_window_deg": WINDOW_DEG}
        )
        centre = fit.in_submap(pose)
        found = fit.refine_freely(fit.search(centre, window))
        if _is_better(fit, found, best, _unlikeliness(found, centre, error)):
            best = found
    return best


def _is_better(
    fit: ScanFit, found: LeastSquaresMatch, best: LeastSquaresMatch, unlikeliness: float
) -> bool:
    """Return whether a match fits better than another, also what is in observed cells."""
    seen = fit.residual_of_seen(best)
    share = MAX_RESIDUAL_SHARE if seen else MAX_UNSEEN_SHARE
    gain = fit.cost_of_points(best) - fit.cost_of_points(found)
    return (
        found.residual < share * best.residual
        and gain > unlikeliness
        and fit.is_determined(found)
        and (seen == 0.0 or fit.residual_of_seen(found) < seen)
    )


def _unlikeliness(match: LeastSquaresMatch, centre: Pose, error: float) -> float:
    """Return the chi square of a match against where the odometry may have led."""
    apart = relative(centre, match.tf_submap_scan)
    return (apart.x**2 + apart.y**2) / error**2 + (apart.theta / ERROR_RAD) ** 2


def _error_of(fit: ScanFit) -> float:
    """Return the error that the odometry may have made in a gap [m]."""
    last, _ = fit.prediction.fallbacks()
    pose = fit.prediction.tf_local_tracking
    moved = math.hypot(pose.x - last.x, pose.y - last.y)
    return min(max(ERROR_SHARE * moved, LEAST_ERROR_M), MAX_ERROR_M)


def _are_same(one: Pose, other: Pose) -> bool:
    step = relative(one, other)
    return math.hypot(step.x, step.y) <= SAME_M and abs(step.theta) <= SAME_RAD
