# SPDX-License-Identifier: Apache-2.0
"""Narrow objects that stand free, as people do."""

from __future__ import annotations

import math

import numpy as np

from cartoloop.arrays import BoolArray, FloatArray

JUMP_M = 0.25
"""What is seen on both sides of an object that stands free is farther away by at least this [m]."""

WIDEST_M = 0.8
"""Width of a person, at most [m]."""


EDGE_RAD = math.radians(20.0)
"""The largest angle between neighbouring returns, beyond this, is where the view ends [rad]."""


def are_free_standing(returns: FloatArray) -> BoolArray:
    """Return which returns of a scan are on narrow objects that stand free, shape (n,).

    Other returns are seen on both sides of them, farther away by :data:`JUMP_M`, or on one side if
    the view ends on the other. Door posts and cupboards are joined to a wall.

    Parameters
    ----------
    returns : float64, shape (n, 2), in any order, frame of the scanner [m].
    """
    free = np.zeros(len(returns), dtype=np.bool_)
    if len(returns) == 0:
        return free
    bearings = np.arctan2(returns[:, 1], returns[:, 0])
    order = np.argsort(bearings, kind="stable")
    ordered, bearings = returns[order], bearings[order]
    ranges = np.hypot(ordered[:, 0], ordered[:, 1])
    rises = np.roll(ranges, -1) - ranges  # to the next one, all around
    falls = np.roll(-rises, 1)  # to the one before
    angles = np.diff(bearings, append=bearings[0] + math.tau)
    edge = int(np.argmax(angles))
    if angles[edge] > EDGE_RAD:
        rises[edge] = falls[(edge + 1) % len(falls)] = math.inf
    is_last = np.abs(rises) > JUMP_M
    lasts = np.flatnonzero(is_last)
    if len(lasts) == 0:
        return free
    firsts = (np.roll(lasts, 1) + 1) % len(returns)
    widths = np.hypot(*(ordered[lasts] - ordered[firsts]).T)
    nearer = np.minimum(rises[lasts], falls[firsts])
    is_object = (nearer > 0.0) & (nearer < math.inf) & (widths < WIDEST_M)
    objects = (np.cumsum(is_last) - is_last) % len(lasts)  # number of the object of each return
    free[order] = is_object[objects]
    return free
