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

ERROR_SHARE, MAX_ERROR_M = 0.2, 1.0
"""Error of the odometry in a gap, as a share of the distance that it reports, and its limit [m]."""

MAX_RESIDUAL_SHARE = 0.97
"""Largest residual of a match, as a share of that near the prediction. Scans after a gap show much
that is new, and hardly ever fit as usual, but the right place fits best."""

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
    window = fit.settings.window
    tried: list[Pose] = []
    for pose in fit.prediction.after_gap:
        if any(_are_same(pose, other) for other in tried):
            continue
        reach = window.linear_search_window if tried else _possible_error(fit)
        tried.append(pose)
        around = fit.settings.lost_window.model_copy(update={"linear_search_window": reach})
        found = fit.refine_freely(fit.search(fit.in_submap(pose), around))
        if _is_better(fit, found, best):
            best = found
    return best


def _is_better(fit: ScanFit, found: LeastSquaresMatch, best: LeastSquaresMatch) -> bool:
    """Return whether a match fits better than another, also what is in observed cells."""
    seen = fit.residual_of_seen(best)
    return (
        found.residual < MAX_RESIDUAL_SHARE * best.residual
        and fit.is_determined(found)
        and (seen == 0.0 or fit.residual_of_seen(found) < seen)
    )


def _possible_error(fit: ScanFit) -> float:
    """Return the error that the odometry may have made in a gap [m]."""
    last, _ = fit.prediction.fallbacks()
    pose = fit.prediction.tf_local_tracking
    moved = math.hypot(pose.x - last.x, pose.y - last.y)
    least = fit.settings.lost_window.linear_search_window
    return min(max(ERROR_SHARE * moved, least), MAX_ERROR_M)


def _are_same(one: Pose, other: Pose) -> bool:
    step = relative(one, other)
    return math.hypot(step.x, step.y) <= SAME_M and abs(step.theta) <= SAME_RAD
