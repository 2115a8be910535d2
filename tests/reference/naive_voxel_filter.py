# SPDX-License-Identifier: Apache-2.0
"""The slow, obvious twin of kernels/voxel_filter.py."""

from __future__ import annotations

import math


def naive_voxel_filter(points, edge):
    """Return the middle one of the points in each cell, in their order."""
    members = {}
    for k, (x, y) in enumerate(points):
        members.setdefault((math.floor(x / edge), math.floor(y / edge)), []).append(k)
    kept = [
        own[len(own) // 2 if len(own) % 2 or (column + row) % 2 else len(own) // 2 - 1]
        for (column, row), own in members.items()
    ]
    return [tuple(points[k]) for k in sorted(kept)]
