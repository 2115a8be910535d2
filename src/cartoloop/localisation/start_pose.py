# SPDX-License-Identifier: Apache-2.0
"""A pose to begin with: given by a user, or kept from the last run."""

from __future__ import annotations

import math
from typing import NamedTuple

from cartoloop.local_slam.degenerate_direction import degenerate_direction, is_determined
from cartoloop.localisation.claim_needs import PLAUSIBLE_DISTINCTNESS
from cartoloop.localisation.decision import Claim
from cartoloop.localisation.global_search import FoundPlace, find_near, refine
from cartoloop.localisation.known_map import KnownMap
from cartoloop.localisation.trail import Composite
from cartoloop.sensor.pose import Pose, compose, relative

START_WINDOW_M, START_WINDOW_RAD = 1.0, math.radians(20.0)
"""Window around a given pose [m], [rad]."""

START_SCORE = 0.75
"""Score from which a pose to begin with is believed, relative to the usual one."""

CERTAIN_AGREEMENT, KEPT_AGREEMENT = 0.7, 0.88
"""The same for the agreement: of a user's pose, and of one that was kept."""


class StartPose(NamedTuple):
    """A pose to begin with.

    Attributes
    ----------
    tf_map_tracking : of the robot.
    is_certain : whether a user gave it; otherwise the scan must show the place by itself.
    tf_odom_tracking : the odometry's pose then, if it has continued; None: not known.
    before : where a scan last showed the robot, which may have stood since; None: not known.
    """

    tf_map_tracking: Pose
    is_certain: bool
    tf_odom_tracking: Pose | None = None
    before: Pose | None = None

    def poses(self, tf_odom_tracking: Pose | None) -> list[Pose]:
        """Return the poses to try, given the odometry's pose now."""
        then, first = self.tf_odom_tracking, self.tf_map_tracking
        poses = [first] if self.before is None else [first, self.before]
        if then is None or tf_odom_tracking is None:
            return poses
        return [compose(first, relative(then, tf_odom_tracking)), *poses]


def claim_near(
    known: KnownMap,
    composite: Composite,
    start: StartPose,
    tf_odom_tracking: Pose | None,
    spurious_information: float,
) -> Claim | None:
    """Return the best place around a pose to begin with if the scan fits there.

    A scan of bare walls fits all along them: it does not show that a kept pose still holds. What
    stands at the walls must be there as well.

    Parameters
    ----------
    composite : a single scan.
    tf_odom_tracking : the odometry's pose now, None without any.
    spurious_information : share of the curvature of a match that pixel noise alone makes.
    """
    best: FoundPlace | None = None
    for pose in start.poses(tf_odom_tracking):
        found = find_near(
            known, composite.points, pose, START_WINDOW_M, START_WINDOW_RAD,
            START_SCORE * known.usual.score,
        )  # fmt: skip
        if found is not None and (best is None or found.score > best.score):
            best = found
    if best is None:
        return None
    match = refine(known, composite.points, best.tf_map_tracking)
    pose = known.to_map(match.tf_submap_scan)
    x, y = composite.beam_origins[0].tolist()
    fit = known.fit(composite.points, Pose(x, y, 0.0), pose)
    if start.is_certain:
        return Claim(pose) if fit.agreement >= CERTAIN_AGREEMENT * known.usual.agreement else None
    is_distinct = fit.distinctness >= PLAUSIBLE_DISTINCTNESS * known.low_distinctness
    is_open = not is_determined(degenerate_direction(match)[0], spurious_information)
    if is_open or not is_distinct:
        return None
    return Claim(pose) if fit.agreement >= KEPT_AGREEMENT * known.usual.agreement else None
