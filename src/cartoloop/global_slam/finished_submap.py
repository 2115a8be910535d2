# SPDX-License-Identifier: Apache-2.0
"""A submap that takes part in loop closure, and what is computed of it to be searched."""

from __future__ import annotations

from threading import Lock

from cartoloop.arrays import FloatArray
from cartoloop.kernels.sum_at_points import sum_at_points
from cartoloop.scan_matching.branch_and_bound import SubmapMatcher
from cartoloop.scan_matching.least_squares import SmoothMap
from cartoloop.sensor.scan_points import ScanPoints
from cartoloop.submaps.finished_grid import FinishedGrid, mean_probability

SEARCH_BYTES_A_PIXEL = 16
"""The precomputed grids, and four bytes of smooth map."""


class FinishedSubmap:
    """The grid of a finished submap; its precomputed grids come when needed and go when not.

    Attributes
    ----------
    index : its index in the pose graph.
    grid : what is known of it.
    own_score : mean probability that the scans it is made of find in it, in [0, 1]: where scans
        are sparse or noisy, not even they fit well.
    matcher : branch and bound in it.
    """

    def __init__(self, index: int, grid: FinishedGrid, own_score: float) -> None:
        self.index = index
        self.grid = grid
        self.own_score = own_score
        self.matcher = SubmapMatcher(grid)
        self._smooth_map: SmoothMap | None = None
        self._lock = Lock()

    @property
    def smooth_map(self) -> SmoothMap:
        """The grid as the least-squares matcher wants it, made at the first use."""
        with self._lock:
            if self._smooth_map is None:
                grid = self.grid
                self._smooth_map = SmoothMap(
                    self.matcher.probabilities(), grid.origin_x, grid.origin_y, grid.resolution
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
