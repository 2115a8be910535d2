# SPDX-License-Identifier: Apache-2.0
"""Branch and bound for many scans in one submap, without Python between the searches."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from cartoloop._jit import kernel
from cartoloop.arrays import BoolArray, FloatArray, IntArray
from cartoloop.kernels.branch_and_bound import Elsewhere, search
from cartoloop.kernels.precomputation_grid import GridArrays
from cartoloop.kernels.scan_batch import ScanBatch
from cartoloop.kernels.search_window import (
    ROUNDING,
    ScanExtent,
    SearchFrame,
    SearchWindow,
    rotation_step,
    scan_extent,
)

_SUM_ROUNDING = 1e-6
"""A threshold that exceeds a whole number by no more than this is that number [cell values]."""


class WindowBatch(NamedTuple):
    """The windows of k scans.

    Attributes
    ----------
    origin_x, origin_y, resolution : of the submap's grid [m, submap frame].
    estimates : float64, shape (k, 3), tf_submap_scan, the windows' centres.
    half_sizes : int64, shape (k, 2), cells to each side of them, in x and y.
    angular_windows : float64, shape (k,), W_theta of eq. (8) [rad].
    """

    origin_x: float
    origin_y: float
    resolution: float
    estimates: FloatArray
    half_sizes: IntArray
    angular_windows: FloatArray


class SearchLimits(NamedTuple):
    """What counts as a match.

    Attributes
    ----------
    min_score : score that a match must reach, as a mean cell value.
    max_range : d_max of eq. (6) counts as no more than this [m].
    max_move : maximum number of blocks that a point may move within a group of rotations.
    runner_up_distance, runner_up_angle : a runner-up is farther from the best match than this [m],
        or turned by more [rad].
    runner_up_margin : how far its score may be below that of the best match, as a mean cell value;
        negative: no runner-up is searched for.
    runner_up_score : that it must reach, as a mean cell value.
    max_expanded : number of nodes of the tree that a search may expand; beyond, there is no match.
    """

    min_score: float
    max_range: float
    max_move: int
    runner_up_distance: float
    runner_up_angle: float
    runner_up_margin: float
    runner_up_score: float
    max_expanded: int


class SearchResults(NamedTuple):
    """The results of k searches, to be written.

    Attributes
    ----------
    matches : int64, shape (k, 2, 4), each as :func:`branch_and_bound.search` writes it; sums are -1
        where no search was made.
    rotations : int64, shape (k,), w_theta of eq. (8).
    steps : float64, shape (k,), delta_theta of eq. (7) [rad].
    was_searched : bool, shape (k,).
    """

    matches: IntArray
    rotations: IntArray
    steps: FloatArray
    was_searched: BoolArray


@kernel
def search_scans(
    grids: GridArrays,
    scans: ScanBatch,
    windows: WindowBatch,
    limits: SearchLimits,
    groups: IntArray,
    max_of_group: int,
    out: SearchResults,
) -> None:
    """Write the matches of k scans in one submap into `out`.

    Parameters
    ----------
    grids : of the submap.
    groups : int64, shape (k,), from 0 on.
    max_of_group : once this number of scans of a group are found, the rest of it is skipped.
    """
    resolution = windows.resolution
    num_found = np.zeros(groups.size + 1, dtype=np.int64)
    for i in range(groups.size):
        points = scans.points[scans.firsts[i] : scans.ends[i]]
        num_points = points.shape[0]
        out.matches[i, 0, 0] = out.matches[i, 1, 0] = -1
        out.rotations[i], out.steps[i] = 0, 0.0
        out.was_searched[i] = num_found[groups[i]] < max_of_group
        if not out.was_searched[i] or num_points == 0:
            continue
        extent = scan_extent(points)
        step = rotation_step(min(extent.farthest, limits.max_range), resolution, 0.5 * resolution)
        estimate = windows.estimates[i]
        frame = SearchFrame(
            estimate[0], estimate[1], estimate[2],
            windows.origin_x, windows.origin_y, resolution, step,
        )  # fmt: skip
        half_rotations = math.ceil(windows.angular_windows[i] / step - ROUNDING)
        window = SearchWindow(windows.half_sizes[i, 0], windows.half_sizes[i, 1], half_rotations)
        elsewhere = Elsewhere(
            math.floor((limits.runner_up_distance / resolution) ** 2 + ROUNDING),
            math.floor(limits.runner_up_angle / step + ROUNDING),
            math.ceil(limits.runner_up_margin * num_points),
            max(math.ceil(limits.runner_up_score * num_points - _SUM_ROUNDING), 0),
        )
        min_sum = max(math.ceil(limits.min_score * num_points - _SUM_ROUNDING), 0)
        extent_cells = ScanExtent(extent.mean / resolution, extent.farthest / resolution)
        search(
            grids, points, frame, window, extent_cells, limits.max_move, min_sum,
            limits.max_expanded, elsewhere, out.matches[i],
        )  # fmt: skip
        out.rotations[i], out.steps[i] = half_rotations, step
        if out.matches[i, 0, 0] >= 0:
            num_found[groups[i]] += 1
