# SPDX-License-Identifier: Apache-2.0
"""The slow, obvious twin of kernels/voxel_filter.py."""

from __future__ import annotations

import math


def naive_voxel_filter(points, edge):
    """Return the first of the points in each cell, in their order."""
    seen = set()
    kept = []
    for x, y in points:
        cell = (math.floor(x / edge), math.floor(y / edge))
        if cell not in seen:
            seen.add(cell)
            kept.append((x, y))
    return kept
