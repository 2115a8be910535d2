# SPDX-License-Identifier: Apache-2.0
"""Whether the returns of a scan lie so close together that it shows little of the place."""

from __future__ import annotations

from cartoloop.arrays import FloatArray

LITTLE_SPREAD_M2 = 50.0
"""Squared distances of returns from their middle, added up [m^2]. Scans of less show little of the
heading: in rooms it is hundreds, of a box ten at most."""


def show_little(points: FloatArray) -> bool:
    """Return whether returns are of nothing but a small object, or of too little of a wall.

    Parameters
    ----------
    points : float64, shape (n, 2) [m].
    """
    if len(points) == 0:
        return True
    from_middle = points - points.mean(axis=0)
    return float((from_middle * from_middle).sum()) < LITTLE_SPREAD_M2
