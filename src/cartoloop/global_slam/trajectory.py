# SPDX-License-Identifier: Apache-2.0
"""The adjusted pose of every scan, from the adjusted poses of the nodes."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from cartoloop.arrays import FloatArray
from cartoloop.sensor.pose import wrap_angles

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
    Between two nodes the path is that of the local poses, whose steps are turned by an even share
    of what the nodes are turned by, and moved by an even share of what is then missing. So a
    constant error of the odometry's heading is undone where a robot sees no walls for long; shares
    of the poses alone would leave an arc. Before the first node and after the last one the path is
    moved with that node.
    """
    if len(node_scan_index) == 0 or len(local) == 0:
        return local.copy()
    scans = np.arange(len(local))
    after = np.searchsorted(node_scan_index, scans, side="left")
    before = np.clip(np.searchsorted(node_scan_index, scans, side="right") - 1, 0, None)
    after = np.minimum(after, len(node_scan_index) - 1)
    first, last = node_scan_index[before], node_scan_index[after]
    share = _shares(local, first, last)
    turn = node_poses[:, 2] - local[node_scan_index, 2]  # tf_map_local at each node
    turned = turn[before] + share * wrap_angles(turn[after] - turn[before])
    path = _turned_path(local, turned)
    begin, end = node_poses[before, :2], node_poses[after, :2]
    places = begin + path - path[first]
    is_between = last > first  # otherwise the path is moved with the only node next to it
    missed = np.where(is_between[:, np.newaxis], end - begin - (path[last] - path[first]), 0.0)
    trajectory = np.column_stack((places + share[:, np.newaxis] * missed, local[:, 2] + turned))
    trajectory[:, 2] = wrap_angles(trajectory[:, 2])
    trajectory[node_scan_index] = node_poses
    return trajectory


def _shares(local: FloatArray, first: NDArray[np.int64], last: NDArray[np.int64]) -> FloatArray:
    """Return which share of the path between two scans lies before each scan, shape (n,).

    A radian of a turn counts as much as a metre. Where the robot stands, scans are counted.
    """
    steps = np.diff(local, axis=0)
    travelled = np.zeros(len(local))
    travelled[1:] = np.cumsum(np.hypot(steps[:, 0], steps[:, 1]) + np.abs(wrap_angles(steps[:, 2])))
    whole = travelled[last] - travelled[first]
    by_path = (travelled - travelled[first]) / np.where(whole > 0.0, whole, 1.0)
    by_scans = np.where(
        last > first, (np.arange(len(local)) - first) / np.maximum(last - first, 1), 0.0
    )
    return np.where(whole > 0.0, by_path, by_scans)


def _turned_path(local: FloatArray, turned: FloatArray) -> FloatArray:
    """Return the places that local poses lead to, each step turned, shape (n, 2); from (0, 0) on.

    Parameters
    ----------
    turned : angle at each scan, shape (n,); a step is turned by the mean of both its ends [rad].
    """
    angles = turned[:-1] + 0.5 * wrap_angles(np.diff(turned))
    cos, sin = np.cos(angles), np.sin(angles)
    x, y = np.diff(local[:, :2], axis=0).T
    path = np.zeros((len(local), 2))
    path[1:] = np.cumsum(np.column_stack((cos * x - sin * y, sin * x + cos * y)), axis=0)
    return path


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
