# SPDX-License-Identifier: Apache-2.0
"""How far apart different visits of a map show the same sides of walls."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from cartoloop.arrays import BoolArray, FloatArray, IntArray
from cartoloop.config import QualityConfig
from cartoloop.sensor.scan_points import ScanPoints

TILE_M = 0.5
"""Walls are compared in tiles of this size [m]: in it they are straight, and poses hardly drift."""

MAX_RETURNS = 300_000
"""Returns that are compared, spread over all nodes."""

MIN_RETURNS, MIN_LENGTH_M, MAX_SPREAD_M = 5, 0.08, 0.04
"""Returns of one visit are a wall where there are this number, along a line of at least this
standard deviation, and across it of at most this one [m]."""

SAME_SIDE = math.cos(math.radians(15.0))
"""Least cosine between the normals of walls that are one: a thin wall has two sides."""


class WallPieces(NamedTuple):
    """What single visits see of walls in single tiles, n pieces.

    Attributes
    ----------
    tile : int64 (n,), number of the tile, ascending.
    visit : int64 (n,), number of the part of the path, ascending in a tile.
    middle : float64 (n, 2), mean of the returns [m, map frame].
    normal : float64 (n, 2), unit vectors towards the scanner.
    spread : float64 (n,), standard deviation of the returns across the wall [m].
    """

    tile: IntArray
    visit: IntArray
    middle: FloatArray
    normal: FloatArray
    spread: FloatArray


def wall_offsets(
    node_poses: FloatArray, scans: ScanPoints, paths: FloatArray, config: QualityConfig
) -> FloatArray:
    """Return how far apart visits show walls that they both see from one side, shape (k,) [m].

    Parameters
    ----------
    node_poses : float64 (n, 3), map frame [m, m, rad].
    scans : returns of the nodes, tracking frame [m].
    paths : path length of each node [m]; over `min_visit_path` it is another visit.
    config : limits.
    """
    pieces = wall_pieces(node_poses, scans, paths, config)
    # Of each tile, every visit is compared with the first one on its side.
    offsets: list[FloatArray] = []
    left = np.arange(len(pieces.tile))
    while len(left) > 1:
        is_first = np.append(True, np.diff(pieces.tile[left]) > 0)
        first = left[is_first][np.cumsum(is_first) - 1]
        same = np.einsum("ij,ij->i", pieces.normal[first], pieces.normal[left]) > SAME_SIDE
        others = same & (pieces.visit[left] - pieces.visit[first] > 1)
        normal = pieces.normal[first[others]] + pieces.normal[left[others]]
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        apart = pieces.middle[left[others]] - pieces.middle[first[others]]
        offsets.append(np.abs(np.einsum("ij,ij->i", apart, normal)))
        left = left[~same]
    return np.concatenate(offsets) if offsets else np.zeros(0)


def wall_pieces(
    node_poses: FloatArray, scans: ScanPoints, paths: FloatArray, config: QualityConfig
) -> WallPieces:
    """Return what each visit sees of walls in each tile."""
    points, node = _returns(node_poses, scans, config.max_range)
    tiles = np.floor(points / TILE_M).astype(np.int64)
    tiles -= tiles.min(axis=0, initial=0)
    num_rows = tiles[:, 1].max(initial=0) + 1
    visits = np.floor(paths / max(config.min_visit_path, TILE_M)).astype(np.int64)
    num_visits = visits.max(initial=0) + 1
    # One number for tile and visit: a single sort.
    keys = (tiles[:, 0] * num_rows + tiles[:, 1]) * num_visits + visits[node]
    order = np.argsort(keys, kind="stable")
    points, node, keys = points[order], node[order], keys[order]
    starts = np.flatnonzero(np.append(True, np.diff(keys) != 0)[: len(keys)])
    counts = np.diff(np.append(starts, len(keys)))
    middle = _sums(points, starts) / counts[:, np.newaxis]
    across = points - np.repeat(middle, counts, axis=0)
    xx, yy, xy = _sums(
        np.column_stack((across[:, 0] ** 2, across[:, 1] ** 2, across[:, 0] * across[:, 1])), starts
    ).T / np.maximum(counts, 1)
    # Eigenvalues of the 2 x 2 covariance; the normal is the direction of the smaller one.
    half, root = 0.5 * (xx + yy), np.sqrt(0.25 * (xx - yy) ** 2 + xy**2)
    angle = 0.5 * np.arctan2(2.0 * xy, xx - yy) + 0.5 * math.pi
    normal = np.column_stack((np.cos(angle), np.sin(angle)))
    seen_from = _sums(node_poses[node, :2], starts) / counts[:, np.newaxis] - middle
    normal *= np.where(np.einsum("ij,ij->i", normal, seen_from) < 0.0, -1.0, 1.0)[:, np.newaxis]
    spread = np.sqrt(np.maximum(half - root, 0.0))
    is_wall: BoolArray = (
        (counts >= MIN_RETURNS) & (np.sqrt(half + root) >= MIN_LENGTH_M) & (spread <= MAX_SPREAD_M)
    )
    tile, visit = np.divmod(keys[starts], num_visits)
    numbers = np.cumsum(np.append(True, np.diff(tile) != 0))
    return WallPieces(
        numbers[: len(starts)][is_wall],
        visit[is_wall],
        middle[is_wall],
        normal[is_wall],
        spread[is_wall],
    )


def _returns(
    node_poses: FloatArray, scans: ScanPoints, max_range: float
) -> tuple[FloatArray, IntArray]:
    """Return returns of all nodes [m, map frame], not too many, and the node of each."""
    stride = max(1, -(-int(scans.counts.sum()) // MAX_RETURNS))
    chosen = scans.take(np.arange(0, len(scans), stride))
    nodes = np.repeat(np.arange(0, len(scans), stride), chosen.counts)
    points = np.concatenate([np.empty((0, 2)), *chosen])
    is_near = np.hypot(points[:, 0], points[:, 1]) <= max_range
    points, nodes = points[is_near], nodes[is_near]
    x, y, theta = node_poses[nodes].T
    cos, sin = np.cos(theta), np.sin(theta)
    moved = (
        x + cos * points[:, 0] - sin * points[:, 1],
        y + sin * points[:, 0] + cos * points[:, 1],
    )
    return np.column_stack(moved), nodes


def _sums(values: FloatArray, starts: IntArray) -> FloatArray:
    """Return the sums of rows from each start to the next."""
    if len(starts) == 0:
        return np.zeros((0, values.shape[1]))
    sums: FloatArray = np.add.reduceat(values, starts, axis=0)
    return sums
