# SPDX-License-Identifier: Apache-2.0
"""What a match hardly determines: the position along a corridor, the heading beside a box."""

from __future__ import annotations

import math

from cartoloop.arrays import FloatArray
from cartoloop.config import PredictionConfig
from cartoloop.scan_matching.least_squares import LeastSquaresMatch
from cartoloop.sensor.pose import Pose, wrap_angle

OPEN_FACTOR, DETERMINED_FACTOR = 5.0, 2.5
"""A match far from where odometry leads must determine where it is: its curvature along a direction
must be this many times what pixel noise alone makes. The second is that of one near it, from which
it says something about the odometry."""

ASIDE_SHARE, LEVER_M = 0.25, 1.0
"""Otherwise it may differ from odometry only along that direction: by up to this share across it,
and by its turn, which counts as the motion of a point at the second distance [m]."""

MIN_HEADING_INFORMATION = 500.0
"""Curvature over the heading, at the best position for each, from which a match shows the heading
[1/rad^2]. Scans of rooms have thousands, those of a box in an empty hall tens."""


def constrain_degenerate_direction(
    match: LeastSquaresMatch,
    prior: Pose,
    prior_information: FloatArray,
    point_weight: float,
    config: PredictionConfig,
    pixel_information: float = 0.0,
) -> Pose:
    """Return the pose of a match, moved towards the prior along its degenerate direction.

    Along a featureless corridor, pixel noise adds to (CS) a curvature that is a share of the
    curvature across it and attracts the scan to where the map happens to be rough. That share is
    not information: it is subtracted, and the rest is weighted against the prior again.

    Parameters
    ----------
    prior, prior_information : the motion prior; information as upper triangle, shape (6,).
    point_weight : factor of the points' information.
    pixel_information : information that the pixel noise is credited with [1/m^2].
    """
    weak, strong, direction = _axes(match)
    ratio = weak / strong if strong > 0.0 else 0.0
    if not 0.0 < ratio < 1.0:
        return match.tf_submap_scan
    seeming = point_weight * ratio * strong
    true = point_weight * max(ratio - config.spurious_information, 0.0) * strong
    true = min(seeming, true + pixel_information)
    cos, sin = math.cos(direction), math.sin(direction)
    pose = match.tf_submap_scan
    along = cos * (pose.x - prior.x) + sin * (pose.y - prior.y)
    trust = float(prior_information[0])
    trust = trust / (1.0 + along * along * trust / config.failure_scale**2)
    kept = true / (true + trust) * (seeming + trust) / seeming
    back = (min(kept, 1.0) - 1.0) * along
    return Pose(pose.x + back * cos, pose.y + back * sin, pose.theta)


def degenerate_direction(match: LeastSquaresMatch) -> tuple[float, float]:
    """Return the ratio of the eigenvalues of a match's translation, and the weaker's direction.

    A small ratio indicates a corridor: the scan hardly determines the position along the direction
    [rad, grid axes].
    """
    weak, strong, direction = _axes(match)
    return weak / strong if strong > 0.0 else 0.0, direction


def _axes(match: LeastSquaresMatch) -> tuple[float, float, float]:
    """Return the eigenvalues of a match's translation, and the direction of the smaller one."""
    (xx, xy, _), (_, yy, _), _ = match.information.tolist()
    mean, half = 0.5 * (xx + yy), math.hypot(0.5 * (xx - yy), xy)
    direction = 0.5 * math.atan2(2.0 * xy, xx - yy) + 0.5 * math.pi
    return max(mean - half, 0.0), mean + half, direction


def shows_heading(match: LeastSquaresMatch) -> bool:
    """Return whether a match determines the heading, whatever the position is.

    A single box determines it only as far as the odometry knows the position.
    """
    (xx, xy, xt), (_, yy, yt), (_, _, tt) = match.information.tolist()
    determinant = xx * yy - xy * xy
    if determinant <= 0.0:
        return False
    by_position = (xt * xt * yy - 2.0 * xt * yt * xy + yt * yt * xx) / determinant
    return bool(tt - by_position >= MIN_HEADING_INFORMATION)


def is_determined(ratio: float, spurious_information: float) -> bool:
    """Return whether a match near the prior determines the position in all directions.

    Parameters
    ----------
    ratio : of the eigenvalues of its translation.
    spurious_information : share of the curvature that pixel noise alone makes.
    """
    return ratio > DETERMINED_FACTOR * spurious_information


def leaves_direction_open(match: LeastSquaresMatch, spurious_information: float) -> bool:
    """Return whether a match far from the prior leaves a direction open, as along a corridor.

    Parameters
    ----------
    spurious_information : share of the curvature that pixel noise alone makes.
    """
    return degenerate_direction(match)[0] <= OPEN_FACTOR * spurious_information


def where_prior_leads(match: LeastSquaresMatch, prior: Pose, spurious_information: float) -> Pose:
    """Return the pose of a match, moved along the direction that it leaves open to the prior.

    Between bare walls a scan fits as well where the robot was before the recording paused. A prior
    that is wrong across them, or turned, is not believed along them.

    Parameters
    ----------
    match : far from the prior.
    prior : pose by odometry, in the same frame.
    spurious_information : share of the curvature that pixel noise alone makes.
    """
    pose = match.tf_submap_scan
    if not leaves_direction_open(match, spurious_information):
        return pose
    _, direction = degenerate_direction(match)
    cos, sin = math.cos(direction), math.sin(direction)
    x, y = prior.x - pose.x, prior.y - pose.y
    along, across = cos * x + sin * y, cos * y - sin * x
    turn = wrap_angle(prior.theta - pose.theta)
    if math.hypot(across, LEVER_M * turn) > ASIDE_SHARE * abs(along):
        return pose
    return Pose(pose.x + along * cos, pose.y + along * sin, pose.theta)
