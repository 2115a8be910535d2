# SPDX-License-Identifier: Apache-2.0
"""The adjusted pose of every scan, from the adjusted poses of the nodes."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from cartoloop.arrays import FloatArray
from cartoloop.sensor.pose import compose_all, relative_all, wrap_angles

STRIDE_M = 0.1
"""Shortest step that adds to the path length [m]: shorter ones are noise of the poses."""


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
    The pose of a scan is interpolated linearly between its local pose relative to the node before
    and that relative to the node after, by the number of scans.
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
    """Return the length of a path [m], in steps of at least :data:`STRIDE_M`.

    Shorter steps are noise: the matched poses of a robot at rest differ a little from scan to scan,
    and so do those of different scanners.
    """
    length, here = 0.0, 0
    places = trajectory[:, :2].tolist()
    for there in range(1, len(places)):
        stride = math.dist(places[here], places[there])
        if stride >= STRIDE_M or there == len(places) - 1:
            length, here = length + stride, there
    return length
