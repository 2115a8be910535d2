# SPDX-License-Identifier: Apache-2.0
"""The record through which local SLAM tells global SLAM of a scan that was inserted."""

from __future__ import annotations

from dataclasses import dataclass

from cartoloop.sensor.pose import FloatArray, Pose
from cartoloop.submaps.submap import Submap


@dataclass(frozen=True, slots=True)
class Node:
    """A scan in the pose graph.

    Attributes
    ----------
    index : its number among the nodes.
    time : when it was taken [s].
    tf_local_tracking : its pose before loop closure.
    points : float64, shape (n, 2), its returns [m], tracking frame, filtered for matching.
    submaps : those it was inserted into.
    information : float64, shape (3, 3), of the match to the oldest of `submaps`, local axes.
    finished : the submap that it completed, or None.
    """

    index: int
    time: float
    tf_local_tracking: Pose
    points: FloatArray
    submaps: tuple[Submap, ...]
    information: FloatArray
    finished: Submap | None
