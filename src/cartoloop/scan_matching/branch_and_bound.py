# SPDX-License-Identifier: Apache-2.0
"""Branch-and-bound scan matching (section V-B): the best pixel-accurate match in a large window."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cartoloop.kernels.branch_and_bound import search
from cartoloop.kernels.precomputation_grid import build_pyramid
from cartoloop.sensor.pose import FloatArray, Pose, wrap_angle
from cartoloop.submaps.finished_grid import FinishedGrid, mean_probability, mean_value

MAX_HEIGHT = 6
"""Height h0 of the search tree's first nodes, eq. (13): boxes of 64 x 64 pixels."""

SLACK_CELLS = 3
"""By so many pixels the points may move within a group of rotations that is bounded at once."""

SPLIT_HEIGHT = 3
"""Groups are split into single rotations where the boxes are of 8 x 8 pixels."""

PADDING = (1 << MAX_HEIGHT) + SLACK_CELLS
"""Border of the precomputed grids: a box that begins so far outside still sees no cell."""


@dataclass(frozen=True, slots=True)
class BranchAndBoundMatch:
    """The best match of a search window.

    Attributes
    ----------
    tf_submap_scan : where the scan fits best.
    score : mean probability of its points there, in [0, 1]; never observed pixels count as 0.097.
    runner_up : score of the best match elsewhere in the window; 0 where none reaches the threshold.
    """

    tf_submap_scan: Pose
    score: float
    runner_up: float


@dataclass(frozen=True, slots=True)
class SearchWindow:
    """The finite set W-bar of eq. (9): whole numbers of pixels and rotation steps around an estimate.

    Attributes
    ----------
    half_width : w_x = w_y.
    half_num_rotations : w_theta.
    rotation_step : delta_theta of eq. (7) [rad].
    """

    half_width: int
    half_num_rotations: int
    rotation_step: float


def search_window(
    points: FloatArray, resolution: float, linear_window: float, angular_window: float
) -> SearchWindow:
    """Return the search window for some points, eq. (6) to (8).

    Parameters
    ----------
    points : float64, shape (n, 2), scan frame [m]; n > 0.
    linear_window, angular_window : how far to each side [m], [rad].
    """
    farthest = max(math.sqrt(float((points * points).sum(axis=1).max())), resolution)
    step = math.acos(1.0 - 0.5 * (resolution / farthest) ** 2)
    return SearchWindow(
        math.ceil(linear_window / resolution), math.ceil(angular_window / step), step
    )


class SubmapMatcher:
    """Finds scans in one finished submap; safe to use from several threads at once.

    Parameters
    ----------
    grid : the submap's grid; its precomputed grids are made here, in O(n).
    """

    def __init__(self, grid: FinishedGrid) -> None:
        self._grid = grid
        num_rows, num_cols = grid.cells.shape
        shape = (MAX_HEIGHT + 1, num_rows + 2 * PADDING, num_cols + 2 * PADDING)
        self._levels: NDArray[np.uint8] = np.empty(shape, dtype=np.uint8)
        self._slack_levels: NDArray[np.uint8] = np.empty(shape, dtype=np.uint8)
        build_pyramid(grid.cells, PADDING, SLACK_CELLS, self._levels, self._slack_levels)

    @property
    def memory_bytes(self) -> int:
        """Size of the precomputed grids."""
        return self._levels.nbytes + self._slack_levels.nbytes

    def match(
        self,
        points: FloatArray,
        tf_submap_scan: Pose,
        *,
        linear_window: float,
        angular_window: float,
        min_score: float,
        runner_up_distance: float = 0.5,
        runner_up_angle: float = math.radians(10.0),
    ) -> BranchAndBoundMatch | None:
        """Return the best match in a window, or None where none reaches `min_score`.

        Of equal scores the one with less rotation wins, then the nearer one.

        Parameters
        ----------
        points : float64, shape (n, 2), scan frame [m].
        tf_submap_scan : estimate, the window's centre.
        linear_window, angular_window : W_x = W_y and W_theta of eq. (8) [m], [rad].
        min_score : score threshold, in [0, 1].
        runner_up_distance, runner_up_angle : a match elsewhere differs by more than this in x, y
            or heading [m], [rad].
        """
        if len(points) == 0 or self._grid.cells.size == 0:
            return None
        window = search_window(points, self._grid.resolution, linear_window, angular_window)
        min_sum = max(math.ceil(mean_value(min_score) * len(points) - 1e-6), 0)
        best = self._search(points, tf_submap_scan, window, min_sum, np.array((0, 0, 0, -1, 0)))
        if best[0] < min_sum:
            return None
        around = np.array(
            (
                *best[1:],
                math.floor(runner_up_distance / self._grid.resolution),
                math.floor(runner_up_angle / window.rotation_step),
            )
        )
        second = self._search(points, tf_submap_scan, window, min_sum, around)
        total, col, row, rotation = best.tolist()
        turn = (rotation - window.half_num_rotations) * window.rotation_step
        return BranchAndBoundMatch(
            Pose(
                tf_submap_scan.x + col * self._grid.resolution,
                tf_submap_scan.y + row * self._grid.resolution,
                wrap_angle(tf_submap_scan.theta + turn),
            ),
            mean_probability(total / len(points)),
            mean_probability(float(second[0]) / len(points)) if second[0] >= min_sum else 0.0,
        )

    def _search(
        self,
        points: FloatArray,
        tf_submap_scan: Pose,
        window: SearchWindow,
        min_sum: int,
        excluded: NDArray[np.int64],
    ) -> NDArray[np.int64]:
        """Return the best leaf that is not excluded: sum, column, row, rotation."""
        best = np.empty(4, dtype=np.int64)
        search(
            self._levels,
            self._slack_levels,
            PADDING,
            points,
            np.array(tf_submap_scan),
            self._grid.origin_x,
            self._grid.origin_y,
            self._grid.resolution,
            window.half_width,
            window.half_num_rotations,
            window.rotation_step,
            # (7) bounds the movement in r per step at d_max; one rotation less than the slack, so
            # that rounding cannot carry a point across one more border.
            SLACK_CELLS - 1,
            SPLIT_HEIGHT,
            _top_height(window.half_width),
            min_sum,
            excluded,
            best,
        )
        return best


def _top_height(half_width: int) -> int:
    """Return h0: the height at which about two boxes a side cover the window, MAX_HEIGHT at the most."""
    return min(max((2 * half_width + 1).bit_length() - 2, 0), MAX_HEIGHT)
