# SPDX-License-Identifier: Apache-2.0
"""Groups of points that are near to each other."""

from __future__ import annotations

import numpy as np

from cartoloop.arrays import BoolArray, FloatArray, IntArray

TILE_M = 4.0
"""Places nearer to each other than about this are one [m]."""


def clusters(points: FloatArray, tile: float = TILE_M) -> list[IntArray]:
    """Return groups of points (n, 2) [m]: those in tiles that touch, in order of the first."""
    tiles: dict[tuple[int, int], list[int]] = {}
    for row, (x, y) in enumerate(np.floor(points / tile).astype(np.int64).tolist()):
        tiles.setdefault((x, y), []).append(row)
    groups, left = [], dict(tiles)
    for start in tiles:
        if start not in left:
            continue
        group, front = left.pop(start), [start]
        while front:
            x, y = front.pop()
            for near in [(x + i, y + j) for i in (-1, 0, 1) for j in (-1, 0, 1)]:
                if near in left:
                    group = group + left.pop(near)
                    front.append(near)
        groups.append(np.array(sorted(group), dtype=np.int64))
    return groups


def in_same_tiles(points: FloatArray, others: FloatArray, tile: float = TILE_M) -> BoolArray:
    """Return which points (n, 2) [m] lie in a tile in which one of the others (k, 2) lies too."""
    tiles = {tuple(each) for each in np.floor(others / tile).astype(np.int64).tolist()}
    return np.array(
        [tuple(each) in tiles for each in np.floor(points / tile).astype(np.int64).tolist()],
        dtype=np.bool_,
    )
