# SPDX-License-Identifier: Apache-2.0
"""Where the drift may place a node in submaps: the windows that are searched for it."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from cartoloop._jit import kernel
from cartoloop.arrays import FloatArray, IntArray


class WindowRule(NamedTuple):
    """How large a search window is.

    Attributes
    ----------
    num_sigmas : standard deviations of the drift that it holds.
    least_linear, least_angular : added to these [m], [rad].
    translation_variance, rotation_variance : of the path from the node to the vertex whose drift is
        known [m^2], [rad^2].
    """

    num_sigmas: float
    least_linear: float
    least_angular: float
    translation_variance: float
    rotation_variance: float


@kernel
def drift_windows(
    submaps: IntArray,
    drift: FloatArray,
    node_pose: tuple[float, float, float],
    submap_poses: FloatArray,
    boxes: FloatArray,
    rule: tuple[float, float, float, float, float],
    out_windows: FloatArray,
) -> int:
    """Write the window of a node in each of some submaps; return in how many it is within reach.

    Parameters
    ----------
    submaps : int64, shape (k,), their indices.
    drift : float64, shape (m, 3, 3), covariance of the pose of each submap, map axes.
    node_pose : expected, map frame [m, m, rad].
    submap_poses : float64, shape (m, 3), map frame [m, m, rad].
    boxes : float64, shape (m, 4), x and y of the least and the greatest corner of each grid, submap
        frame [m].
    rule : fields of a :class:`WindowRule`.
    out_windows : float64, shape (k, 6): where the graph expects the node, tf_submap_node
        [m, m, rad]; the window around it [m], [rad]; and its distance from the middle of the grid
        as a share of the window, infinite where that meets no part of the grid.

    Notes
    -----
    The window is as wide as the drift along its larger axis. A turn of the submap displaces the
    node in proportion to its distance.
    """
    x, y, theta = node_pose
    limits = WindowRule(rule[0], rule[1], rule[2], rule[3], rule[4])
    num_in_reach = 0
    for k in range(submaps.shape[0]):
        i = submaps[k]
        at_x, at_y, at_theta = submap_poses[i, 0], submap_poses[i, 1], submap_poses[i, 2]
        dx, dy = x - at_x, y - at_y
        tt = drift[i, 2, 2]
        xx = drift[i, 0, 0] - 2.0 * dy * drift[i, 0, 2] + dy * dy * tt
        xy = drift[i, 0, 1] + dx * drift[i, 0, 2] - dy * drift[i, 1, 2] - dx * dy * tt
        yy = drift[i, 1, 1] + 2.0 * dx * drift[i, 1, 2] + dx * dx * tt
        largest = 0.5 * (xx + yy) + math.hypot(0.5 * (xx - yy), xy)
        sigma_m = math.sqrt(largest + limits.translation_variance)
        linear = limits.least_linear + limits.num_sigmas * sigma_m
        sigma_rad = math.sqrt(tt + limits.rotation_variance)
        angular = limits.least_angular + limits.num_sigmas * sigma_rad
        cos, sin = math.cos(at_theta), math.sin(at_theta)
        node_x, node_y = cos * dx + sin * dy, cos * dy - sin * dx
        low_x, low_y, high_x, high_y = boxes[i, 0], boxes[i, 1], boxes[i, 2], boxes[i, 3]
        outside_x = max(low_x - node_x, node_x - high_x, 0.0)
        outside_y = max(low_y - node_y, node_y - high_y, 0.0)
        share = math.inf
        if math.hypot(outside_x, outside_y) <= linear:
            off_x, off_y = node_x - 0.5 * (low_x + high_x), node_y - 0.5 * (low_y + high_y)
            share = math.hypot(off_x, off_y) / linear
            num_in_reach += 1
        out_windows[k, 0], out_windows[k, 1] = node_x, node_y
        turn = theta - at_theta
        out_windows[k, 2] = turn - math.tau * np.rint(turn / math.tau)
        out_windows[k, 3], out_windows[k, 4], out_windows[k, 5] = linear, angular, share
    return num_in_reach
