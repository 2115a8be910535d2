# SPDX-License-Identifier: Apache-2.0
"""The last pass over a finished run: every node is matched again to the submaps that it overlaps.

From poses that are already close, a search is not needed: (CS) alone finds the match, and tells
more exactly than the closures found while mapping how node and submap stand.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from cartoloop.config import ConstraintSearchConfig
from cartoloop.global_slam.closure_search import LEVER_M, refine_all
from cartoloop.global_slam.finished_submap import FinishedSubmap
from cartoloop.global_slam.loop_closure import CLOSURE, NO_CLOSURES, Closures, IntArray
from cartoloop.scan_matching.match_information import match_informations
from cartoloop.sensor.pose import FloatArray, relative_all
from cartoloop.sensor.scan_points import ScanPoints


def overlapping_nodes(
    submap: FinishedSubmap,
    tf_map_submap: FloatArray,
    node_poses: FloatArray,
    inserted: set[int],
    every: int,
) -> IntArray:
    """Return one in `every` of the nodes that stand within a submap's grid, but are not in it."""
    grid = submap.grid
    seen = relative_all(tf_map_submap, node_poses)
    height, width = grid.shape
    x, y = seen[:, 0] - grid.origin_x, seen[:, 1] - grid.origin_y
    inside = (x > 0.0) & (y > 0.0) & (x < width * grid.resolution) & (y < height * grid.resolution)
    nodes = np.flatnonzero(inside)
    nodes = nodes[(nodes + submap.index) % every == 0]
    others: IntArray = nodes[np.isin(nodes, np.fromiter(inserted, np.int64), invert=True)]
    return others


def in_nearest_submaps(
    overlapping: Sequence[IntArray], submap_poses: FloatArray, node_poses: FloatArray, limit: int
) -> list[IntArray]:
    """Return the nodes that overlap each submap, without those of which `limit` others are nearer.

    Where the robot returns again and again, submaps lie on top of each other, and a match to each
    of them would take ever longer without telling more.

    Parameters
    ----------
    overlapping : of each submap, the nodes that overlap it.
    submap_poses, node_poses : shapes (m, 3), (n, 3), of all.
    """
    counts = [len(nodes) for nodes in overlapping]
    nodes, submaps = np.concatenate(overlapping), np.repeat(np.arange(len(counts)), counts)
    apart = node_poses[nodes, :2] - submap_poses[submaps, :2]
    nearest_first = np.lexsort((submaps, np.hypot(apart[:, 0], apart[:, 1]), nodes))
    of_node = nodes[nearest_first]
    rank = np.arange(len(nodes)) - np.searchsorted(of_node, of_node)
    is_near = np.empty(len(nodes), dtype=bool)
    is_near[nearest_first] = rank < limit
    parts = np.split(is_near, np.cumsum(counts)[:-1])
    return [nodes[near] for nodes, near in zip(overlapping, parts, strict=True)]


def match_again(
    submap: FinishedSubmap,
    tf_map_submap: FloatArray,
    nodes: IntArray,
    node_poses: FloatArray,
    node_points: ScanPoints,
    config: ConstraintSearchConfig,
) -> Closures:
    """Return the nodes that fit the submap near where they stand.

    Their score is 1 less the root mean square of 1 - M_smooth at the points: no more than the mean
    probability. No runner-up is sought.

    Parameters
    ----------
    tf_map_submap : shape (3,).
    nodes : indices of those to match.
    node_poses : shape (n, 3), of all nodes.
    node_points : the returns of all nodes.
    """
    nodes = nodes[node_points.take(nodes).counts >= config.min_num_points]
    if len(nodes) == 0:
        return NO_CLOSURES
    estimates = relative_all(tf_map_submap, node_poses[nodes])
    matches = refine_all(
        submap.smooth_map,
        node_points.take(nodes),
        estimates,
        config,
        config.max_start_residual,
    )
    moved = matches.tf_submap_scan - estimates
    # Where not even its own scans fit a submap well, no more is asked of others.
    sparse = max(config.min_score - config.min_score_ratio * submap.own_score, 0.0)
    max_residual = config.max_refined_residual + sparse
    fits = (
        (matches.residual <= max_residual)
        & (np.hypot(moved[:, 0], moved[:, 1]) <= config.max_refinement)
        & (np.abs(moved[:, 2]) <= config.max_refinement / LEVER_M)
    )
    fitting = np.flatnonzero(fits)
    closures = np.zeros(len(fitting), CLOSURE)
    closures["submap"], closures["node"] = submap.index, nodes[fitting]
    closures["tf_submap_node"] = matches.tf_submap_scan[fitting]
    closures["information"] = match_informations(
        matches.information[fitting], matches.residual[fitting]
    )
    closures["score"] = 1.0 - matches.residual[fitting]
    closures["runner_up"] = math.nan
    return closures
