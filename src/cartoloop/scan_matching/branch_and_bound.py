# SPDX-License-Identifier: Apache-2.0
"""Branch-and-bound scan matching (section V-B): the best pixel-accurate match in a large window."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from threading import Lock
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cartoloop.arrays import BoolArray, FloatArray, IntArray
from cartoloop.kernels.scan_batch import ScanBatch
from cartoloop.kernels.search_batch import (
    SearchLimits,
    SearchResults,
    WindowBatch,
    search_scans,
)
from cartoloop.kernels.search_window import ROUNDING
from cartoloop.scan_matching.precomputation_grid import MAX_MOVE, STRIDES, PrecomputationGrids
from cartoloop.sensor.pose import Pose, wrap_angle
from cartoloop.sensor.scan_points import ScanPoints
from cartoloop.submaps.finished_grid import (
    PROBABILITY_STEP,
    FinishedGrid,
    mean_probability,
    mean_value,
)


@dataclass(frozen=True, slots=True)
class BranchAndBoundMatch:
    """The best match of a search window.

    Attributes
    ----------
    tf_submap_scan : where the scan fits best.
    score : mean probability of its points there, in [0, 1]; never observed pixels count as 0.097.
    runner_up : score of the best match elsewhere in the window; 0 where none is good enough.
    """

    tf_submap_scan: Pose
    score: float
    runner_up: float


class BranchAndBoundMatches(NamedTuple):
    """The best matches of many scans.

    Attributes
    ----------
    matches : of each scan; None where none was good enough or no search was made.
    was_searched : bool, shape (n,).
    """

    matches: list[BranchAndBoundMatch | None]
    was_searched: BoolArray


@dataclass(frozen=True, slots=True)
class RunnerUp:
    """What counts as a match elsewhere, and when it is searched for.

    Attributes
    ----------
    distance, angle : a match elsewhere is farther from the best one than this [m], or turned by
        more [rad].
    margin : largest gap between its score and the best one; negative: no runner-up is searched for.
        To prove that there is none takes as long as to prove that nothing matches.
    min_score : score that it must reach; None: that which the best one must reach.
    """

    distance: float = 0.5
    angle: float = math.radians(10.0)
    margin: float = 1.0
    min_score: float | None = None


RUNNER_UP = RunnerUp()
"""The default: half a metre is the smallest search window, and 10 degrees twice its angle."""

NO_RUNNER_UP = RunnerUp(margin=-1.0)
"""For :meth:`SubmapMatcher.match`: do not search for a runner-up; it is 0."""

UNLIMITED = 2**62
"""Number of nodes that an exact search may expand."""


class SubmapMatcher:
    """Finds scans in one finished submap; safe to use from several threads at once.

    Parameters
    ----------
    grid : the submap's grid.
    strides : of the precomputed grids.

    Notes
    -----
    The precomputed grids take about 12 bytes a pixel. They are made by the first search, in O(n),
    and kept until :meth:`release`.
    """

    def __init__(self, grid: FinishedGrid, strides: Sequence[int] = STRIDES) -> None:
        self._grid, self._strides = grid, strides
        self._grids: PrecomputationGrids | None = None
        self._building = Lock()

    @property
    def memory_bytes(self) -> int:
        """Size of the precomputed grids that are kept, 0 if there are none."""
        grids = self._grids
        return 0 if grids is None else grids.cells.nbytes

    def probabilities(self) -> NDArray[np.float32]:
        """Return the probability of each cell of the submap's grid; 0 where never observed."""
        grids = self._grids  # if they are kept, the grid does not have to be unpacked
        return (self._grid if grids is None else grids).probabilities()

    def release(self) -> None:
        """Drop the precomputed grids; the next search computes the same again.

        Searches in progress keep theirs until they end.
        """
        self._grids = None

    def match(
        self,
        points: FloatArray,
        tf_submap_scan: Pose,
        *,
        linear_window: float,
        angular_window: float,
        min_score: float,
        max_range: float = math.inf,
        runner_up: RunnerUp = RUNNER_UP,
    ) -> BranchAndBoundMatch | None:
        """Return the best match in a window, or None where none reaches `min_score`.

        The same as exhaustive search, algorithm 1. Of equal scores the one nearest to the estimate
        wins, in steps of pixels and rotations.

        Parameters
        ----------
        points : float64, shape (n, 2), tracking frame [m]; finite.
        tf_submap_scan : estimate, the window's centre.
        linear_window, angular_window : W_x = W_y and W_theta of eq. (8) [m], [rad].
        min_score : score threshold, in [0, 1].
        max_range : upper limit of d_max of eq. (6) [m]; farther points move by more than a pixel
            from one rotation to the next.
        runner_up : which runner-up is searched for.
        """
        half_width = math.ceil(linear_window / self._grid.resolution - ROUNDING)
        found = self._search(
            ScanPoints.of([points]),
            np.array((tf_submap_scan,), dtype=np.float64),
            np.array(((half_width, half_width),)),
            np.array((angular_window,), dtype=np.float64),
            min_score,
            runner_up,
            max_range=max_range,
        )
        return found.matches[0]

    def match_all(
        self,
        scans: ScanPoints,
        tf_submap_scan: FloatArray,
        *,
        linear_windows: FloatArray,
        angular_windows: FloatArray,
        min_score: float,
        groups: IntArray,
        max_of_group: int,
        runner_up: RunnerUp = RUNNER_UP,
        max_expanded: int = UNLIMITED,
    ) -> BranchAndBoundMatches:
        """Return the best match of each of many scans, as :meth:`match` does, in one call.

        Parameters
        ----------
        scans : n of them.
        tf_submap_scan : float64, shape (n, 3), the windows' centres.
        linear_windows, angular_windows : float64, shape (n,).
        groups : int64, shape (n,), from 0 on: scans that are equivalent.
        max_of_group : once this number of scans of a group are found, the rest of it is skipped.
        max_expanded : number of nodes of its tree that the search of a scan may expand; one that
            needs more finds nothing.
        """
        half_widths = np.ceil(linear_windows / self._grid.resolution - ROUNDING).astype(np.int64)
        return self._search(
            scans,
            tf_submap_scan,
            np.column_stack((half_widths, half_widths)),
            angular_windows,
            min_score,
            runner_up,
            groups=groups,
            max_of_group=max_of_group,
            max_expanded=max_expanded,
        )

    def match_full_submap(
        self,
        points: FloatArray,
        *,
        min_score: float,
        max_range: float = math.inf,
        runner_up: RunnerUp = NO_RUNNER_UP,
        heading: float = 0.0,
        angular_window: float = math.pi,
    ) -> BranchAndBoundMatch | None:
        """Return the best match at any rotation, the scan's origin anywhere in the grid, or None.

        Parameters are those of :meth:`match`; by default there is no runner-up. Of equal scores the
        one nearest to the grid's centre wins.

        Parameters
        ----------
        heading, angular_window : part of the rotations that is searched, its middle and what lies
            to each side of it [rad].
        """
        half_height, half_width = (size // 2 for size in self._grid.shape)
        centre = (
            self._grid.origin_x + half_width * self._grid.resolution,
            self._grid.origin_y + half_height * self._grid.resolution,
            heading,
        )
        found = self._search(
            ScanPoints.of([points]),
            np.array((centre,)),
            np.array(((half_width, half_height),)),
            np.array((angular_window,)),
            min_score,
            runner_up,
            max_range=max_range,
        )
        return found.matches[0]

    def _precomputed(self) -> PrecomputationGrids:
        """Return the precomputed grids; threads that need them at once make them only once."""
        grids = self._grids
        if grids is None:
            with self._building:
                grids = self._grids
                if grids is None:
                    grids = self._grids = PrecomputationGrids(self._grid.cells, self._strides)
        return grids

    def _search(
        self,
        scans: ScanPoints,
        estimates: FloatArray,
        half_sizes: IntArray,
        angular_windows: FloatArray,
        min_score: float,
        runner_up: RunnerUp,
        *,
        groups: IntArray | None = None,
        max_of_group: int = 1,
        max_range: float = math.inf,
        max_expanded: int = UNLIMITED,
    ) -> BranchAndBoundMatches:
        """Return the matches in windows of `half_sizes` cells to each side of the estimates."""
        count = len(scans)
        was_searched = np.zeros(count, dtype=np.bool_)
        if count == 0 or self._grid.size == 0:
            return BranchAndBoundMatches([None] * count, was_searched)
        grids, grid = self._precomputed(), self._grid
        found = SearchResults(
            np.empty((count, 2, 4), dtype=np.int64),
            np.empty(count, dtype=np.int64),
            np.empty(count),
            was_searched,
        )
        search_scans(
            grids.arrays,
            ScanBatch(scans.points, scans.firsts, scans.ends),
            WindowBatch(
                grid.origin_x,
                grid.origin_y,
                grid.resolution,
                np.ascontiguousarray(estimates),
                half_sizes,
                np.ascontiguousarray(angular_windows),
            ),
            SearchLimits(
                mean_value(min_score),
                max_range,
                MAX_MOVE,
                runner_up.distance,
                runner_up.angle,
                runner_up.margin / PROBABILITY_STEP,
                mean_value(min_score if runner_up.min_score is None else runner_up.min_score),
                max_expanded,
            ),
            np.zeros(count, dtype=np.int64) if groups is None else groups,
            max_of_group,
            found,
        )
        matches: list[BranchAndBoundMatch | None] = [None] * count
        for i in np.flatnonzero(found.matches[:, 0, 0] >= 0).tolist():
            estimate = Pose(*estimates[i].tolist())
            matches[i] = self._match_of(found, i, estimate, half_sizes[i], len(scans[i]))
        return BranchAndBoundMatches(matches, was_searched)

    def _match_of(
        self,
        found: SearchResults,
        scan: int,
        estimate: Pose,
        half_sizes: IntArray,
        num_points: int,
    ) -> BranchAndBoundMatch:
        """Return the match of a scan that was found, in metres and as probabilities."""
        (total, col, row, rotation), (second, *_) = found.matches[scan].tolist()
        half_width, half_height = half_sizes.tolist()
        turn = (rotation - int(found.rotations[scan])) * float(found.steps[scan])
        return BranchAndBoundMatch(
            Pose(
                estimate.x + (col - half_width) * self._grid.resolution,
                estimate.y + (row - half_height) * self._grid.resolution,
                wrap_angle(estimate.theta + turn),
            ),
            mean_probability(total / num_points),
            mean_probability(second / num_points) if second >= 0 else 0.0,
        )
