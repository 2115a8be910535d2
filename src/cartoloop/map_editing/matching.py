# SPDX-License-Identifier: Apache-2.0
"""A node matched to a submap near a pose that the user gives."""

from __future__ import annotations

import math

import numpy as np

from cartoloop.errors import InputError
from cartoloop.global_slam.closure_matches import UPPER, Requests, SearchMatches
from cartoloop.global_slam.closure_search import FinishedSubmap, search
from cartoloop.global_slam.refinement import final_limits
from cartoloop.global_slam.restoring import inserted_rows
from cartoloop.map_data import MapData
from cartoloop.map_editing.arguments import Add
from cartoloop.scan_matching.branch_and_bound import NO_RUNNER_UP
from cartoloop.sensor.pose import Pose, relative, wrap_angle
from cartoloop.sensor.scan_points import ScanPoints

WINDOW_M, WINDOW_DEG = 1.0, 15.0
"""Search window around the pose that is given: radius, and angle to each side."""


def matched(
    content: MapData, submap: int, node: int, tf_map_node: Pose, window_m: float, window_deg: float
) -> Add:
    """Return the closure of a node that fits a submap near a pose in the map.

    It is searched by branch and bound, refined by least squares, and must fit as well as the
    closures that mapping finds.

    Parameters
    ----------
    content : the map; `submap` and `node` are its own.
    tf_map_node : where the node should be, given where the submap is.
    window_m, window_deg : the window around it that is searched.

    Raises
    ------
    InputError
        It does not fit there, or fits in two places.
    """
    config = content.config.global_slam.constraint_search
    where = f"submap {submap}, node {node}"
    submap_pose = Pose(*content.graph.submap_poses[submap].tolist())
    estimate = relative(submap_pose, tf_map_node)
    scans = ScanPoints.of([content.node_points[node]])
    if len(scans[0]) < config.min_num_points:
        raise InputError(
            f"{where}: the scan has {len(scans[0])} returns, {config.min_num_points} are needed; "
            "choose another node"
        )
    finished = _finished(content, submap)
    requests = Requests(
        np.array([submap], dtype=np.int32),
        np.array([0], dtype=np.int32),
        np.array([submap], dtype=np.int32),
        np.array([estimate]),
        np.array([window_m]),
        np.array([math.radians(window_deg)]),
    )
    outcome = search(finished, np.array([0], dtype=np.int32), requests, scans, config)
    if len(outcome.ambiguous):
        raise InputError(
            f"{where}: fits as well in another place of the window; give a smaller --window, or "
            "another node"
        )
    found = outcome.matches
    if len(found.row) == 0:
        score = _best_score(finished, scans, estimate, window_m, window_deg)
        raise InputError(
            f"{where}: does not fit there: score {score:.3f}, {outcome.min_score:.3f} is needed, "
            f"within {window_m:g} m and {window_deg:g} deg; give a better pose, or another node"
        )
    limit = final_limits(config, finished).residual
    residual = float(found.residual[0])
    if not residual <= limit:
        raise InputError(
            f"{where}: does not fit there: score {found.score[0]:.3f}, but residual "
            f"{residual:.3f}, {limit:.3f} is the limit; give a better pose, or another node"
        )
    return _closure(found, submap, node, estimate)


def _finished(content: MapData, submap: int) -> FinishedSubmap:
    graph, grid = content.graph, content.submap_grids[submap]
    own = inserted_rows(graph, submap)
    points = ScanPoints.of([content.node_points[node] for node in graph.index_b[own].tolist()])
    return FinishedSubmap.of(submap, grid, points, graph.relative_poses[own])


def _best_score(
    finished: FinishedSubmap,
    scans: ScanPoints,
    estimate: Pose,
    window_m: float,
    window_deg: float,
) -> float:
    """Return the best score in the window, however low."""
    best = finished.matcher.match(
        scans[0],
        estimate,
        linear_window=window_m,
        angular_window=math.radians(window_deg),
        min_score=0.0,
        runner_up=NO_RUNNER_UP,
    )
    return 0.0 if best is None else best.score


def _closure(found: SearchMatches, submap: int, node: int, estimate: Pose) -> Add:
    x, y, theta = found.tf_submap_node[0].tolist()
    moved = math.hypot(x - estimate.x, y - estimate.y), abs(wrap_angle(theta - estimate.theta))
    return Add(
        submap=submap,
        node=node,
        tf_submap_node=(x, y, theta),
        information=tuple(found.information[0][UPPER].tolist()),
        score=float(found.score[0]),
        residual=float(found.residual[0]),
        moved=moved,
    )
