# SPDX-License-Identifier: Apache-2.0
"""One loop closure: a scan sought in a finished submap (section V-B), then refined by (CS)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cartoloop.config import ConstraintSearchConfig
from cartoloop.global_slam.finished_submap import FinishedSubmap
from cartoloop.global_slam.pose_graph import PoseGraph
from cartoloop.scan_matching import least_squares
from cartoloop.scan_matching.least_squares import (
    LeastSquaresMatch,
    LeastSquaresMatches,
    SmoothMap,
)
from cartoloop.scan_matching.match_information import match_information
from cartoloop.sensor.pose import FloatArray, Pose

USUAL_RESIDUAL = 0.4
"""Root mean square of 1 - M at the points of scans that fit."""

LEVER_M = 5.0
"""Usual distance of the points, which turns an error of position into one of heading."""


@dataclass(frozen=True, slots=True)
class SearchRequest:
    """A node to be sought in a finished submap.

    Attributes
    ----------
    submap, node : their indices in the pose graph.
    node_submap : the older submap that the node was inserted into.
    points : float64, shape (n, 2), the node's returns [m], tracking frame.
    tf_submap_node : estimate, the centre of the window.
    linear_window, angular_window : how far to search each way [m], [rad].
    """

    submap: int
    node: int
    node_submap: int
    points: FloatArray
    tf_submap_node: Pose
    linear_window: float
    angular_window: float


@dataclass(frozen=True, slots=True)
class LoopClosure:
    """A node found in a submap that it was not inserted into.

    Attributes
    ----------
    submap, node : their indices in the pose graph.
    tf_submap_node : where it was found.
    information : float64, shape (3, 3), inverse covariance, submap axes.
    score : mean probability of the node's returns there, in [0, 1].
    runner_up : score of the best match elsewhere in the window, 0 where none was good enough.
    request : where it was sought; None where it was matched anew.
    """

    submap: int
    node: int
    tf_submap_node: Pose
    information: FloatArray
    score: float
    runner_up: float
    request: SearchRequest | None = None


def loop_closures(graph: PoseGraph, among: NDArray[np.bool_]) -> list[LoopClosure]:
    """Return the constraints marked, shape (num_constraints,), all of which are loop closures."""
    rows = np.flatnonzero(among)
    return [
        LoopClosure(submap, node, Pose(*pose), information, score, runner_up)
        for submap, node, pose, information, score, runner_up in zip(
            graph.index_a[rows].tolist(),
            graph.index_b[rows].tolist(),
            graph.relative_poses[rows].tolist(),
            graph.informations[rows],
            graph.scores[rows].tolist(),
            graph.runner_ups[rows].tolist(),
            strict=True,
        )
    ]


def search(
    submap: FinishedSubmap, request: SearchRequest, config: ConstraintSearchConfig
) -> LoopClosure | None:
    """Return the loop closure sought, or None where the node does not fit well enough."""
    coarse = submap.matcher.match(
        request.points,
        request.tf_submap_node,
        linear_window=request.linear_window,
        angular_window=request.angular_window,
        min_score=min(config.min_score, config.min_score_ratio * submap.own_score),
    )
    if coarse is None:
        return None
    fine = refine(submap.smooth_map, request.points, coarse.tf_submap_scan, config)
    return LoopClosure(
        request.submap,
        request.node,
        fine.tf_grid_scan,
        match_information(fine),
        coarse.score,
        coarse.runner_up,
        request,
    )


def refine(
    smooth_map: SmoothMap, points: FloatArray, tf_submap_node: Pose, config: ConstraintSearchConfig
) -> LeastSquaresMatch:
    """Return the match of (CS) near a pose, held to it by some pixels."""
    return least_squares.match(
        smooth_map,
        points,
        tf_submap_node,
        tf_submap_node,
        _pull(smooth_map, config),
        config.least_squares_matcher.occupied_space_weight / USUAL_RESIDUAL**2,
        config.least_squares_matcher.max_num_iterations,
    )


def refine_all(
    smooth_map: SmoothMap,
    points: Sequence[FloatArray],
    tf_submap_node: FloatArray,
    config: ConstraintSearchConfig,
) -> LeastSquaresMatches:
    """Return the matches of (CS) near the poses of nodes, shape (n, 3), as :func:`refine` does."""
    return least_squares.match_all(
        smooth_map,
        points,
        tf_submap_node,
        _pull(smooth_map, config),
        config.least_squares_matcher.occupied_space_weight / USUAL_RESIDUAL**2,
        config.least_squares_matcher.max_num_iterations,
        config.max_start_residual,
    )


def _pull(smooth_map: SmoothMap, config: ConstraintSearchConfig) -> FloatArray:
    """Return the information of the pull towards the start, upper triangle, shape (6,)."""
    sigma = config.refinement_sigma_cells * smooth_map.resolution
    translation, rotation = sigma**-2, (sigma / LEVER_M) ** -2
    return np.array((translation, 0.0, 0.0, translation, 0.0, rotation))
