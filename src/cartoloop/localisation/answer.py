# SPDX-License-Identifier: Apache-2.0
"""What a localiser answers to a scan."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import NamedTuple

from cartoloop.arrays import FloatArray
from cartoloop.sensor.pose import Pose


class State(StrEnum):
    """What a localiser knows.

    SEARCHING : no place of the map fits, or the scans so far say too little.
    AMBIGUOUS : several places fit.
    LOCATED : the place is known.
    LOST : the place was known, and the scans contradict it now.
    """

    SEARCHING = "searching"
    AMBIGUOUS = "ambiguous"
    LOCATED = "located"
    LOST = "lost"


class Place(NamedTuple):
    """A place where the robot may be.

    Attributes
    ----------
    tf_map_tracking : its pose there.
    probability : that it is there rather than in another place of the map; the rest is for places
        that are not listed, and for none.
    score : mean probability at the returns.
    """

    tf_map_tracking: Pose
    probability: float
    score: float


@dataclass(frozen=True, eq=False)
class Answer:
    """The answer to one scan.

    Attributes
    ----------
    stamp : of the scan [s].
    state : what is known.
    tf_map_tracking : pose of the robot, map frame; None unless located.
    covariance : float64, shape (3, 3), of x, y, theta in the map frame [m^2, m rad, rad^2]; None
        unless located.
    tf_local_tracking : its pose in the local frame, which drifts, and begins again after `LOST`.
    score : mean probability of the map at the returns of the scan; NaN unless located.
    runner_up : score of the best other place when the whole map was last searched, or an upper
        limit of it; NaN before.
    agreement : share of the returns on walls, of those where the map is known; NaN unless located.
    places : where the robot may be while it is not located, the likeliest first.
    """

    stamp: float
    state: State
    tf_map_tracking: Pose | None
    covariance: FloatArray | None
    tf_local_tracking: Pose
    score: float
    runner_up: float
    agreement: float
    places: tuple[Place, ...] = ()
