# SPDX-License-Identifier: Apache-2.0
"""The slow, obvious twin of kernels/wall_directions.py: lines by singular value decomposition."""

from __future__ import annotations

import numpy as np

from cartoloop.kernels.wall_directions import MAX_OFFSET_M, REACH_M, SPARSE_REACH_M


def naive_wall_directions(points):
    """Return the angle of the straight wall at each point; NaN where there is none."""
    return np.array([_direction(points, k) for k in range(len(points))])


def _direction(points, k):
    distances = np.linalg.norm(points - points[k], axis=1)
    sides = [range(k - 1, -1, -1), range(k + 1, len(points))]
    chosen = [k]
    for side in sides:
        before = len(chosen)
        for number, j in enumerate(side):
            if distances[j] > (SPARSE_REACH_M if number == 0 else REACH_M):
                break
            chosen.append(j)
        if len(chosen) == before:
            return np.nan
    near = points[chosen]
    _, sizes, axes = np.linalg.svd(near - near.mean(axis=0), full_matrices=False)
    normal = axes[1]
    offset = abs((points[k] - near.mean(axis=0)) @ normal)
    if sizes[1] / np.sqrt(len(near)) > MAX_OFFSET_M or offset > MAX_OFFSET_M:
        return np.nan
    return np.arctan2(axes[0, 1], axes[0, 0])
