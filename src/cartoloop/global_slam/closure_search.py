# SPDX-License-Identifier: Apache-2.0
"""Finished submaps, and the search for nodes in one (section V-B), refined by (CS)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from threading import Lock
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from cartoloop.arrays import FloatArray, RowArray
from cartoloop.config import ConstraintSearchConfig
from cartoloop.global_slam.closure_matches import Requests, SearchMatches
from cartoloop.global_slam.sparse_scans import are_sparse
from cartoloop.kernels.sum_at_points import sum_at_points
from cartoloop.scan_matching import least_squares
from cartoloop.scan_matching.branch_and_bound import BranchAndBoundMatch, RunnerUp, SubmapMatcher
from cartoloop.scan_matching.least_squares import LeastSquaresMatches, SmoothMap, match_informations
from cartoloop.sensor.pose import wrap_angles
from cartoloop.sensor.scan_points import ScanPoints
from cartoloop.submaps.finished_grid import FinishedGrid, mean_probability
from cartoloop.submaps.widened_grid import widened

SEARCH_BYTES_A_PIXEL = 16
"""The precomputed grids, and four bytes of smooth map."""


class FinishedSubmap:
    """The grid of a finished submap; its precomputed grids are made when they are needed.

    Sparse scans leave holes in its walls, where right matches score as low as false ones. Branch
    and bound then searches in walls that are wider by a pixel to each side, which closes the holes.

    Parameters
    ----------
    index : its index in the pose graph.
    grid : its cells.
    own_score : mean probability that the scans it is made of find in it, in [0, 1]: where scans
        are sparse or noisy, not even they fit well.
    is_sparse : whether these scans are sparse.

    Attributes
    ----------
    index, grid, own_score, is_sparse : as given.
    matcher : branch and bound in it.
    """

    def __init__(
        self, index: int, grid: FinishedGrid, own_score: float, *, is_sparse: bool = False
    ) -> None:
        self.index = index
        self.grid = grid
        self.own_score = own_score
        self.is_sparse = is_sparse
        self.matcher = SubmapMatcher(widened(grid) if is_sparse else grid)
        self._smooth_map: SmoothMap | None = None
        self._lock = Lock()

    @classmethod
    def of(
        cls, index: int, grid: FinishedGrid, scans: ScanPoints, tf_submap_node: FloatArray
    ) -> Self:
        """Return a submap given the points and poses of its own scans, in their order."""
        score = mean_score(grid, scans, tf_submap_node)
        return cls(index, grid, score, is_sparse=are_sparse(tf_submap_node))

    @property
    def smooth_map(self) -> SmoothMap:
        """The grid for the least-squares matcher, made at the first use."""
        with self._lock:
            if self._smooth_map is None:
                grid = self.grid
                kept = grid if self.is_sparse else self.matcher
                self._smooth_map = SmoothMap(
                    kept.probabilities(), grid.origin_x, grid.origin_y, grid.resolution
                )
            return self._smooth_map

    @property
    def search_bytes(self) -> int:
        """About the size of what a search computes and :meth:`release` drops."""
        return SEARCH_BYTES_A_PIXEL * self.grid.size

    def release(self) -> None:
        """Drop all but the grid; the rest is computed again at the next use."""
        self.matcher.release()
        with self._lock:
            self._smooth_map = None


def mean_score(grid: FinishedGrid, scans: ScanPoints, tf_submap_node: FloatArray) -> float:
    """Return the mean probability at the points of nodes; never observed pixels count as p_min.

    Parameters
    ----------
    scans : the points of n nodes.
    tf_submap_node : float64, shape (n, 3).
    """
    num_points = int(scans.counts.sum())
    if num_points == 0 or grid.size == 0:
        return 0.0
    total = sum_at_points(
        grid.cells,
        1,
        grid.origin_x,
        grid.origin_y,
        grid.resolution,
        scans.points,
        scans.firsts,
        scans.ends,
        tf_submap_node,
    )
    return mean_probability(float(total) / num_points)


class SearchOutcome(NamedTuple):
    """What the search of some requests in one submap came to.

    Attributes
    ----------
    min_score : threshold that was applied.
    is_empty : whether the submap has no cells.
    searched, not_searched : int32, rows of the record.
    ambiguous : int32, those of `searched` that another place fits as well.
    matches : where the threshold was reached, but for these.
    """

    min_score: float
    is_empty: bool
    searched: NDArray[np.int32]
    not_searched: NDArray[np.int32]
    ambiguous: NDArray[np.int32]
    matches: SearchMatches


def score_threshold(config: ConstraintSearchConfig, own_score: float) -> float:
    """Return the minimum score of a match, given the mean score of the submap's own scans."""
    return min(config.min_score, config.min_score_ratio * own_score)


