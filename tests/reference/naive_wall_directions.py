# SPDX-License-Identifier: Apache-2.0
"""The slow, obvious twin of kernels/wall_directions.py: lines by singular value decomposition."""

from __future__ import annotations

import numpy as np

from cartoloop.kernels.wall_directions import (
    MAX_OFFSET_M,
    MAX_SPACING_RATIO,
    REACH_M,
    SPARSE_REACH_M,
)


def naive_wall_directions(points):
    """Return the angle of the straight wall at each point; NaN where there is none."""
    return np.array([_direction(points, k) for k in range(len(points))])


def _direction(points, k):
    if k in (0, len(points) - 1):
        return np.nan
    distances = np.linalg.norm(points - points[k], axis=1)
    nearer, farther = sorted(distances[[k - 1, k + 1]])
    is_sparse = farther <= MAX_SPACING_RATIO * nearer and farther <= SPARSE_REACH_M
    if farther > REACH_M and not is_sparse:
        return np.nan
    chosen = [k - 1, k, k + 1]
    for side in (range(k - 2, -1, -1), range(k + 2, len(points))):
        for j in side:
            if distances[j] > REACH_M:
                break
            chosen.append(j)
    near = points[chosen]
    _, sizes, axes = np.linalg.svd(near - near.mean(axis=0), full_matrices=False)
    normal = axes[1]
    offset = abs((points[k] - near.mean(axis=0)) @ normal)
    if sizes[1] / np.sqrt(len(near)) > MAX_OFFSET_M or offset > MAX_OFFSET_M:
        return np.nan
    return np.arctan2(axes[0, 1], axes[0, 0])
