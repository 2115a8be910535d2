# SPDX-License-Identifier: Apache-2.0
"""Where a scan is searched that fits nowhere after a gap in the recording.

What wheels are wrong by grows with the motion in the gap, which may be metres. And readings next to
it may have been buffered, so that a part of the motion is reported before or after it.
"""

from __future__ import annotations

import math

from cartoloop.local_slam.gap import Gap
from cartoloop.local_slam.scan_fit import ScanFit
from cartoloop.scan_matching.least_squares import LeastSquaresMatch
from cartoloop.sensor.pose import Pose, relative

WINDOW_ERRORS = 5.0
"""How far from the predicted heading is searched, in errors of it."""

MAX_RESIDUAL_SHARE, MAX_UNSEEN_SHARE = 0.97, 0.92
"""Largest residual of a match, as a share of that near the prediction, and where nothing has been
observed there: any overlap with the map fits better. Scans after a gap show much that is new, and
hardly ever fit as usual, but the right place fits best."""

MAX_TURNED_SHARE = 0.8
"""The same at headings that only a turn in the gap explains. Of such matches in recordings of three
buildings, the right ones had 0.5 to 0.76 (two 0.88 and 0.89), the wrong ones 0.83 and more."""

SAME_M, SAME_RAD = 0.1, math.radians(5.0)
"""Poses that differ by no more are searched once [m], [rad]."""


def search_after_gap(fit: ScanFit, best: LeastSquaresMatch, gap: Gap) -> LeastSquaresMatch:
    """Return the match where the robot may be after a gap, or `best` if none fits better.

    Around the predicted pose a window as wide as its error is searched, and a small one around what
    else the odometry may have reported; then the same at more headings if the robot may have turned
    on.

    Parameters
    ----------
    best : the match near the prediction.
    gap : before the scan.
    """
    best = _search(fit, best, gap, gap.angular_error)
    return best if gap.turn_error <= gap.angular_error else _search(fit, best, gap, gap.turn_error)


def _search(
    fit: ScanFit, best: LeastSquaresMatch, gap: Gap, angular_error: float
) -> LeastSquaresMatch:
    """Return the match around the poses of a gap whose headings have some error, or `best`."""
    settings = fit.settings
    tried: list[Pose] = []
    for pose in gap.poses:
        if any(_are_same(pose, other) for other in tried):
            continue
        reach = settings.window.linear_search_window if tried else gap.linear_error
        tried.append(pose)
        window = settings.lost_window.model_copy(
            update={
                "linear_search_window": reach,
                "angular_search_window_deg": math.degrees(WINDOW_ERRORS * angular_error),
            }
        )
        centre = fit.in_submap(pose)
        found = fit.refine_freely(fit.search(centre, window))
        apart = relative(centre, found.tf_submap_scan)
        chi_square = (apart.x**2 + apart.y**2) / gap.linear_error**2
        chi_square += (apart.theta / angular_error) ** 2
        is_turned = abs(apart.theta) > WINDOW_ERRORS * gap.angular_error
        if _is_better(fit, found, best, chi_square, is_turned=is_turned):
            best = found
    return best


def _is_better(
    fit: ScanFit,
    found: LeastSquaresMatch,
    best: LeastSquaresMatch,
    chi_square: float,
    *,
    is_turned: bool,
) -> bool:
    """Return whether a match fits better than another, also what is in observed cells.

    Parameters
    ----------
    chi_square : of its pose, against where the robot was expected.
    is_turned : whether its heading is explained by a turn in the gap alone.
    """
    seen = fit.residual_of_seen(best)
    share = MAX_RESIDUAL_SHARE if seen else MAX_UNSEEN_SHARE
    if is_turned:
        share = MAX_TURNED_SHARE
    return (
        found.residual < share * best.residual
        and fit.cost_of_points(best) - fit.cost_of_points(found) > chi_square
        and fit.is_determined(found)
        and (seen == 0.0 or fit.residual_of_seen(found) < seen)
    )


def _are_same(one: Pose, other: Pose) -> bool:
    step = relative(one, other)
    return math.hypot(step.x, step.y) <= SAME_M and abs(step.theta) <= SAME_RAD
