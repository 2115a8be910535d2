# SPDX-License-Identifier: Apache-2.0
"""Which grid points a scan hits and misses (section IV-B, figure 2), and eq. (2) and (3) for them.

Cells are named by their lattice coordinates (column, row) = (x, y) / r rounded: the grid points of
all grids of one resolution in one frame are the same lattice, so the cells of a scan are found
once and applied to every submap that the scan is inserted into.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cartoloop._jit import kernel

FloatArray = NDArray[np.float64]
CellArray = NDArray[np.int32]

SUBPIXELS = 2048
"""Ray ends are rounded to this fraction of a pixel, so that the traversal is exact in integers."""

_HIT = np.uint8(1)
_MISS = np.uint8(2)


@kernel
def scan_cells(
    origin_x: float,
    origin_y: float,
    returns: FloatArray,
    misses: FloatArray,
    resolution: float,
    marks: NDArray[np.uint8],
    first_col: int,
    first_row: int,
    out_cells: CellArray,
) -> tuple[int, int]:
    """Write the hits, then the misses of a scan into `out_cells`; return how many hits and cells.

    Parameters
    ----------
    origin_x, origin_y : the rays' common start, in the grid's frame [m].
    returns : float64, shape (n, 2), ends of rays that hit something, grid frame [m].
    misses : float64, shape (k, 2), ends of rays that did not, grid frame [m].
    resolution : pixel edge r [m].
    marks : uint8, shape (num_rows, num_cols), covers origin and ends; zero before and after.
    first_col, first_row : lattice coordinates of ``marks[0, 0]``.
    out_cells : int32, shape (>= num_rows * num_cols, 2), lattice (column, row), each cell once.

    Notes
    -----
    The hit set wins over the miss set; a miss is every pixel that a ray intersects. A ray through
    a corner common to four pixels passes from one to the opposite one.
    """
    num_cells = 0
    for k in range(returns.shape[0]):
        col = np.int64(np.floor(returns[k, 0] / resolution + 0.5)) - first_col
        row = np.int64(np.floor(returns[k, 1] / resolution + 0.5)) - first_row
        if marks[row, col] == 0:
            marks[row, col] = _HIT
            out_cells[num_cells, 0] = col
            out_cells[num_cells, 1] = row
            num_cells += 1
    num_hits = num_cells
    shift = 0.5
    start_x = int(np.floor((origin_x / resolution + shift - first_col) * SUBPIXELS))
    start_y = int(np.floor((origin_y / resolution + shift - first_row) * SUBPIXELS))
    for ray in range(returns.shape[0] + misses.shape[0]):
        if ray < returns.shape[0]:
            end_x = returns[ray, 0]
            end_y = returns[ray, 1]
        else:
            end_x = misses[ray - returns.shape[0], 0]
            end_y = misses[ray - returns.shape[0], 1]
        num_cells = mark_ray(
            start_x,
            start_y,
            int(np.floor((end_x / resolution + shift - first_col) * SUBPIXELS)),
            int(np.floor((end_y / resolution + shift - first_row) * SUBPIXELS)),
            marks,
            out_cells,
            num_cells,
        )
    for k in range(num_cells):
        marks[out_cells[k, 1], out_cells[k, 0]] = 0
        out_cells[k, 0] += first_col
        out_cells[k, 1] += first_row
    return num_hits, num_cells


@kernel
def mark_ray(
    start_x: int,
    start_y: int,
    end_x: int,
    end_y: int,
    marks: NDArray[np.uint8],
    out_cells: CellArray,
    num_cells: int,
) -> int:
    """Mark and append the yet unmarked cells that a ray intersects; return the new number of cells.

    Parameters
    ----------
    start_x, start_y, end_x, end_y : in subpixels from the corner of ``marks[0, 0]``.
    marks : uint8, shape (num_rows, num_cols), 0 where not yet listed.
    out_cells : int32, shape (n, 2), (column, row) within `marks`.
    num_cells : how many are listed so far.

    Notes
    -----
    Amanatides and Woo's traversal; the next border crossed is found from the sign of an integer.
    """
    col = start_x // SUBPIXELS
    row = start_y // SUBPIXELS
    last_col = end_x // SUBPIXELS
    last_row = end_y // SUBPIXELS
    delta_x = end_x - start_x
    delta_y = end_y - start_y
    step_col = 1 if delta_x >= 0 else -1
    step_row = 1 if delta_y >= 0 else -1
    length_x = abs(delta_x)
    length_y = abs(delta_y)
    if step_col > 0:
        to_border_x = (col + 1) * SUBPIXELS - start_x
    else:
        to_border_x = start_x - col * SUBPIXELS
    if step_row > 0:
        to_border_y = (row + 1) * SUBPIXELS - start_y
    else:
        to_border_y = start_y - row * SUBPIXELS
    # Negative while the next vertical border is nearer along the ray than the next horizontal one.
    order = to_border_x * length_y - to_border_y * length_x
    remaining = abs(last_col - col) + abs(last_row - row)
    while True:
        if marks[row, col] == 0:
            marks[row, col] = _MISS
            out_cells[num_cells, 0] = col
            out_cells[num_cells, 1] = row
            num_cells += 1
        if remaining <= 0:
            return num_cells
        if order < 0:
            col += step_col
            order += SUBPIXELS * length_y
            remaining -= 1
        elif order > 0:
            row += step_row
            order -= SUBPIXELS * length_x
            remaining -= 1
        elif remaining > 1:
            col += step_col
            row += step_row
            order += SUBPIXELS * (length_y - length_x)
            remaining -= 2
        else:
            # The ray ends in a corner, which belongs to a pixel beside this one.
            col = last_col
            row = last_row
            remaining = 0


@kernel
def update_cells(
    grid: NDArray[np.float32],
    first_col: int,
    first_row: int,
    cells: CellArray,
    num_hits: int,
    num_cells: int,
    hit_probability: float,
    miss_probability: float,
    min_probability: float,
    max_probability: float,
) -> None:
    """Write hits and misses into a probability grid by eq. (2) and (3).

    Parameters
    ----------
    grid : float32, shape (num_rows, num_cols), probabilities, 0 where never observed; changed in
        place.
    first_col, first_row : lattice coordinates of ``grid[0, 0]``.
    cells : int32, shape (>= num_cells, 2), lattice (column, row); the first `num_hits` are hits.
    """
    hit_odds = hit_probability / (1.0 - hit_probability)
    miss_odds = miss_probability / (1.0 - miss_probability)
    for k in range(num_cells):
        row = cells[k, 1] - first_row
        col = cells[k, 0] - first_col
        p: float = np.float64(grid[row, col])
        if p == 0.0:
            p = hit_probability if k < num_hits else miss_probability
        else:
            odds = p / (1.0 - p) * (hit_odds if k < num_hits else miss_odds)
            p = odds / (1.0 + odds)
        grid[row, col] = np.float32(min(max(p, min_probability), max_probability))
