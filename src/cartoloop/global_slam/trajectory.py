# SPDX-License-Identifier: Apache-2.0
"""A pose for every scan: scans between two nodes move with both."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from cartoloop.arrays import FloatArray
from cartoloop.sensor.pose import compose_all, relative_all, wrap_angles

STRIDE_M = 0.1
"""A robot's way is measured from one place to the next that is so far away."""


def optimized_trajectory(
    local: FloatArray, node_scan_index: NDArray[np.int64], node_poses: FloatArray
) -> FloatArray:
    """Return tf_map_tracking of each scan, shape (n, 3).

    Parameters
    ----------
    local : tf_local_tracking of each scan, shape (n, 3).
    node_scan_index : increasing, shape (k,): which scan each node is.
    node_poses : tf_map_node, shape (k, 3).

    Notes
    -----
    A scan keeps its local pose relative to the node before and to the node after; where the two
    disagree, the share of each falls linearly with the number of scans in between.
    """
    if len(node_scan_index) == 0 or len(local) == 0:
        return local.copy()
    scans = np.arange(len(local))
    after = np.searchsorted(node_scan_index, scans, side="left")
    before = np.clip(np.searchsorted(node_scan_index, scans, side="right") - 1, 0, None)
    after = np.minimum(after, len(node_scan_index) - 1)
    first, last = node_scan_index[before], node_scan_index[after]
    by_before = compose_all(node_poses[before], relative_all(local[first], local))
    by_after = compose_all(node_poses[after], relative_all(local[last], local))
    share = np.where(last > first, (scans - first) / np.maximum(last - first, 1), 0.0)[
        :, np.newaxis
    ]
    difference = by_after - by_before
    difference[:, 2] = wrap_angles(difference[:, 2])
    trajectory = by_before + share * difference
    trajectory[:, 2] = wrap_angles(trajectory[:, 2])
    return trajectory


def path_length(trajectory: FloatArray) -> float:
    """Return how far the robot went [m], in strides of :data:`STRIDE_M`.

    The poses of a robot that stands, or of one whose scanners see each their own way, differ by a
    little from scan to scan; that is no way.
    """
    length, here = 0.0, 0
    places = trajectory[:, :2].tolist()
    for there in range(1, len(places)):
        stride = math.dist(places[here], places[there])
        if stride >= STRIDE_M or there == len(places) - 1:
            length, here = length + stride, there
    return length
