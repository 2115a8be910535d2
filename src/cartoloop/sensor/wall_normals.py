# SPDX-License-Identifier: Apache-2.0
"""Which way the walls face that a scan sees: along a corridor none does."""

from __future__ import annotations

import numpy as np

from cartoloop.arrays import FloatArray

CORRIDOR_RATIO = 0.1
"""Information along a corridor over that across, by the normals of walls: below it a twentieth of
the returns at most are on walls that face along it."""


def normal_ratio(points: FloatArray, max_range: float) -> float:
    """Return the ratio of the eigenvalues of the walls' normals; 1 where too little is seen.

    Parameters
    ----------
    points : float64, shape (n, 2), thinned returns, frame of the scanner [m].
    max_range : farther ones are not used [m].
    """
    near = points[np.hypot(points[:, 0], points[:, 1]) < max_range]
    order = np.argsort(np.arctan2(near[:, 1], near[:, 0]), kind="stable")
    edges = np.diff(near[order], axis=0)
    lengths = np.hypot(edges[:, 0], edges[:, 1])
    is_wall = (lengths < 1.2) & (lengths > 0.02)
    if np.count_nonzero(is_wall) < 8:
        return 1.0
    normals = edges[is_wall] / lengths[is_wall, np.newaxis]
    low, high = np.linalg.eigvalsh(normals.T @ normals)
    return float(low / high)
