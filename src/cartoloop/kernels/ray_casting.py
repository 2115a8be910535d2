# SPDX-License-Identifier: Apache-2.0
"""The grid points that a scan hits and misses (section IV-B, figure 2).

Cells are named by their lattice coordinates (column, row) = (x, y) / r rounded: the grid points of
all grids of one resolution in one frame are the same lattice, so the cells of a scan are found
once and applied to every submap that the scan is inserted into.
"""

from __future__ import annotations

import math

import numpy as np

from cartoloop._jit import kernel
from cartoloop.arrays import CellArray, FloatArray, IntArray
from cartoloop.kernels.pixel_rows import (
    PixelRows,
    RunArray,
    add_span,
    has_pixel,
    list_runs,
    pixels_across,
    remove_pixel,
    words_across,
)
from cartoloop.kernels.ray_fan import SUBPIXELS, mark_rays

FARTHEST = 1 << 30
"""Largest lattice coordinate [cells]: differences of two still fit into int32."""

MAX_CELLS = 1 << 27
"""Largest number of cells of a submap: a square of 500 m at 0.05 m. More means a wrong pose."""


@kernel
def scan_cells(
    origin_x: float,
    origin_y: float,
    returns: FloatArray,
    misses: FloatArray,
    behind: FloatArray,
    resolution: float,
    uncertain_length: float,
    uncertain_share: float,
) -> tuple[CellArray, RunArray, CellArray, int, int, int, int]:
    """Return the disjoint sets of cells that a scan says something of, and the box around them.

    Parameters
    ----------
    origin_x, origin_y : the rays' common start, in the grid's frame [m].
    returns : float64, shape (n, 2), ends of rays that hit something, grid frame [m].
    misses : float64, shape (k, 2), ends of rays that did not, grid frame [m].
    behind : float64, shape (m, 2), points just behind walls, grid frame [m].
    resolution : pixel edge r [m].
    uncertain_length, uncertain_share : so much of a ray in front of its return may lie behind what
        was hit: a length [m] and a share of the ray, their squares added.

    Returns
    -------
    hits : int32, shape (h, 2), lattice (column, row), each cell once.
    free : int32, shape (f, 3), the misses, as runs along rows: row, first column, column after the
        last.
    hidden : int32, shape (b, 2), lattice (column, row), each cell once: those of `behind` that are
        within the box, and neither hit nor missed.
    first_col, first_row, last_col, last_row : lattice box around origin and ends, clipped to
        `FARTHEST`.

    Notes
    -----
    A miss is every pixel that the certain part of a ray intersects and that is not a hit. All sets
    are empty where the box reaches beyond `FARTHEST` or has more than `MAX_CELLS` cells.
    """
    first_col, last_col = _lattice_range(origin_x, returns[:, 0], misses[:, 0], resolution)
    first_row, last_row = _lattice_range(origin_y, returns[:, 1], misses[:, 1], resolution)
    if not fits(first_col, first_row, last_col, last_row):
        nowhere = np.empty((0, 2), dtype=np.int32), np.empty((0, 3), dtype=np.int32)
        return *nowhere, nowhere[0], first_col, first_row, last_col, last_row
    ends = np.empty((returns.shape[0] + misses.shape[0], 2), dtype=np.int64)
    uncertain = _uncertain_shares(origin_x, origin_y, returns, uncertain_length, uncertain_share)
    for axis, origin, first in ((0, origin_x, first_col), (1, origin_y, first_row)):
        _ray_ends(
            origin, returns[:, axis], misses[:, axis], resolution, first, uncertain, ends[:, axis]
        )
    num_words = words_across(last_col - first_col + 1)
    marked = np.zeros((last_row - first_row + 1, num_words), dtype=np.uint32)
    num_spans = mark_rays(
        _subpixels(origin_x, resolution, first_col),
        _subpixels(origin_y, resolution, first_row),
        ends,
        marked,
    )
    hits = np.empty((returns.shape[0], 2), dtype=np.int32)
    _mark_hits(returns, resolution, first_col, first_row, marked, hits)
    hidden = _unmarked(behind, resolution, first_col, first_row, marked)
    num_hits = _take_hits(first_col, first_row, marked, hits)
    # A run begins where a span does, or after a hit.
    free = np.empty((num_spans + num_hits, 3), dtype=np.int32)
    num_runs = list_runs(marked, free)
    for k in range(num_runs):
        free[k, 0] += first_row
        free[k, 1] += first_col
        free[k, 2] += first_col
    return hits[:num_hits], free[:num_runs], hidden, first_col, first_row, last_col, last_row


