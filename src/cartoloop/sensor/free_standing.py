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
    the view ends on the other, or another one of them hides the rest. Door posts and cupboards are
    joined to a wall.

    Parameters
    ----------
    returns : float64, shape (n, 2), in any order, frame of the scanner [m].
    """
    free = np.zeros(len(returns), dtype=np.bool_)
    bearings = np.arctan2(returns[:, 1], returns[:, 0])
    order = np.argsort(bearings, kind="stable")
    ordered = returns[order]
    rises, falls = _range_differences(ordered, bearings[order])
    is_last = np.abs(rises) > JUMP_M
    lasts = np.flatnonzero(is_last)
    if len(lasts) == 0:
        return free
    firsts = (np.roll(lasts, 1) + 1) % len(returns)
    widths = np.hypot(*(ordered[lasts] - ordered[firsts]).T)
    is_free = _are_free(widths < WIDEST_M, falls[firsts], rises[lasts])
    objects = (np.cumsum(is_last) - is_last) % len(lasts)  # number of the object of each return
    free[order] = is_free[objects]
    return free


def _range_differences(returns: FloatArray, bearings: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return by how much farther the next return is, and the one before, shapes (n,) [m].

    They are compared all around; inf where the view ends. `returns` by their `bearings` [rad].
    """
    ranges = np.hypot(returns[:, 0], returns[:, 1])
    rises = np.roll(ranges, -1) - ranges
    falls = np.roll(-rises, 1)
    if len(returns):
        angles = np.diff(bearings, append=bearings[0] + math.tau)
        edge = int(np.argmax(angles))
        if angles[edge] > EDGE_RAD:
            rises[edge] = falls[(edge + 1) % len(falls)] = math.inf
    return rises, falls


def _are_free(is_narrow: BoolArray, falls: FloatArray, rises: FloatArray) -> BoolArray:
    """Return which objects stand free, shape (k,); arguments of each, in order all around.

    `falls` and `rises`: by how much farther is what is seen before and after it [m].
    """
    is_seen_before, is_seen_after = ((side > 0.0) & (side < math.inf) for side in (falls, rises))
    is_seen_beside = is_seen_before | is_seen_after
    is_whole = is_narrow & (np.minimum(falls, rises) > 0.0) & is_seen_beside
    is_partly_hidden = (is_seen_after & np.roll(is_whole, 1)) | (
        is_seen_before & np.roll(is_whole, -1)
    )
    free: BoolArray = is_whole | (is_narrow & is_partly_hidden)
    return free
