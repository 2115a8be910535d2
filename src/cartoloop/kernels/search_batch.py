# SPDX-License-Identifier: Apache-2.0
"""Branch and bound for many scans in one submap: in one go, without Python between the searches."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from cartoloop._jit import kernel
from cartoloop.kernels.branch_and_bound import search
from cartoloop.kernels.node_bounds import scan_range

ByteArray = NDArray[np.uint8]
CellArray = NDArray[np.int32]
FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

ROUNDING = 1e-9
"""So much more than a whole number of steps is taken for rounding."""


@kernel
def rotation_step(max_range: float, resolution: float) -> float:
    """Return delta_theta of eq. (7) [rad]: points up to a range [m] move by at most a pixel.

    Points within half a pixel of the scan's origin never move by more, so they count as that far.
    """
    return math.acos(1.0 - 0.5 * (resolution / max(max_range, 0.5 * resolution)) ** 2)


@kernel
def search_scans(
    cells: ByteArray,
    levels: IntArray,
    level_boxes: CellArray,
    grid_frame: FloatArray,
    points: FloatArray,
    firsts: IntArray,
    ends: IntArray,
    estimates: FloatArray,
    half_sizes: IntArray,
    angular_windows: FloatArray,
    limits: FloatArray,
    away: FloatArray,
    groups: IntArray,
    max_of_group: int,
    out_matches: IntArray,
    out_rotations: IntArray,
    out_steps: FloatArray,
    out_was_sought: NDArray[np.bool_],
) -> None:
    """Write the matches of many scans in one submap into the `out_` arrays.

    Parameters
    ----------
    cells, levels, level_boxes : the submap's precomputed grids, see
        :func:`cartoloop.kernels.branch_and_bound.search`.
    grid_frame : float64, (origin_x, origin_y, resolution) [m].
    points : float64, shape (n, 2), the points of all scans [m].
    firsts, ends : int64, shape (k,): scan i has ``points[firsts[i] : ends[i]]``.
    estimates : float64, shape (k, 3), the windows' centres.
    half_sizes : int64, shape (k, 2), pixels to each side of them, in x and y.
    angular_windows : float64, shape (k,), W_theta of eq. (8) [rad].
    limits : float64, (mean cell value that a match must reach; range that d_max of eq. (6) counts
        as no more than [m]; by how many blocks a point may move within a group of rotations).
    away : float64, (distance [m], angle [rad], cell values a point): what counts as away from the
        best match, and how far it may be below it; negative: none is sought.
    groups : int64, shape (k,), from 0 on.
    max_of_group : once so many scans of a group are found, no more of it are sought.
    out_matches : int64, shape (k, 2, 4), each as :func:`branch_and_bound.search` leaves it; sums
        are -1 where no search was made.
    out_rotations, out_steps : shape (k,), w_theta, and delta_theta [rad].
    out_was_sought : shape (k,).
    """
    resolution = grid_frame[2]
    num_found = np.zeros(groups.size + 1, dtype=np.int64)
    extent, frame = np.empty(3), np.empty(7)
    window, apart = np.empty(3, dtype=np.int64), np.empty(3, dtype=np.int64)
    for i in range(groups.size):
        scan = points[firsts[i] : ends[i]]
        out_matches[i, 0, 0] = out_matches[i, 1, 0] = -1
        out_rotations[i], out_steps[i] = 0, 0.0
        out_was_sought[i] = num_found[groups[i]] < max_of_group
        if not out_was_sought[i] or scan.shape[0] == 0:
            continue
        mean_distance, farthest = scan_range(scan)
        step = rotation_step(min(farthest, limits[1]), resolution)
        extent[0], extent[1], extent[2] = (
            mean_distance / resolution,
            farthest / resolution,
            limits[2],
        )
        frame[0], frame[1], frame[2] = estimates[i, 0], estimates[i, 1], estimates[i, 2]
        frame[3], frame[4], frame[5], frame[6] = grid_frame[0], grid_frame[1], resolution, step
        window[0], window[1] = half_sizes[i, 0], half_sizes[i, 1]
        window[2] = np.int64(math.ceil(angular_windows[i] / step - ROUNDING))
        apart[0] = np.int64(np.floor((away[0] / resolution) ** 2 + ROUNDING))
        apart[1] = np.int64(np.floor(away[1] / step + ROUNDING))
        apart[2] = np.int64(math.ceil(away[2] * scan.shape[0]))
        min_sum = max(math.ceil(limits[0] * scan.shape[0] - 1e-6), 0)
        search(
            cells, levels, level_boxes, scan, frame, window, extent, min_sum, apart, out_matches[i]
        )
        out_rotations[i], out_steps[i] = window[2], step
        if out_matches[i, 0, 0] >= 0:
            num_found[groups[i]] += 1
