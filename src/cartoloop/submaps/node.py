# SPDX-License-Identifier: Apache-2.0
"""The record of an inserted scan, by which local SLAM passes it to global SLAM."""

from __future__ import annotations

from dataclasses import dataclass

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
