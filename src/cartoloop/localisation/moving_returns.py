# SPDX-License-Identifier: Apache-2.0
"""Returns of what moves, as of people: they lie where scans just before saw through.

What stands there, also where the map does not have it, was not seen through: it still counts
against a place.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from cartoloop.arrays import BoolArray, FloatArray, IntArray
from cartoloop.sensor.pose import Pose

NUM_BINS = 360
"""Directions in which a scan is kept."""

PERIOD_S, NUM_VIEWS = 0.4, 8
"""Time between scans that are kept, at least [s], and how many are: who walks is elsewhere after
it, and the pose by local SLAM is still exact after all of them."""

BEYOND_M = 0.3
"""A scan saw through a place if its returns in that direction were farther by this [m]."""

MAX_SHARE = 0.4
"""If more of the returns seem to move, the robot did, and local SLAM has not noticed it."""


class _View(NamedTuple):
    """A scan that is kept.

    Attributes
    ----------
    time : of it [s].
    tf_local_beams : pose of the scanner, local frame.
    nearest : float64, shape (NUM_BINS,), distance of the nearest return in each direction and those
        beside it [m]; 0 where there is none.
    """

    time: float
    tf_local_beams: Pose
    nearest: FloatArray


class MovingReturns:
    """Finds the returns of what moves, scan by scan."""

    def __init__(self) -> None:
        self._views: deque[_View] = deque(maxlen=NUM_VIEWS)

    def add(
        self, time: float, tf_local_beams: Pose, points: FloatArray, returns: FloatArray
    ) -> BoolArray:
        """Return which points of a scan are of what moves, shape (n,), and keep the scan.

        Parameters
        ----------
        time : of the scan [s].
        tf_local_beams : pose of the scanner, local frame.
        points : float64, shape (n, 2), returns of the scan, thinned, local frame [m].
        returns : float64, shape (m, 2), all of them, local frame [m].
        """
        earlier = [view for view in self._views if time - view.time >= PERIOD_S]
        moving = _are_seen_through(earlier, points)
        if not self._views or time - self._views[-1].time >= PERIOD_S:
            self._views.append(_View(time, tf_local_beams, _nearest(tf_local_beams, returns)))
        if np.count_nonzero(moving) > MAX_SHARE * len(points):
            moving[:] = False
        return moving


def _nearest(tf_local_beams: Pose, returns: FloatArray) -> FloatArray:
    bins, distances = (each[0] for each in _polar([tf_local_beams], returns))
    nearest = np.full(NUM_BINS, np.inf)
    np.minimum.at(nearest, bins, distances)
    around = np.minimum(nearest, np.minimum(np.roll(nearest, 1), np.roll(nearest, -1)))
    # Where no beam came back, it is not known what was seen through.
    return np.where(np.isfinite(around), around, 0.0)


def _are_seen_through(views: Sequence[_View], points: FloatArray) -> BoolArray:
    """Return which points, in the local frame, any of the scans saw through."""
    if not views:
        return np.zeros(len(points), dtype=np.bool_)
    bins, distances = _polar([view.tf_local_beams for view in views], points)
    nearest = np.take_along_axis(np.array([view.nearest for view in views]), bins, axis=1)
    seen: BoolArray = np.any(nearest > distances + BEYOND_M, axis=0)
    return seen


def _polar(tf_local_beams: Sequence[Pose], points: FloatArray) -> tuple[IntArray, FloatArray]:
    """Return the number of the direction of points and their distances [m], shape (poses, n)."""
    x, y, theta = np.array(tf_local_beams).T[:, :, None]
    dx, dy = points[:, 0] - x, points[:, 1] - y
    angles = np.arctan2(dy, dx) - theta
    bins = np.floor((angles + math.pi) * (NUM_BINS / (2.0 * math.pi))).astype(np.int64) % NUM_BINS
    return bins, np.hypot(dx, dy)
