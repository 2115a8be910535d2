# SPDX-License-Identifier: Apache-2.0
"""The pixel-accurate correlative matcher over a small window [Olson 2009], by branch and bound.

At each rotation of the window a tree of boxes of translations is searched: the whole window, its
quarters, their quarters, and so on to single cells; boxes overlap where a width is odd. Few
candidates remain whose score is computed. The result equals that of scoring each candidate in turn,
to the last bit.

Branch and bound for loop closure (:mod:`cartoloop.kernels.branch_and_bound`) is another program:
its window is a hundred times larger and its submap no longer changes, so that grids of maxima that
are precomputed for the whole submap, and groups of rotations, pay. Here the submap grows, grids are
made for each match of the part that the window meets, and scores are means of probabilities.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cartoloop._jit import borrowing_kernel, inlined_kernel, kernel
from cartoloop.arrays import ByteArray, CellArray, FloatArray, IntArray
from cartoloop.kernels.search_order import order_by_key
from cartoloop.kernels.smooth_map import PatchArray, SmoothMap, SmoothMapFields
from cartoloop.kernels.window_bounds import (
    MAX_BYTE,
    bounding_grids,
    box_sizes,
    index_points,
    keep_higher,
    least_byte,
    packed_node,
    push_quarters,
    unpacked_node,
)

ROUNDING = 2.4e-7
"""Relative rounding error of a float32 addition, and of the product of two: four units in the last
place, 4 * 2^-24. A bound is enlarged by it for each point, and for _EXTRA_ROUNDINGS more."""

_EXTRA_ROUNDINGS = 16
"""Roundings of a score besides those of its sum, with a margin."""

WEIGHTED, SCORE, ORDER = range(3)
"""Entries of `best`, the best candidate so far: score times its penalty, score, and number in the
order of candidates."""


class CorrelativeWindow(NamedTuple):
    """A small search window, and how candidates far from its centre are penalised.

    Attributes
    ----------
    half_width : w_x = w_y of eq. (8) [cells].
    half_num_rotations : w_theta of eq. (8) [rotation steps].
    rotation_step : delta_theta of eq. (7) [rad].
    translation_weight, rotation_weight : candidates are compared by their mean probability times
        ``exp(-(translation_weight * distance + rotation_weight * |rotation|)^2)``; not negative;
        [1/m], [1/rad].
    """

    half_width: int
    half_num_rotations: int
    rotation_step: float
    translation_weight: float
    rotation_weight: float


class CorrelativeScratch(NamedTuple):
    """Memory for a match, of any content.

    Attributes
    ----------
    places : int32, three entries for each point and rotation.
    cells : uint8, for each of :func:`window_bounds.box_sizes` an entry for each cell of the grid
        and of a margin around it as wide as the window.
    """

    places: CellArray
    cells: ByteArray


class RotationBoxes(NamedTuple):
    """What bounds the boxes of translations at every rotation.

    Attributes
    ----------
    cells : uint8, grids of maxima over the boxes of each level, `area` bytes each.
    indices : int32, shape (num_rotations * num_points,), where points look up the window's first
        cell, in cells.
    num_higher : int64, shape (num_rotations,), of these points those in the front that have more
        than the least byte anywhere in the window.
    least : the least byte.
    sizes : int64, shape (num_levels,), see :func:`window_bounds.box_sizes`.
    area, row_length : of a grid [cells].
    """

    cells: ByteArray
    indices: CellArray
    num_higher: IntArray
    least: int
    sizes: IntArray
    area: int
    row_length: int


@borrowing_kernel
def place_points(
    smooth_map: SmoothMap,
    points: FloatArray,
    x: float,
    y: float,
    theta: float,
    out_cols: CellArray,
    out_rows: CellArray,
) -> None:
    """Write the cells of the points, with the scan at a pose, into `out_cols` and `out_rows`.

    Parameters
    ----------
    smooth_map : only its frame is used.
    points : float64, shape (2, n), tracking frame [m].
    x, y, theta : tf_submap_scan [m], [m], [rad].
    out_cols, out_rows : int32, shape (n,).
    """
    origin_x, origin_y = smooth_map.origin_x, smooth_map.origin_y
    resolution = smooth_map.resolution
    c = math.cos(theta)
    s = math.sin(theta)
    for k in range(points.shape[1]):
        at_x = x + c * points[0, k] - s * points[1, k]
        at_y = y + s * points[0, k] + c * points[1, k]
        out_cols[k] = np.int32(np.floor((at_x - origin_x) / resolution + 0.5))
        out_rows[k] = np.int32(np.floor((at_y - origin_y) / resolution + 0.5))


@borrowing_kernel
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


@inlined_kernel
def search_rotation(
    grid: PatchArray,
    unknown: float,
    resolution: float,
    boxes: RotationBoxes,
    cols: CellArray,
    rows: CellArray,
    window: CorrelativeWindow,
    number: int,
    factor: float,
    stack: IntArray,
    best: FloatArray,
    out_steps: IntArray,
) -> None:
    """Search the translations at one rotation for a candidate better than `best`.

    Parameters
    ----------
    grid, unknown, resolution : of the occupancy grid, see :func:`match_correlative`.
    cols, rows : int32, shape (n,), cells of the points at the rotation, without translation.
    number : of the rotation, from the window's first one on.
    factor : a sum of bytes times this bounds the penalised score.
    stack : int64, shape (m,), scratch.
    best : float64, shape (3,), the best candidate so far.
    out_steps : int64, shape (3,), its translation [cells] and rotation [steps] from the estimate.
    """
    num_points, half_width = cols.size, window.half_width
    width = 2 * half_width + 1
    box_cells, indices, sizes = boxes.cells, boxes.indices, boxes.sizes
    num_higher = boxes.num_higher[number]
    others = boxes.least * (num_points - num_higher)
    turn = number - window.half_num_rotations
    stack[0] = packed_node(np.int64(MAX_BYTE) * num_points, 0, 0, 0)
    height = 1
    while height > 0:
        height -= 1
        total, level, row, col = unpacked_node(stack[height])
        if total * factor < best[WEIGHTED]:
            continue
        if level < sizes.size - 1:
            height = push_quarters(
                box_cells, indices, number * num_points, num_higher, boxes.area, boxes.row_length,
                sizes, others, stack[height], stack, height,
            )  # fmt: skip
            continue
        dx = col - half_width
        dy = row - half_width
        score = mean_probability(grid, np.float32(unknown), cols, rows, dx, dy)
        distance = resolution * math.sqrt(dx * dx + dy * dy)
        rotation = turn * window.rotation_step
        delta = window.translation_weight * distance + window.rotation_weight * abs(rotation)
        weighted = score * math.exp(-delta * delta)
        order = (number * width + row) * width + col
        if weighted > best[WEIGHTED] or (weighted == best[WEIGHTED] and order < best[ORDER]):
            best[WEIGHTED], best[SCORE], best[ORDER] = weighted, score, order
            out_steps[0], out_steps[1], out_steps[2] = dx, dy, turn


@kernel
def match_correlative(
    grid: SmoothMapFields,
    unknown: float,
    points: FloatArray,
    estimate: FloatArray,
    window: tuple[int, int, float, float, float],
    scratch: tuple[CellArray, ByteArray],
    out_pose: FloatArray,
) -> float:
    """Write the best pose of the window into `out_pose`; return its mean probability in [0, 1].

    Python calls it for each scan, so all inputs are plain tuples.

    Parameters
    ----------
    grid : fields of a `SmoothMap`, here without interpolation.
    unknown : the value of cells never observed.
    points : float64, shape (n, 2), tracking frame [m]; n > 0.
    estimate : float64, shape (3,), tf_submap_scan, the centre of the window.
    window, scratch : fields of a `CorrelativeWindow` and of `CorrelativeScratch`.
    out_pose : float64, shape (3,), tf_submap_scan.

    Notes
    -----
    Of equally good candidates the first counts, by rotation, then row, then column.
    """
    smooth_map = SmoothMap(grid[0], grid[1], grid[2], grid[3], grid[4])
    limits = CorrelativeWindow(window[0], window[1], window[2], window[3], window[4])
    places, grid_cells = scratch
    map_cells, resolution = smooth_map.cells, smooth_map.resolution
    half_width, half_num_rotations = limits.half_width, limits.half_num_rotations
    step = limits.rotation_step
    num_points, num_rotations = points.shape[0], 2 * half_num_rotations + 1
    count = num_rotations * num_points
    all_cols, all_rows = places[:count], places[count : 2 * count]
    cols = all_cols.reshape((num_rotations, num_points))
    rows = all_rows.reshape((num_rotations, num_points))
    index = places[2 * count : 3 * count]
    by_axis = points.T.copy()
    for j in range(num_rotations):
        theta = estimate[2] + (j - half_num_rotations) * step
        place_points(smooth_map, by_axis, estimate[0], estimate[1], theta, cols[j], rows[j])
    num_rows, num_cols = map_cells.shape
    part = index_points(all_cols, all_rows, half_width, num_cols, num_rows, index)
    area = part.row_length * part.num_rows
    sizes = box_sizes(2 * half_width + 1)
    cells = grid_cells[: sizes.size * area]
    bounding_grids(map_cells, unknown, part, sizes, cells)
    num_higher, least = np.empty(num_rotations, dtype=np.int64), least_byte(unknown)
    boxes = RotationBoxes(cells, index, num_higher, least, sizes, area, part.row_length)
    # A sum of bytes times its rotation's factor is no less than the score of any candidate in the
    # box times its penalty, although that score is a rounded sum of float32.
    rounding = 1.0 + ROUNDING * (num_points + _EXTRA_ROUNDINGS)
    factors, bounds = np.empty(num_rotations), np.empty(num_rotations)
    for j in range(num_rotations):
        delta = limits.rotation_weight * abs((j - half_num_rotations) * step)
        factors[j] = math.exp(-delta * delta) * rounding / (MAX_BYTE * num_points)
        total, num_higher[j] = keep_higher(cells, index, j * num_points, num_points, least)
        bounds[j] = total * factors[j]
    stack = np.empty(4 * sizes.size + 1, dtype=np.int64)
    best, steps = np.zeros(3), np.zeros(3, dtype=np.int64)
    best[WEIGHTED] = -1.0
    for j in order_by_key(bounds.reshape((num_rotations, 1)), 0, num_rotations):
        if bounds[j] < best[WEIGHTED]:
            break
        search_rotation(
            map_cells, unknown, resolution, boxes, cols[j], rows[j], limits, j, factors[j], stack,
            best, steps,
        )  # fmt: skip
    out_pose[0] = estimate[0] + steps[0] * resolution
    out_pose[1] = estimate[1] + steps[1] * resolution
    out_pose[2] = estimate[2] + steps[2] * step
    return float(best[SCORE])
