# SPDX-License-Identifier: Apache-2.0
"""Whether the returns of a scan lie so close together that it shows little of the place."""

from __future__ import annotations

import numpy as np

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
    x, y = np.add.reduce(points).tolist()
    spread = float(np.vdot(points, points)) - (x * x + y * y) / len(points)
    return bool(spread < LITTLE_SPREAD_M2)
