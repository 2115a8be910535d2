# SPDX-License-Identifier: Apache-2.0
"""M_smooth of (CS) and its gradient at all points of a scan: bicubic interpolation, or smoothing.

Each step processes all points before the next begins. The arithmetic steps have no branches and
read neighbouring points from neighbouring memory, so that the compiler vectorises them.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cartoloop._jit import borrowing_kernel, kernel
from cartoloop.arrays import FloatArray, IntArray

PatchArray = NDArray[np.float32]

ARM_X, ARM_Y, BEYOND_COL, BEYOND_ROW, VALUE, D_COL, D_ROW, ERROR, J_X, J_Y, J_THETA = range(11)
"""Rows of `samples`: arm from the scan's origin to the point, in the submap's axes [m]; offset of
the point from the centre of the cell below it, along columns and rows [cells]; M_smooth, and its
derivatives along columns and rows [1/cell]; the residual of (CS), and its derivatives along x, y
[1/m] and theta [1/rad], which :mod:`cartoloop.kernels.scan_residuals` writes."""

NUM_ROWS = 11
"""Number of rows of `samples`."""

NOWHERE = np.iinfo(np.int64).max
"""No column and no row of a cell: no rounded number is equal to it."""

PATCH_CELLS = 16
"""Number of rows of `patches`: the 4 x 4 cells around a point, row after row."""


class SmoothMap(NamedTuple):
    """The occupancy grid that M_smooth interpolates.

    Attributes
    ----------
    cells : float32, shape (num_rows, num_cols), probabilities; 0 or less where never observed.
    origin_x, origin_y : centre of cell (0, 0) [m, submap frame].
    resolution : edge of a cell [m].
    smoothing : from 0, cells are interpolated (Catmull-Rom), to 1, they are smoothed by a cubic
        B-spline, a bell with a standard deviation of 0.58 cells: B of Mitchell and Netravali
        (Reconstruction filters in computer graphics, SIGGRAPH 1988), with C = (1 - B) / 2.
    """

    cells: PatchArray
    origin_x: float
    origin_y: float
    resolution: float
    smoothing: float = 0.0


SmoothMapFields = tuple[PatchArray, float, float, float, float]
"""The fields of a `SmoothMap` as a plain tuple, ``smooth_map[:]``: for calls from Python, where a
NamedTuple costs a microsecond more."""


class PointScratch(NamedTuple):
    """Memory to evaluate n points in.

    Attributes
    ----------
    cells : int64, shape (2, n), column and row of the cell below each point.
    copied : int64, shape (2, n), the same of the cells around which `patches` are: of one map.
    patches : float32, shape (16, n), the 4 x 4 cells around each point; 0 outside of the grid.
    samples : float64, shape (11, n), see :data:`NUM_ROWS`.
    """

    cells: IntArray
    copied: IntArray
    patches: PatchArray
    samples: FloatArray


@kernel
def point_scratch(num_points: int) -> PointScratch:
    """Return memory to evaluate points in, without any patches."""
    return PointScratch(
        np.empty((2, num_points), dtype=np.int64),
        np.full((2, num_points), NOWHERE, dtype=np.int64),
        np.empty((PATCH_CELLS, num_points), dtype=np.float32),
        np.empty((NUM_ROWS, num_points), dtype=np.float64),
    )


@borrowing_kernel
def place_points(
    smooth_map: SmoothMap,
    points: FloatArray,
    x: float,
    y: float,
    theta: float,
    out_samples: FloatArray,
    out_cells: IntArray,
) -> None:
    """Write the positions of the points, with the scan at a pose, into the `out_` arrays.

    Parameters
    ----------
    smooth_map : only its frame is used.
    points : float64, shape (n, 2), tracking frame [m].
    x, y, theta : tf_submap_scan.
    out_samples : float64, shape (11, n); the first four rows are written.
    out_cells : int64, shape (2, n), column and row of the cell below each point.
    """
    origin_x, origin_y = smooth_map.origin_x, smooth_map.origin_y
    c = math.cos(theta)
    s = math.sin(theta)
    scale = 1.0 / smooth_map.resolution
    flat = points.reshape(-1)  # vectorised only with a stride that is known
    for k in range(points.shape[0]):
        arm_x = c * flat[2 * k] - s * flat[2 * k + 1]
        arm_y = s * flat[2 * k] + c * flat[2 * k + 1]
        col = (x + arm_x - origin_x) * scale
        row = (y + arm_y - origin_y) * scale
        below_col = np.floor(col)
        below_row = np.floor(row)
        out_samples[ARM_X, k] = arm_x
        out_samples[ARM_Y, k] = arm_y
        out_samples[BEYOND_COL, k] = col - below_col
        out_samples[BEYOND_ROW, k] = row - below_row
        out_cells[0, k] = np.int64(below_col)
        out_cells[1, k] = np.int64(below_row)


@borrowing_kernel
def copy_patches(
    grid: PatchArray, cells: IntArray, copied: IntArray, out_patches: PatchArray
) -> bool:
    """Write the 4 x 4 cells around each point into `out_patches`; return if all patches are inside.

    Poses that are tried in turn are nearer and nearer to each other: most points stay in a cell.

    Parameters
    ----------
    grid : float32, shape (num_rows, num_cols), probabilities; 0 or less where never observed.
    cells : int64, shape (2, n), column and row of the cell below each point.
    copied : int64, shape (2, n), the same of what is in `out_patches` already; is updated.
    out_patches : float32, shape (16, n); 0 outside of the grid.
    """
    num_rows, num_cols = grid.shape
    num_points = cells.shape[1]
    flat, patches = grid.reshape(-1), out_patches.reshape(-1)
    stride, length = np.uint64(num_points), np.uint64(num_cols)
    one, two, three = np.uint64(1), np.uint64(2), np.uint64(3)
    all_inside = True
    for k in range(num_points):
        col = cells[0, k] - 1
        row = cells[1, k] - 1
        is_inside = col >= 0 and row >= 0 and col + 3 < num_cols and row + 3 < num_rows
        all_inside = all_inside and is_inside
        if cells[0, k] == copied[0, k] and cells[1, k] == copied[1, k]:
            continue
        copied[0, k], copied[1, k] = cells[0, k], cells[1, k]
        if is_inside:
            # Unsigned indices: no test for those that count from the end.
            at = np.uint64(row * num_cols + col)
            to = np.uint64(k)
            for _ in range(4):
                patches[to] = flat[at]
                patches[to + stride] = flat[at + one]
                patches[to + two * stride] = flat[at + two]
                patches[to + three * stride] = flat[at + three]
                at += length
                to += np.uint64(4) * stride
            continue
        for i in range(4):
            for j in range(4):
                value = np.float32(0.0)
                if 0 <= row + i < num_rows and 0 <= col + j < num_cols:
                    value = grid[row + i, col + j]
                out_patches[4 * i + j, k] = value
    return all_inside


@kernel
def cubic_weights(u: float, smoothing: float) -> tuple[float, float, float, float]:
    """Return the weights of the four cells around an offset `u` in [0, 1) cells."""
    sixth = smoothing / 6.0
    return (
        (((-0.5 + 2.0 * sixth) * u + (1.0 - 3.0 * sixth)) * u - 0.5) * u + sixth,
        ((1.5 - smoothing) * u + (-2.5 + 1.5 * smoothing)) * u * u + (1.0 - 2.0 * sixth),
        (((-1.5 + smoothing) * u + (2.0 - 1.5 * smoothing)) * u + 0.5) * u + sixth,
        ((0.5 - 2.0 * sixth) * u + (-0.5 + 0.5 * smoothing)) * u * u,
    )


@kernel
def cubic_slopes(u: float, smoothing: float) -> tuple[float, float, float, float]:
    """Return the derivatives of :func:`cubic_weights`."""
    return (
        ((-1.5 + smoothing) * u + (2.0 - smoothing)) * u - 0.5,
        ((4.5 - 3.0 * smoothing) * u + (-5.0 + 3.0 * smoothing)) * u,
        ((-4.5 + 3.0 * smoothing) * u + (4.0 - 3.0 * smoothing)) * u + 0.5,
        ((1.5 - smoothing) * u + (-1.0 + smoothing)) * u,
    )


@kernel
def along_row(
    p0: np.float32,
    p1: np.float32,
    p2: np.float32,
    p3: np.float32,
    unknown: float,
    weights: tuple[float, float, float, float],
    slopes: tuple[float, float, float, float],
) -> tuple[float, float]:
    """Return four cells of a row interpolated, and the derivative along it."""
    a = np.float64(p0) if p0 > 0.0 else unknown
    b = np.float64(p1) if p1 > 0.0 else unknown
    c = np.float64(p2) if p2 > 0.0 else unknown
    d = np.float64(p3) if p3 > 0.0 else unknown
    return (
        weights[0] * a + weights[1] * b + weights[2] * c + weights[3] * d,
        slopes[0] * a + slopes[1] * b + slopes[2] * c + slopes[3] * d,
    )


@borrowing_kernel
def interpolate_patches(
    p: PatchArray, unknown: float, smoothing: float, samples: FloatArray
) -> None:
    """Write M_smooth and its derivatives at the points into `samples`.

    Parameters
    ----------
    p : float32, shape (16, n), the cells around each point; 0 or less where never observed.
    unknown : the value of cells never observed.
    smoothing : as in :class:`SmoothMap`.
    samples : float64, shape (11, n), offsets of the points in their cells; the rows of M_smooth and
        of its derivatives are written.
    """
    for k in range(samples.shape[1]):
        u, v = samples[BEYOND_COL, k], samples[BEYOND_ROW, k]
        weights, slopes = cubic_weights(u, smoothing), cubic_slopes(u, smoothing)
        a0, s0 = along_row(p[0, k], p[1, k], p[2, k], p[3, k], unknown, weights, slopes)
        a1, s1 = along_row(p[4, k], p[5, k], p[6, k], p[7, k], unknown, weights, slopes)
        a2, s2 = along_row(p[8, k], p[9, k], p[10, k], p[11, k], unknown, weights, slopes)
        a3, s3 = along_row(p[12, k], p[13, k], p[14, k], p[15, k], unknown, weights, slopes)
        w0, w1, w2, w3 = cubic_weights(v, smoothing)
        d0, d1, d2, d3 = cubic_slopes(v, smoothing)
        samples[VALUE, k] = w0 * a0 + w1 * a1 + w2 * a2 + w3 * a3
        samples[D_COL, k] = w0 * s0 + w1 * s1 + w2 * s2 + w3 * s3
        samples[D_ROW, k] = d0 * a0 + d1 * a1 + d2 * a2 + d3 * a3


@borrowing_kernel
def sample_smooth_map(
    smooth_map: SmoothMap,
    unknown: float,
    points: FloatArray,
    x: float,
    y: float,
    theta: float,
    scratch: PointScratch,
) -> None:
    """Write M_smooth and its derivatives at the points into `scratch.samples`.

    Parameters
    ----------
    smooth_map : the occupancy grid.
    unknown : the value of cells never observed or outside.
    points, x, y, theta : as in :func:`place_points`.
    scratch : for as many points; the derivatives in `samples` are per cell.
    """
    grid, cells, out_samples = smooth_map.cells, scratch.cells, scratch.samples
    place_points(smooth_map, points, x, y, theta, out_samples, cells)
    all_inside = copy_patches(grid, cells, scratch.copied, scratch.patches)
    interpolate_patches(scratch.patches, unknown, smooth_map.smoothing, out_samples)
    if all_inside:
        return
    num_rows, num_cols = grid.shape
    for k in range(cells.shape[1]):
        col, row = cells[0, k], cells[1, k]
        if col < -2 or row < -2 or col > num_cols or row > num_rows:
            # Only unknown cells: constant, without the rounding errors of sixteen weights.
            out_samples[VALUE, k] = unknown
            out_samples[D_COL, k] = 0.0
            out_samples[D_ROW, k] = 0.0


@borrowing_kernel
def smooth_value(smooth_map: SmoothMap, unknown: float, x: float, y: float) -> float:
    """Return M_smooth at one position [m], to the last bit as :func:`sample_smooth_map` does."""
    grid = smooth_map.cells
    num_rows, num_cols = grid.shape
    scale = 1.0 / smooth_map.resolution
    col, row = (x - smooth_map.origin_x) * scale, (y - smooth_map.origin_y) * scale
    below_col, below_row = np.floor(col), np.floor(row)
    first_col, first_row = np.int64(below_col) - 1, np.int64(below_row) - 1
    if first_col < -3 or first_row < -3 or first_col >= num_cols or first_row >= num_rows:
        return unknown
    weights = cubic_weights(col - below_col, smooth_map.smoothing)
    of_rows = cubic_weights(row - below_row, smooth_map.smoothing)
    value = 0.0
    for i in range(4):
        along = 0.0
        for j in range(4):
            cell = np.float32(0.0)
            if 0 <= first_row + i < num_rows and 0 <= first_col + j < num_cols:
                cell = grid[first_row + i, first_col + j]
            along += weights[j] * (np.float64(cell) if cell > 0.0 else unknown)
        value += of_rows[i] * along
    return value
