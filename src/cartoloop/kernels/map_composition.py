# SPDX-License-Identifier: Apache-2.0
"""One map of many submaps: the evidence of all of them adds up, each at its optimised pose."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cartoloop._jit import kernel


@kernel
def add_submap(
    cells: NDArray[np.uint8],
    evidence: NDArray[np.float32],
    affine: NDArray[np.float64],
    window: NDArray[np.int64],
    out_sum: NDArray[np.float32],
    out_known: NDArray[np.bool_],
) -> None:
    """Add a submap's evidence to a map, in place: `out_sum` and `out_known`.

    Parameters
    ----------
    cells : uint8, shape (rows, cols), 0 unknown; the outermost rows and columns must be unknown.
    evidence : float32, shape (256,), log-odds that a cell of each value adds; 0 for value 0.
    affine : float64, shape (6,); map cell (row, col) lies at submap column
        ``affine[0] + affine[1] * col + affine[2] * row`` and row ``affine[3] + ...`` [cells].
    window : int64, shape (4,), first row, end row, first column, end column of the map cells that
        can lie in the submap.
    out_sum : float32, shape (map rows, map cols), sum of log-odds.
    out_known : bool, same shape, whether any submap has seen the cell.

    Notes
    -----
    Where the nearest submap cell has been seen, the log-odds are interpolated bilinearly, unknown
    neighbours adding nothing: taking the nearest alone frays walls that stand oblique, and
    interpolating probabilities would let a doubt outweigh a certainty. O(cells of the window).
    """
    last_col = cells.shape[1] - 1
    last_row = cells.shape[0] - 1
    for row in range(window[0], window[1]):
        u_start = affine[0] + affine[2] * row
        v_start = affine[3] + affine[5] * row
        for col in range(window[2], window[3]):
            u = u_start + affine[1] * col
            v = v_start + affine[4] * col
            if u < 0.0 or v < 0.0 or u >= last_col or v >= last_row:
                continue
            u_cell = np.int64(u)  # floor, for none is negative
            v_cell = np.int64(v)
            fraction_u = u - u_cell
            fraction_v = v - v_cell
            nearest_u = u_cell + 1 if fraction_u >= 0.5 else u_cell
            nearest_v = v_cell + 1 if fraction_v >= 0.5 else v_cell
            if cells[nearest_v, nearest_u] == 0:
                continue
            lower = (1.0 - fraction_u) * evidence[cells[v_cell, u_cell]] + fraction_u * evidence[
                cells[v_cell, u_cell + 1]
            ]
            upper = (1.0 - fraction_u) * evidence[cells[v_cell + 1, u_cell]] + fraction_u * (
                evidence[cells[v_cell + 1, u_cell + 1]]
            )
            out_sum[row, col] += np.float32((1.0 - fraction_v) * lower + fraction_v * upper)
            out_known[row, col] = True
