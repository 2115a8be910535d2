# SPDX-License-Identifier: Apache-2.0
"""Narrow objects that stand free, as people do."""

from __future__ import annotations

import math

import numpy as np

from cartoloop.arrays import BoolArray, FloatArray
from cartoloop.kernels.free_standing import mark_free_standing

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
    are_free = np.zeros(len(returns), dtype=np.bool_)
    bearings = np.arctan2(returns[:, 1], returns[:, 0])
    order = np.argsort(bearings, kind="stable")
    mark_free_standing(returns, bearings, order, JUMP_M, WIDEST_M, EDGE_RAD, also_hidden, are_free)
    return are_free
