# SPDX-License-Identifier: Apache-2.0
"""The pixel-accurate correlative matcher over a small window [Olson 2009], by branch and bound.

At each rotation of the window a tree of boxes of translations is searched: the whole window, its
quarters, theirs, and so on to single cells; they overlap where a width is odd. Few candidates are
left whose score has to be computed; what is returned is what looking at each of them in turn would
find, to the last bit.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from cartoloop._jit import kernel
from cartoloop.kernels.window_bounds import (
    COL,
    LEVEL,
    MAX_BYTE,
    ROW,
    SUM,
    bounding_grids,
    box_sizes,
    index_points,
    push_quarters,
    sum_one,
)

CellArray = NDArray[np.int32]
FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

# The best candidate yet: score times its penalty, score, and place in the order of candidates.
WEIGHTED, SCORE, ORDER = range(3)


@kernel
def place_points(
    points: FloatArray,
    origin_x: float,
    origin_y: float,
    resolution: float,
    x: float,
    y: float,
    theta: float,
    out_cols: CellArray,
    out_rows: CellArray,
) -> None:
    """Write the cells of the points, the scan being at a pose, into `out_cols` and `out_rows`.

    Parameters
    ----------
    points : float64, shape (2, n), scan frame [m].
    origin_x, origin_y, resolution : centre of cell (0, 0) and edge of a cell [m].
    x, y, theta : pose of the scan in the grid's frame [m], [rad].
    out_cols, out_rows : int32, shape (n,).
    """
    c = math.cos(theta)
    s = math.sin(theta)
    for k in range(points.shape[1]):
        at_x = x + c * points[0, k] - s * points[1, k]
        at_y = y + s * points[0, k] + c * points[1, k]
        out_cols[k] = np.int32(np.floor((at_x - origin_x) / resolution + 0.5))
        out_rows[k] = np.int32(np.floor((at_y - origin_y) / resolution + 0.5))


@kernel
def mean_probability(
    grid: NDArray[np.float32],
    unknown: np.float32,
    cols: CellArray,
    rows: CellArray,
    dx: int,
    dy: int,
) -> float:
    """Return the mean probability of the cells at (cols + dx, rows + dy), summed in float32.

    Parameters
    ----------
    grid, unknown : as in :func:`quantize_cells`.
    cols, rows : int32, shape (n,), n > 0.
    dx, dy : translation [cells].
    """
    num_rows, num_cols = grid.shape
    total = np.float32(0.0)
    for k in range(cols.size):
        col = np.int64(cols[k]) + dx
        row = np.int64(rows[k]) + dy
        value = unknown
        if 0 <= col < num_cols and 0 <= row < num_rows:
            value = max(grid[row, col], unknown)
        total += value
    return np.float64(total) / cols.size


@kernel
def keep_live(bounds: FloatArray, best: float, live: IntArray, num_live: int) -> int:
    """Drop the rotations that cannot be best, move the most promising to the end; return the rest.

    Parameters
    ----------
    bounds : float64, shape (num_rotations,).
    best : what was found yet; bounds below it are given up.
    live : int64, shape (num_rotations,): the first `num_live` are the rotations yet to be searched.
    """
    kept = 0
    largest = 0
    for i in range(num_live):
        j = live[i]
        if bounds[j] >= best:
            live[kept] = j
            if bounds[j] > bounds[live[largest]]:
                largest = kept
            kept += 1
    if kept > 0:
        live[largest], live[kept - 1] = live[kept - 1], live[largest]
    return kept


@kernel
def match_correlative(
    grid: NDArray[np.float32],
    unknown: float,
    origin_x: float,
    origin_y: float,
    resolution: float,
    points: FloatArray,
    estimate: FloatArray,
    half_width: int,
    half_num_rotations: int,
    rotation_step: float,
    translation_weight: float,
    rotation_weight: float,
    places: CellArray,
    cells: NDArray[np.uint8],
    out_pose: FloatArray,
) -> float:
    """Write the best pose of the window into `out_pose`; return its mean probability in [0, 1].

    Parameters
    ----------
    grid, unknown, origin_x, origin_y, resolution : as in :func:`scan_residuals.accumulate_match`.
    points : float64, shape (n, 2), scan frame [m]; n > 0.
    estimate : float64, shape (3,), centre of the window.
    half_width, half_num_rotations : w_x = w_y and w_theta of eq. (8).
    rotation_step : delta_theta of eq. (7) [rad].
    translation_weight, rotation_weight : candidates are compared by their mean probability times
        ``exp(-(translation_weight * distance + rotation_weight * |rotation|)^2)``; not negative.
    places : int32, scratch, three entries for each point and rotation.
    cells : uint8, scratch, for each of :func:`window_bounds.box_sizes` an entry for each cell of
        the grid and of a margin around it as wide as the window.
    out_pose : float64, shape (3,).

    Notes
    -----
    Of equally good candidates the first counts, by rotation, then row, then column.
    """
    num_points, num_rotations = points.shape[0], 2 * half_num_rotations + 1
    width = 2 * half_width + 1
    count = num_rotations * num_points
    cols = places[:count].reshape((num_rotations, num_points))
    rows = places[count : 2 * count].reshape((num_rotations, num_points))
    index = places[2 * count : 3 * count]
    by_axis = points.T.copy()
    for j in range(num_rotations):
        theta = estimate[2] + (j - half_num_rotations) * rotation_step
        place_points(
            by_axis, origin_x, origin_y, resolution, estimate[0], estimate[1], theta,
            cols[j], rows[j],
        )  # fmt: skip
    part = np.empty(4, dtype=np.int64)
    index_points(
        places[:count],
        places[count : 2 * count],
        half_width,
        grid.shape[1],
        grid.shape[0],
        index,
        part,
    )
    row_length, num_rows = part[2], part[3]
    sizes = box_sizes(width)
    cells = cells[: sizes.size * row_length * num_rows]
    bounding_grids(grid, unknown, part[0], part[1], row_length, num_rows, sizes, cells)
    # A sum of bytes times its rotation's factor is no less than the score of any candidate in the
    # box times its penalty, although that score is a rounded sum of float32.
    rounding = 1.0 + 2.4e-7 * (num_points + 16)
    factors = np.empty(num_rotations)
    bounds = np.empty(num_rotations)
    live = np.arange(num_rotations)
    stack = np.empty((4 * sizes.size + 1, 4), dtype=np.int64)
    for j in range(num_rotations):
        delta = rotation_weight * abs((j - half_num_rotations) * rotation_step)
        factors[j] = math.exp(-delta * delta) * rounding / (MAX_BYTE * num_points)
        bounds[j] = sum_one(cells, index, j * num_points, num_points, 0) * factors[j]
    best = np.zeros(3)
    best[WEIGHTED] = -1.0
    num_live = keep_live(bounds, best[WEIGHTED], live, num_rotations)
    while num_live > 0:
        j = live[num_live - 1]
        rotation = (j - half_num_rotations) * rotation_step
        stack[0] = 0
        stack[0, SUM] = np.int64(MAX_BYTE) * num_points
        height = 1
        while height > 0:
            height -= 1
            if stack[height, SUM] * factors[j] < best[WEIGHTED]:
                continue
            if stack[height, LEVEL] < sizes.size - 1:
                height = push_quarters(
                    cells, index, j * num_points, num_points, row_length * num_rows, row_length,
                    sizes, stack, height,
                )  # fmt: skip
                continue
            dx = stack[height, COL] - half_width
            dy = stack[height, ROW] - half_width
            score = mean_probability(grid, np.float32(unknown), cols[j], rows[j], dx, dy)
            distance = resolution * math.hypot(dx, dy)
            delta = translation_weight * distance + rotation_weight * abs(rotation)
            weighted = score * math.exp(-delta * delta)
            order = (j * width + stack[height, ROW]) * width + stack[height, COL]
            if weighted > best[WEIGHTED] or (weighted == best[WEIGHTED] and order < best[ORDER]):
                best[WEIGHTED], best[SCORE], best[ORDER] = weighted, score, order
                out_pose[0] = estimate[0] + dx * resolution
                out_pose[1] = estimate[1] + dy * resolution
                out_pose[2] = estimate[2] + rotation
        num_live = keep_live(bounds, best[WEIGHTED], live, num_live - 1)
    return float(best[SCORE])
