# SPDX-License-Identifier: Apache-2.0
"""What a localisation has been through: its states, and the path in the map; in bounded memory."""

from __future__ import annotations

import math

import numpy as np

from cartoloop.arrays import FloatArray
from cartoloop.localisation.answer import Answer, State
from cartoloop.sensor.pose import Pose

MAX_RUNS = 400
"""Number of changes of the state that are kept: the latest."""

MAX_POINTS = 20_000
"""Number of points of the path that are kept; with more, every second one is left out."""

SPACING_M = 0.1
"""Distance between points of the path at first [m]."""


class StateHistory:
    """Which state when.

    Attributes
    ----------
    runs : stamp at which it began [s], and state, of the latest changes.
    end : stamp of the last answer [s], NaN before the first.
    """

    def __init__(self) -> None:
        self.runs: list[tuple[float, State]] = []
        self.end = math.nan

    def add(self, stamp: float, state: State) -> None:
        """Note the state at a scan."""
        self.end = stamp
        if self.runs and self.runs[-1][1] is state:
            return
        self.runs.append((stamp, state))
        del self.runs[:-MAX_RUNS]


class PathHistory:
    """Where the robot was located; stretches in between, in which it was not, are left out.

    Points are so far apart that they are no more than `MAX_POINTS`.

    Attributes
    ----------
    revision : rises when older points are left out.
    """

    def __init__(self) -> None:
        self.revision = 0
        self._points: list[tuple[float, float, float]] = []
        self._spacing = SPACING_M
        self._is_interrupted = True

    def __len__(self) -> int:
        return len(self._points)

    def add(self, tf_map_tracking: Pose | None) -> None:
        """Add the pose of a scan, None where it is not known."""
        if tf_map_tracking is None:
            self._is_interrupted = True
            return
        x, y, _ = tf_map_tracking
        if not self._is_interrupted:
            last = self._points[-1]
            if math.hypot(x - last[0], y - last[1]) < self._spacing:
                return
        if len(self._points) >= MAX_POINTS:
            self._thin()
        self._points.append((x, y, float(self._is_interrupted)))
        self._is_interrupted = False

    def rows(self, first: int) -> FloatArray:
        """Return the points from `first` on: x, y [m, map], and 1 where a stretch begins, else 0.

        float64, shape (n, 3).
        """
        return np.array(self._points[first:], dtype=np.float64).reshape(-1, 3)

    def _thin(self) -> None:
        """Leave out every second point; a stretch begins with the first that is left of it."""
        begins, kept = 0.0, []
        for number, (x, y, begin) in enumerate(self._points):
            begins = max(begins, begin)
            if number % 2 == 0:
                kept.append((x, y, begins))
                begins = 0.0
        self._points = kept
        self._is_interrupted = self._is_interrupted or begins > 0.0
        self._spacing *= 2.0
        self.revision += 1


def position_sigma(answer: Answer) -> float | None:
    """Return the standard deviation of a position in its worst direction [m], None without one."""
    if answer.covariance is None:
        return None
    worst = float(np.linalg.eigvalsh(answer.covariance[:2, :2])[1])
    return math.sqrt(max(worst, 0.0))