@kernel
def _uncertain_shares(
    origin_x: float, origin_y: float, returns: FloatArray, length: float, share: float
) -> FloatArray:
    """Return the share of each ray to a return, in front of that, which is not known to be free."""
    shares = np.empty(returns.shape[0])
    for k in range(returns.shape[0]):
        squared_ray = (returns[k, 0] - origin_x) ** 2 + (returns[k, 1] - origin_y) ** 2
        uncertain = length**2 + share**2 * squared_ray
        shares[k] = math.sqrt(uncertain / squared_ray) if uncertain < squared_ray else 1.0
    return shares


@kernel
def _ray_ends(
    origin: float,
    returns: FloatArray,
    misses: FloatArray,
    resolution: float,
    first: int,
    uncertain: FloatArray,
    out_ends: IntArray,
) -> None:
    """Write up to where rays are free along an axis [subpixels], those with a return first."""
    num_returns = returns.shape[0]
    for k in range(num_returns):
        certain = returns[k] - uncertain[k] * (returns[k] - origin)
        out_ends[k] = _subpixels(certain, resolution, first)
    for k in range(misses.shape[0]):
        out_ends[num_returns + k] = _subpixels(misses[k], resolution, first)


@kernel
def _lattice_range(
    origin: float, returns: FloatArray, misses: FloatArray, resolution: float
) -> tuple[int, int]:
    """Return the first and last lattice coordinate of a box around origin and ends."""
    low = high = origin
    for k in range(returns.shape[0]):
        low, high = min(low, returns[k]), max(high, returns[k])
    for k in range(misses.shape[0]):
        low, high = min(low, misses[k]), max(high, misses[k])
    return _lattice_coordinate(low / resolution) - 1, _lattice_coordinate(high / resolution) + 1


@kernel
def _lattice_coordinate(cells: float) -> int:
    """Return the coordinate rounded down, clipped to `FARTHEST`, which also stands for NaN."""
    below = np.floor(cells)
    if not abs(below) < FARTHEST:
        return -FARTHEST if below < 0.0 else FARTHEST
    return int(below)


@kernel
def fits(first_col: int, first_row: int, last_col: int, last_row: int) -> bool:
    """Return whether a box, given by its first and last cells, is small enough for a submap."""
    if min(first_col, first_row) < -FARTHEST or max(last_col, last_row) > FARTHEST:
        return False
    return bool((last_col - first_col + 1) * (last_row - first_row + 1) <= MAX_CELLS)


@kernel
def _subpixels(coordinate: float, resolution: float, first: int) -> int:
    """Return a coordinate [m] in subpixels from the lower border of the first pixel."""
    return int(np.floor((coordinate / resolution + 0.5 - first) * SUBPIXELS))


@kernel
def _mark_hits(
    returns: FloatArray,
    resolution: float,
    first_col: int,
    first_row: int,
    out_marked: PixelRows,
    out_hits: CellArray,
) -> None:
    """Write the cells of the returns, and mark them."""
    for k in range(returns.shape[0]):
        col = int(np.floor(returns[k, 0] / resolution + 0.5))
        row = int(np.floor(returns[k, 1] / resolution + 0.5))
        out_hits[k, 0] = col
        out_hits[k, 1] = row
        # Its ray has marked it already, if it was not rounded to another pixel, or ends before it.
        add_span(out_marked, row - first_row, col - first_col, col - first_col)


@kernel
def _unmarked(
    points: FloatArray, resolution: float, first_col: int, first_row: int, marked: PixelRows
) -> CellArray:
    """Return the cells of points that are within the box and not marked, each once."""
    num_rows, num_cols = marked.shape[0], pixels_across(marked)
    cells = np.empty((points.shape[0], 2), dtype=np.int32)
    num_cells = 0
    for k in range(points.shape[0]):
        col = int(np.floor(points[k, 0] / resolution + 0.5)) - first_col
        row = int(np.floor(points[k, 1] / resolution + 0.5)) - first_row
        if 0 <= col < num_cols and 0 <= row < num_rows and not has_pixel(marked, col, row):
            add_span(marked, row, col, col)
            cells[num_cells, 0] = col
            cells[num_cells, 1] = row
            num_cells += 1
    for k in range(num_cells):
        remove_pixel(marked, cells[k, 0], cells[k, 1])
        cells[k, 0] += first_col
        cells[k, 1] += first_row
    return cells[:num_cells]


@kernel
def _take_hits(first_col: int, first_row: int, out_marked: PixelRows, out_hits: CellArray) -> int:
    """Remove the hit cells from `out_marked`, and all but one of each from `out_hits`.

    Returns how many there are.
    """
    num_hits = 0
    for k in range(out_hits.shape[0]):
        col, row = out_hits[k, 0], out_hits[k, 1]
        if remove_pixel(out_marked, col - first_col, row - first_row):
            out_hits[num_hits, 0] = col
            out_hits[num_hits, 1] = row
            num_hits += 1
    return num_hits
