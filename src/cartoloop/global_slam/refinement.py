# SPDX-License-Identifier: Apache-2.0
"""The last pass over a finished run: every node is matched again to the submaps that it overlaps.

From poses that are already close, a search is not needed: (CS) alone finds the match, and tells
more exactly than the closures found while mapping how node and submap stand.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from cartoloop.config import ConstraintSearchConfig
from cartoloop.global_slam.loop_closure import LoopClosure, refine
from cartoloop.scan_matching.match_information import match_information
from cartoloop.sensor.pose import FloatArray, Pose, relative, relative_all, wrap_angle

if TYPE_CHECKING:
    from cartoloop.global_slam.constraint_search import FinishedSubmap


def overlapping_nodes(
    submap: FinishedSubmap,
    tf_map_submap: FloatArray,
    node_poses: FloatArray,
    inserted: set[int],
    every: int,
) -> list[int]:
    """Return one in `every` of the nodes that stand within a submap's grid, but are not in it."""
    grid = submap.grid
    seen = relative_all(tf_map_submap, node_poses)
    height, width = grid.cells.shape
    x, y = seen[:, 0] - grid.origin_x, seen[:, 1] - grid.origin_y
    inside = (x > 0.0) & (y > 0.0) & (x < width * grid.resolution) & (y < height * grid.resolution)
    return [
        node
        for node in np.flatnonzero(inside).tolist()
        if (node + submap.index) % every == 0 and node not in inserted
    ]


def match_again(
    submap: FinishedSubmap,
    tf_map_submap: FloatArray,
    nodes: Sequence[int],
    node_poses: FloatArray,
    points: Sequence[FloatArray],
    config: ConstraintSearchConfig,
) -> list[LoopClosure]:
    """Return the nodes that fit the submap near where they stand.

    Parameters
    ----------
    tf_map_submap : shape (3,).
    nodes : indices of those to match.
    node_poses : shape (n, 3), of all nodes.
    points : of all nodes.
    """
    found = []
    origin = Pose(*tf_map_submap.tolist())
    for node in nodes:
        if len(points[node]) < config.min_num_points:
            continue
        estimate = relative(origin, Pose(*node_poses[node].tolist()))
        match = refine(submap.smooth_map, points[node], estimate, config)
        pose = match.tf_grid_scan
        score = 1.0 - match.residual
        if (
            match.residual <= config.max_refined_residual
            and math.hypot(pose.x - estimate.x, pose.y - estimate.y) <= config.max_refinement
            and abs(wrap_angle(pose.theta - estimate.theta)) <= config.max_refinement / 5.0
        ):
            found.append(
                LoopClosure(submap.index, node, pose, match_information(match), score, math.nan)
            )
    return found
