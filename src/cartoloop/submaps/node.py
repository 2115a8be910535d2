# SPDX-License-Identifier: Apache-2.0
"""The record of an inserted scan, by which local SLAM passes it to global SLAM."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cartoloop.arrays import FloatArray
from cartoloop.sensor.pose import Pose
from cartoloop.submaps.submap import Submap


@dataclass(frozen=True, slots=True)
class Node:
    """A scan in the pose graph.

    Attributes
    ----------
    index : its number among the nodes.
    time : of the scan [s].
    tf_local_tracking : its pose before loop closure.
    points : float64, shape (n, 2), its returns [m], tracking frame, filtered for matching.
    submaps : those that it was inserted into.
    information : float64, shape (3, 3), of the match to the oldest of `submaps`, local axes.
    finished : the submap that it finished, or None.
    """

    index: int
    time: float
    tf_local_tracking: Pose
    points: FloatArray
    submaps: tuple[Submap, ...]
    information: FloatArray
    finished: Submap | None


MIN_ROTATION_INFORMATION = 1e4
"""A match that determines the heading less well shows no place [1/rad^2]: 0.6 degrees."""

BEGINNING_INFORMATION = np.diag((1e4, 1e4, 1e5))
"""Information of a node in the submap that it begins, which is where it is [1/m^2, 1/rad^2]."""

LOST_ROTATION_INFORMATION = 5.0
"""A heading that is known less well is that of a robot that was lost [1/rad^2]: 0.45 rad. Odometry
knows it better after any gap or stretch, also as weighted in the pose graph."""


def shows_place(information: FloatArray) -> bool:
    """Return whether a match shows where in the submap a scan is.

    Parameters
    ----------
    information : float64, shape (3, 3).
    """
    return float(information[2, 2]) >= MIN_ROTATION_INFORMATION


def is_lost(information: FloatArray) -> bool:
    """Return whether nothing says where a node is: it follows a gap in which nothing was measured.

    Matches that say as little are of scans with few returns, whose place the odometry knows. Their
    information is not diagonal.

    Parameters
    ----------
    information : float64, shape (3, 3).
    """
    if not 0.0 < information[2, 2] < LOST_ROTATION_INFORMATION:
        return False
    return int(np.count_nonzero(information)) == np.count_nonzero(np.diagonal(information))


def information_in_begun(information: FloatArray) -> FloatArray:
    """Return the information of a node in a submap that it begins, shape (3, 3).

    Parameters
    ----------
    information : in the older submap, shape (3, 3). What is uncertain about it is where the new one
        is, not where the node is in it.
    """
    return information if shows_place(information) else BEGINNING_INFORMATION
