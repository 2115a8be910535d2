# SPDX-License-Identifier: Apache-2.0
"""Branch-and-bound scan matching (section V-B): the best pixel-accurate match in a large window."""

from __future__ import annotations

import math
from dataclasses import dataclass
from threading import Lock

import numpy as np

from cartoloop.kernels.branch_and_bound import search
from cartoloop.kernels.node_bounds import scan_range
from cartoloop.scan_matching.precomputation_grid import MAX_MOVE, PrecomputationGrids
from cartoloop.sensor.pose import FloatArray, Pose, wrap_angle
from cartoloop.submaps.finished_grid import (
    PROBABILITY_STEP,
    FinishedGrid,
    mean_probability,
    mean_value,
)

ROUNDING = 1e-9
"""So much more than a whole number of steps is taken for rounding."""


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


@dataclass(frozen=True, slots=True)
class RunnerUp:
    """What counts as a match elsewhere, and when it matters.

    Attributes
    ----------
    distance, angle : a match elsewhere is farther from the best one than this [m], or turned by
        more [rad].
    margin : it is sought down to so much below the best score, but not below the score threshold;
        negative: not at all. To know that there is none takes as long as to know that nothing
        matches.
    """

    distance: float = 0.5
    angle: float = math.radians(10.0)
    margin: float = 1.0


RUNNER_UP = RunnerUp()
"""What a match's `runner_up` is if nothing else is asked for."""

NO_RUNNER_UP = RunnerUp(margin=-1.0)
"""For :meth:`SubmapMatcher.match`: do not seek a runner-up, it is 0."""


def rotation_step(max_range: float, resolution: float) -> float:
    """Return delta_theta of eq. (7) [rad]: points up to a range [m] move by at most a pixel.

    Points within half a pixel of the scan's origin never move by more, so they count as that far.
    """
    return math.acos(1.0 - 0.5 * (resolution / max(max_range, 0.5 * resolution)) ** 2)


class SubmapMatcher:
    """Finds scans in one finished submap; safe to use from several threads at once.

    Parameters
    ----------
    grid : the submap's grid.

    Notes
    -----
    The precomputed grids take about 20 bytes a pixel. They are made by the first search, in O(n),
    and kept until :meth:`release`.
    """

    def __init__(self, grid: FinishedGrid) -> None:
        self._grid = grid
        self._grids: PrecomputationGrids | None = None
        self._building = Lock()

    @property
    def memory_bytes(self) -> int:
        """Size of the precomputed grids that are kept, 0 if there are none."""
        grids = self._grids
        return 0 if grids is None else grids.cells.nbytes

    def release(self) -> None:
        """Forget the precomputed grids; the next search makes them anew and finds the same.

        Searches under way keep theirs until they are done.
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
        points : float64, shape (n, 2), scan frame [m]; finite.
        tf_submap_scan : estimate, the window's centre.
        linear_window, angular_window : W_x = W_y and W_theta of eq. (8) [m], [rad].
        min_score : score threshold, in [0, 1].
        max_range : d_max of eq. (6) counts as no more than this [m]; farther points then move by
            more than a pixel from one rotation to the next.
        runner_up : what the match's `runner_up` is to be.
        """
        half_width = _num_steps(linear_window, self._grid.resolution)
        return self._search(
            points,
            tf_submap_scan,
            (half_width, half_width),
            angular_window,
            min_score,
            max_range,
            runner_up,
        )

    def match_full_submap(
        self, points: FloatArray, *, min_score: float, max_range: float = math.inf
    ) -> BranchAndBoundMatch | None:
        """Return the best match at any rotation, the scan's origin anywhere in the grid, or None.

        Parameters are those of :meth:`match`; there is no runner-up. Of equal scores the one
        nearest to the grid's centre wins.
        """
        half_height, half_width = (size // 2 for size in self._grid.shape)
        centre = Pose(
            self._grid.origin_x + half_width * self._grid.resolution,
            self._grid.origin_y + half_height * self._grid.resolution,
            0.0,
        )
        return self._search(
            points, centre, (half_width, half_height), math.pi, min_score, max_range, NO_RUNNER_UP
        )

    def _precomputed(self) -> PrecomputationGrids:
        """Return the precomputed grids; threads that need them at once make them only once."""
        grids = self._grids
        if grids is None:
            with self._building:
                grids = self._grids
                if grids is None:
                    grids = self._grids = PrecomputationGrids(self._grid.cells)
        return grids

    def _search(
        self,
        points: FloatArray,
        estimate: Pose,
        half_size: tuple[int, int],
        angular_window: float,
        min_score: float,
        max_range: float,
        runner_up: RunnerUp,
    ) -> BranchAndBoundMatch | None:
        """Return the match in a window of so many pixels to each side of the estimate."""
        if len(points) == 0 or self._grid.size == 0:
            return None
        grids, resolution = self._precomputed(), self._grid.resolution
        mean_distance, farthest = scan_range(points)
        step = rotation_step(min(farthest, max_range), resolution)
        num_cols, num_rows = half_size
        num_rotations = _num_steps(angular_window, step)
        away = (
            math.floor((runner_up.distance / resolution) ** 2 + ROUNDING),
            math.floor(runner_up.angle / step + ROUNDING),
            math.ceil(runner_up.margin / PROBABILITY_STEP * len(points)),
        )
        frame = (*estimate, self._grid.origin_x, self._grid.origin_y, resolution, step)
        matches = np.empty((2, 4), dtype=np.int64)
        search(
            grids.cells,
            grids.heights,
            grids.boxes,
            np.ascontiguousarray(points, dtype=np.float64),
            np.array(frame, dtype=np.float64),
            np.array((num_cols, num_rows, num_rotations), dtype=np.int64),
            np.array((mean_distance / resolution, farthest / resolution, MAX_MOVE)),
            max(math.ceil(mean_value(min_score) * len(points) - 1e-6), 0),
            np.array(away, dtype=np.int64),
            matches,
        )
        (total, col, row, rotation), (second, *_) = matches.tolist()
        if total < 0:
            return None
        return BranchAndBoundMatch(
            Pose(
                estimate.x + (col - num_cols) * resolution,
                estimate.y + (row - num_rows) * resolution,
                wrap_angle(estimate.theta + (rotation - num_rotations) * step),
            ),
            mean_probability(total / len(points)),
            mean_probability(second / len(points)) if second >= 0 else 0.0,
        )


def _num_steps(window: float, step: float) -> int:
    """Return how many steps to each side cover a window, eq. (8)."""
    return math.ceil(window / step - ROUNDING)
