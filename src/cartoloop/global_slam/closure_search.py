# SPDX-License-Identifier: Apache-2.0
"""Scans sought in a finished submap (section V-B), then refined by (CS)."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from cartoloop.config import ConstraintSearchConfig
from cartoloop.global_slam.finished_submap import FinishedSubmap
from cartoloop.global_slam.loop_closure import FOUND, NONE_FOUND, Closures, Requests
from cartoloop.scan_matching import least_squares
from cartoloop.scan_matching.least_squares import LeastSquaresMatches, SmoothMap
from cartoloop.scan_matching.match_information import match_informations
from cartoloop.sensor.pose import FloatArray, wrap_angles
from cartoloop.sensor.scan_points import ScanPoints

USUAL_RESIDUAL = 0.4
"""Root mean square of 1 - M at the points of scans that fit."""

LEVER_M = 5.0
"""Usual distance of the points, which turns an error of position into one of heading."""


class FoundClosures(NamedTuple):
    """What a search for many nodes found.

    Attributes
    ----------
    closures : shape (n,), in the order of the requests.
    num_searched : how many nodes were sought.
    """

    closures: Closures
    num_searched: int


def search(
    submap: FinishedSubmap,
    requests: Requests,
    node_points: ScanPoints,
    config: ConstraintSearchConfig,
) -> FoundClosures:
    """Seek nodes in their order in one submap, and refine where they fit well enough.

    Of the nodes inserted into one other submap, no more are sought once enough are found.

    Parameters
    ----------
    node_points : the returns of all nodes, tracking frame.
    """
    coarse = submap.matcher.match_all(
        node_points.take(requests["node"]),
        requests["tf_submap_node"],
        linear_windows=requests["linear_window"],
        angular_windows=requests["angular_window"],
        min_score=min(config.min_score, config.min_score_ratio * submap.own_score),
        groups=np.unique(requests["node_submap"], return_inverse=True)[1],
        max_of_group=config.max_closures_of_pair,
    )
    hits = [(i, match) for i, match in enumerate(coarse.matches) if match is not None]
    num_searched = int(np.count_nonzero(coarse.was_sought))
    if not hits:
        return FoundClosures(NONE_FOUND, num_searched)
    met = requests[[i for i, _ in hits]]
    fine = refine_all(
        submap.smooth_map,
        node_points.take(met["node"]),
        np.array([match.tf_submap_scan for _, match in hits]),
        config,
        math.inf,
    )
    closures = np.empty(len(hits), FOUND)
    closures["submap"], closures["node"] = met["submap"], met["node"]
    closures["tf_submap_node"] = fine.tf_submap_scan
    closures["tf_submap_node"][:, 2] = wrap_angles(fine.tf_submap_scan[:, 2])
    closures["information"] = match_informations(fine.information, fine.residual)
    closures["score"] = [match.score for _, match in hits]
    closures["runner_up"] = [match.runner_up for _, match in hits]
    closures["request"] = met
    return FoundClosures(closures, num_searched)


def refine_all(
    smooth_map: SmoothMap,
    scans: ScanPoints,
    tf_submap_node: FloatArray,
    config: ConstraintSearchConfig,
    max_start_residual: float,
) -> LeastSquaresMatches:
    """Return the matches of (CS) near the poses of nodes, shape (n, 3), held to it by some pixels.

    Those that fit worse than `max_start_residual` where they start are not matched.
    """
    return least_squares.match_all(
        smooth_map,
        scans,
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