def search(
    submap: FinishedSubmap,
    rows: NDArray[np.int32],
    requests: Requests,
    node_points: ScanPoints,
    config: ConstraintSearchConfig,
) -> SearchOutcome:
    """Search nodes in their order in one submap, and refine where they fit well enough.

    Of the nodes inserted into one other submap, the rest is not searched once
    ``max_closures_of_pair`` are found.

    Parameters
    ----------
    rows : of the record, shape (n,).
    requests : n of them, all in this submap.
    node_points : the returns of all nodes, tracking frame.
    """
    min_score = score_threshold(config, submap.own_score)
    scans = node_points.take(requests.node.astype(np.int64))
    margin = config.min_runner_up_margin
    coarse = submap.matcher.match_all(
        scans,
        requests.tf_submap_node,
        linear_windows=requests.linear_window,
        angular_windows=requests.angular_window,
        min_score=min_score,
        groups=np.unique(requests.node_submap, return_inverse=True)[1],
        max_of_group=config.max_closures_of_pair,
        # Else what hardly reaches the threshold would pass as distinct.
        runner_up=RunnerUp(min_score=min_score - margin),
    )
    found = [(i, match) for i, match in enumerate(coarse.matches) if match is not None]
    hits = [(i, match) for i, match in found if match.score - match.runner_up >= margin]
    ambiguous = [i for i, match in found if match.score - match.runner_up < margin]
    searched = coarse.was_searched
    matches = NO_MATCHES
    if hits:
        met = np.array([i for i, _ in hits])
        matched = [match for _, match in hits]
        matches, _ = refined(submap, scans.take(met), rows[met], matched, config)
    return SearchOutcome(
        min_score,
        submap.grid.size == 0,
        rows[searched],
        rows[~searched],
        rows[np.array(ambiguous, dtype=np.int64)],
        matches,
    )


def refined(
    submap: FinishedSubmap,
    scans: ScanPoints,
    rows: RowArray,
    found: Sequence[BranchAndBoundMatch],
    config: ConstraintSearchConfig,
) -> tuple[SearchMatches, FloatArray]:
    """Return matches of branch and bound, refined by (CS), and its curvatures, shape (n, 3, 3).

    Parameters
    ----------
    scans, rows, found : n scans, their rows in the record, and their matches.
    """
    starts = np.array([match.tf_submap_scan for match in found]).reshape(-1, 3)
    fine = refine_all(submap.smooth_map, scans, starts, config, math.inf)
    poses = fine.tf_submap_scan.copy()
    poses[:, 2] = wrap_angles(fine.tf_submap_scan[:, 2])
    moved = fine.tf_submap_scan - starts
    matches = SearchMatches(
        row=rows,
        tf_submap_node=poses,
        information=match_informations(fine.information, fine.residual),
        residual=fine.residual,
        score=np.array([match.score for match in found]),
        runner_up=np.array([match.runner_up for match in found]),
        moved_m=np.hypot(moved[:, 0], moved[:, 1]),
        moved_rad=np.abs(wrap_angles(moved[:, 2])),
    )
    return matches, fine.information


def refine_all(
    smooth_map: SmoothMap,
    scans: ScanPoints,
    tf_submap_node: FloatArray,
    config: ConstraintSearchConfig,
    max_start_residual: float,
) -> LeastSquaresMatches:
    """Return the matches of (CS) near the poses of nodes, shape (n, 3), which act as a prior.

    Those with a residual above `max_start_residual` at the start are not matched.
    """
    matcher = config.least_squares_matcher
    return least_squares.match_all(
        smooth_map,
        scans,
        tf_submap_node,
        _prior_information(smooth_map, config),
        least_squares.MatchOptions(
            matcher.occupied_space_weight / config.usual_residual**2,
            matcher.max_num_iterations,
            matcher.tolerance,
        ),
        max_start_residual,
    )


def _prior_information(smooth_map: SmoothMap, config: ConstraintSearchConfig) -> FloatArray:
    """Return the information of the prior at the start, upper triangle, shape (6,)."""
    sigma = config.refinement_sigma_cells * smooth_map.resolution
    translation, rotation = sigma**-2, (sigma / config.lever) ** -2
    return np.array((translation, 0.0, 0.0, translation, 0.0, rotation))


_NOTHING = np.zeros(0)
NO_MATCHES = SearchMatches(
    np.zeros(0, np.int32),
    np.zeros((0, 3)),
    np.zeros((0, 3, 3)),
    _NOTHING,
    _NOTHING,
    _NOTHING,
    _NOTHING,
    _NOTHING,
)
