# SPDX-License-Identifier: Apache-2.0
"""The slow, obvious twin of cartoloop.kernels.wall_ranges: each beam against each wall."""

from __future__ import annotations

import numpy as np


def naive_wall_ranges(walls, poses, angles, range_max):
    """Return ranges of shape (poses, beams): solve ``p + r d = a + u (b - a)`` for each pair."""
    directions = poses[:, 2, None] + angles
    dx, dy = np.cos(directions)[..., None], np.sin(directions)[..., None]
    ax = walls[:, 0] - poses[:, 0, None, None]
    ay = walls[:, 1] - poses[:, 1, None, None]
    sx, sy = walls[:, 2] - walls[:, 0], walls[:, 3] - walls[:, 1]
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        determinant = dx * sy - dy * sx
        distance = (ax * sy - ay * sx) / determinant
        along = (ax * dy - ay * dx) / determinant
        met = (determinant != 0) & (distance >= 0) & (along >= 0) & (along <= 1)
        met &= distance <= range_max
    return np.min(np.where(met, distance, np.inf), axis=2, initial=np.inf)
