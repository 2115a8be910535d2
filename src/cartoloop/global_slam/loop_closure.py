# SPDX-License-Identifier: Apache-2.0
"""Loop closures: scans sought in a finished submap (section V-B), then refined by (CS)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cartoloop.config import ConstraintSearchConfig
from cartoloop.global_slam.finished_submap import FinishedSubmap
from cartoloop.global_slam.pose_graph import PoseGraph
from cartoloop.scan_matching import least_squares
from cartoloop.scan_matching.least_squares import LeastSquaresMatches, SmoothMap
from cartoloop.scan_matching.match_information import match_informations
from cartoloop.sensor.pose import FloatArray, Pose, wrap_angle

IntArray = NDArray[np.int64]

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
    num_nodes : how many nodes the graph had when it was asked for.
    """

    submap: int
    node: int
    node_submap: int
    points: FloatArray
    tf_submap_node: Pose
    linear_window: float
    angular_window: float
    num_nodes: int = 0


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


class LoopClosures(NamedTuple):
    """Many loop closures, as a structure of arrays: what :class:`LoopClosure` is but the request.

    Attributes
    ----------
    submaps, nodes : int64, shape (n,).
    tf_submap_node : float64, shape (n, 3).
    informations : float64, shape (n, 3, 3).
    scores, runner_ups : float64, shape (n,); NaN where no runner-up was sought.
    """

    submaps: IntArray
    nodes: IntArray
    tf_submap_node: FloatArray
    informations: FloatArray
    scores: FloatArray
    runner_ups: FloatArray

    @staticmethod
    def of(closures: Sequence[LoopClosure]) -> LoopClosures:
        """Return the closures of a sequence."""
        return LoopClosures(
            np.array([closure.submap for closure in closures], dtype=np.int64),
            np.array([closure.node for closure in closures], dtype=np.int64),
            np.array([closure.tf_submap_node for closure in closures]).reshape(-1, 3),
            np.array([closure.information for closure in closures]).reshape(-1, 3, 3),
            np.array([closure.score for closure in closures], dtype=np.float64),
            np.array([closure.runner_up for closure in closures], dtype=np.float64),
        )

    @staticmethod
    def in_graph(graph: PoseGraph, among: NDArray[np.bool_]) -> LoopClosures:
        """Return the constraints marked, shape (num_constraints,), all of which are closures."""
        return LoopClosures(
            graph.index_a[among],
            graph.index_b[among],
            graph.relative_poses[among],
            graph.informations[among],
            graph.scores[among],
            graph.runner_ups[among],
        )

    def one_by_one(self) -> list[LoopClosure]:
        """Return the closures as a list."""
        numbers = (column.tolist() for column in (self.submaps, self.nodes, self.tf_submap_node))
        scores = (self.scores.tolist(), self.runner_ups.tolist())
        return [
            LoopClosure(submap, node, Pose(*pose), information, score, runner_up)
            for submap, node, pose, information, score, runner_up in zip(
                *numbers, self.informations, *scores, strict=True
            )
        ]


class Found(NamedTuple):
    """What a search for many nodes found.

    Attributes
    ----------
    closures : by the number of their request.
    num_searched : how many nodes were sought.
    """

    closures: list[tuple[int, LoopClosure]]
    num_searched: int


def search(
    submap: FinishedSubmap, requests: Sequence[SearchRequest], config: ConstraintSearchConfig
) -> Found:
    """Seek nodes in their order in one submap, and refine where they fit well enough.

    Of the nodes inserted into one other submap, no more are sought once enough are found.
    """
    numbers: dict[int, int] = {}
    groups = [numbers.setdefault(request.node_submap, len(numbers)) for request in requests]
    coarse = submap.matcher.match_all(
        [request.points for request in requests],
        np.array([request.tf_submap_node for request in requests]).reshape(-1, 3),
        linear_windows=np.array([request.linear_window for request in requests]),
        angular_windows=np.array([request.angular_window for request in requests]),
        min_score=min(config.min_score, config.min_score_ratio * submap.own_score),
        groups=np.array(groups, dtype=np.int64),
        max_of_group=config.max_closures_of_pair,
    )
    hits = [(i, match) for i, match in enumerate(coarse.matches) if match is not None]
    num_searched = int(np.count_nonzero(coarse.was_sought))
    if not hits:
        return Found([], num_searched)
    fine = refine_all(
        submap.smooth_map,
        [requests[i].points for i, _ in hits],
        np.array([match.tf_submap_scan for _, match in hits]),
        config,
        math.inf,
    )
    informations = match_informations(fine.information, fine.residual)
    closures = [
        (
            i,
            LoopClosure(
                requests[i].submap,
                requests[i].node,
                Pose(x, y, wrap_angle(theta)),
                information,
                match.score,
                match.runner_up,
                requests[i],
            ),
        )
        for (i, match), (x, y, theta), information in zip(
            hits, fine.tf_grid_scan.tolist(), informations, strict=True
        )
    ]
    return Found(closures, num_searched)


def refine_all(
    smooth_map: SmoothMap,
    points: Sequence[FloatArray],
    tf_submap_node: FloatArray,
    config: ConstraintSearchConfig,
    max_start_residual: float,
) -> LeastSquaresMatches:
    """Return the matches of (CS) near the poses of nodes, shape (n, 3), held to it by some pixels.

    Those that fit worse than `max_start_residual` where they start are not matched.
    """
    return least_squares.match_all(
        smooth_map,
        points,
        tf_submap_node,
        _pull(smooth_map, config),
        config.least_squares_matcher.occupied_space_weight / USUAL_RESIDUAL**2,
        config.least_squares_matcher.max_num_iterations,
        max_start_residual,
    )


def _pull(smooth_map: SmoothMap, config: ConstraintSearchConfig) -> FloatArray:
    """Return the information of the pull towards the start, upper triangle, shape (6,)."""
    sigma = config.refinement_sigma_cells * smooth_map.resolution
    translation, rotation = sigma**-2, (sigma / LEVER_M) ** -2
    return np.array((translation, 0.0, 0.0, translation, 0.0, rotation))
