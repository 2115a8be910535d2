# SPDX-License-Identifier: Apache-2.0
"""Which way the walls face that a scan sees: along a corridor none does."""

from __future__ import annotations

import math

import numpy as np

from cartoloop.arrays import FloatArray
from cartoloop.kernels.wall_chords import chord_ends

CORRIDOR_RATIO = 0.1
"""Information along a corridor over that across, by the normals of walls: below it a twentieth of
the returns at most are on walls that face along it."""


MIN_EDGES = 8
"""Pieces of wall that a scan has to show at least."""

CHORD_M, MAX_CHORD_RETURNS, MAX_GAP_M = 0.5, 40, 1.2
"""Least length of a chord [m], the number of returns along it at most, and the distance of
neighbouring returns of a wall at most [m]."""


def normal_ratio(points: FloatArray, max_range: float) -> float:
    """Return the ratio of the eigenvalues of the walls' normals; 1 where too little is seen.

    Parameters
    ----------
    points : float64, shape (n, 2), thinned returns, frame of the scanner [m].
    max_range : farther ones are not used [m].
    """
    edges = np.diff(_in_order(points, max_range), axis=0)
    lengths = np.hypot(edges[:, 0], edges[:, 1])
    is_wall = (lengths < MAX_GAP_M) & (lengths > 0.02)
    return _ratio(edges[is_wall], lengths[is_wall])


def chord_ratio(points: FloatArray, max_range: float) -> float:
    """Return the same by chords of :data:`CHORD_M` along walls, which noise hardly turns.

    They cut off what stands out from a wall.

    Parameters
    ----------
    points, max_range : as for :func:`normal_ratio`.
    """
    returns = _in_order(points, max_range)
    ends = chord_ends(returns, CHORD_M, MAX_CHORD_RETURNS, MAX_GAP_M)
    begins = np.flatnonzero(ends)
    chords = returns[ends[begins]] - returns[begins]
    return _ratio(chords, np.hypot(chords[:, 0], chords[:, 1]))


def _in_order(points: FloatArray, max_range: float) -> FloatArray:
    """Return the points within a range, in the order of their angles."""
    near = points[np.hypot(points[:, 0], points[:, 1]) < max_range]
    ordered: FloatArray = near[np.argsort(np.arctan2(near[:, 1], near[:, 0]), kind="stable")]
    return ordered


def _ratio(edges: FloatArray, lengths: FloatArray) -> float:
    """Return the ratio of the eigenvalues of the directions of edges; 1 of too few."""
    if len(edges) < MIN_EDGES:
        return 1.0
    directions = edges / lengths[:, np.newaxis]
    (xx, xy), (_, yy) = (directions.T @ directions).tolist()
    mean, half = 0.5 * (xx + yy), math.hypot(0.5 * (xx - yy), xy)
    return float(max(mean - half, 0.0) / (mean + half))
