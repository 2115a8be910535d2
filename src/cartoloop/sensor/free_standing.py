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
"""The view ends at the largest angle between neighbouring returns, if that is larger [rad]."""


def are_free_standing(returns: FloatArray, *, also_hidden: bool = False) -> BoolArray:
    """Return which returns of a scan are on narrow objects that stand free, shape (n,).

    Other returns are seen on both sides of them, farther away by :data:`JUMP_M`, or on one side if
    the view ends on the other. Door posts and cupboards are joined to a wall.

    Parameters
    ----------
    returns : float64, shape (n, 2), in any order, frame of the scanner [m].
    also_hidden : whether one side may be hidden by another of them. Parts of walls between clutter
        look like that, too.
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
    is_narrow, before, after = widths < WIDEST_M, falls[firsts], rises[lasts]
    is_free = _are_whole(is_narrow, before, after)
    if also_hidden:
        is_free |= _are_partly_hidden(is_narrow, before, after, is_free)
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


def _are_whole(is_narrow: BoolArray, before: FloatArray, after: FloatArray) -> BoolArray:
    """Return which objects stand free, shape (k,); arguments of each, in order all around.

    `before` and `after`: by how much farther is what is seen on both sides [m].
    """
    nearer = np.minimum(before, after)
    return is_narrow & (nearer > 0.0) & (nearer < math.inf)


def _are_partly_hidden(
    is_narrow: BoolArray, before: FloatArray, after: FloatArray, are_whole: BoolArray
) -> BoolArray:
    """Return which objects have one of `are_whole` on one side and stand free on the other."""
    is_seen_before, is_seen_after = ((side > 0.0) & (side < math.inf) for side in (before, after))
    hides_before, hides_after = np.roll(are_whole, 1), np.roll(are_whole, -1)
    return is_narrow & ((is_seen_after & hides_before) | (is_seen_before & hides_after))
