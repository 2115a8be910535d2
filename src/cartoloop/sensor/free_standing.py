# SPDX-License-Identifier: Apache-2.0
"""Narrow objects that stand free, as people do."""

from __future__ import annotations

import numpy as np

from cartoloop.arrays import BoolArray, FloatArray

JUMP_M = 0.25
"""What is seen on both sides of an object that stands free is farther away by at least this [m]."""

WIDEST_M = 0.8
"""Width of a person, at most [m]."""


def are_free_standing(returns: FloatArray) -> BoolArray:
    """Return which returns of a scan are on narrow objects that stand free, shape (n,).

    Other returns are seen on both sides of them, farther away by :data:`JUMP_M`. Door posts and
    cupboards are joined to a wall on one side.

    Parameters
    ----------
    returns : float64, shape (n, 2), in any order, frame of the scanner [m].
    """
    free = np.zeros(len(returns), dtype=np.bool_)
    order = np.argsort(np.arctan2(returns[:, 1], returns[:, 0]), kind="stable")
    ordered = returns[order]
    ranges = np.hypot(ordered[:, 0], ordered[:, 1])
    farther = np.roll(ranges, -1) - ranges  # of the next one, all around
    is_jump = np.abs(farther) > JUMP_M
    lasts = np.flatnonzero(is_jump)
    if len(lasts) == 0:
        return free
    firsts = (np.roll(lasts, 1) + 1) % len(returns)
    widths = np.hypot(*(ordered[lasts] - ordered[firsts]).T)
    is_object = (farther[lasts] > 0.0) & (farther[firsts - 1] < 0.0) & (widths < WIDEST_M)
    objects = (np.cumsum(is_jump) - is_jump) % len(lasts)  # number of the object of each return
    free[order] = is_object[objects]
    return free
