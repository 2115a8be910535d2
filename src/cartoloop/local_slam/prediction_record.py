# SPDX-License-Identifier: Apache-2.0
"""Whether the odometry predicts the scans better than constant velocity does.

Odometry may move as far as the scans do and yet be of no use: where its stamps jitter by more than
the time between scans, it stands and leaps, and each step is wrong though their sum is right. What
it is to be used for is to say where the next scan is. So it is compared with what would be said
without it, step by step, and left out as long as that is better.
"""

from __future__ import annotations

import math
from collections import deque
from typing import NamedTuple

from cartoloop.sensor.pose import Pose

LEVER_M = 0.5
"""A turn that is predicted wrongly counts as the error of a point at this distance [m]."""

MIN_MOTION_M = 0.02
"""Steps by less than this, turn included, say nothing about the predictions [m]."""

SMALL_ERROR_M = 0.1
"""Smaller errors of the odometry do not count against it [m], twice as large ones fully: where the
map shows the place, a match corrects them. Along corridors it does not, and there noisy odometry is
better than constant velocity."""

MATCH_ERROR_M = 0.005
"""Error of the matches that both are compared with [m]."""

WORSE, BETTER, MAX_SCORE = 10.0, 3.0, 15.0
"""The score from which on the odometry is left out, below which it is used again, and its upper
limit, so that it is good again soon after it has become good. Each step counts by at most one. In
recordings with good odometry it remains below `DOUBTFUL`."""

DOUBTFUL = 6.0
"""Odometry whose score was larger in an earlier pass over the recording is left out until it has
predicted well for a while. While it is used, matches follow it, and speak for it."""


MEMORY_S = 10.0
"""For this time a step can be forgotten again [s]."""


class _State(NamedTuple):
    """The record before the step that began at a time [s]."""

    begin: float
    score: float
    since: float
    largest: float
    is_useful: bool


class PredictionRecord:
    """The sum of what steps between scans say against the odometry.

    Parameters
    ----------
    earlier : largest score in an earlier pass over the recording.

    Attributes
    ----------
    is_useful : whether the odometry predicts well enough to be used.
    since : time from which on steps spoke against it [s].
    largest : score so far, the earlier ones included.
    """

    def __init__(self, earlier: float = 0.0) -> None:
        self.is_useful = earlier < DOUBTFUL
        self.since = math.nan
        self.largest = earlier
        self._score = 0.0 if self.is_useful else WORSE
        self._states: deque[_State] = deque()

    def add(self, begin: float, matched: Pose, reported: Pose, expected: Pose) -> None:
        """Add a step that the scans determine.

        Parameters
        ----------
        begin : time of the first scan [s].
        matched, reported, expected : motion to the second scan, in the frame of the first: as
            matched, by the odometry, and at constant velocity.
        """
        if max(_size(matched), _size(reported)) < MIN_MOTION_M:
            return
        self._remember(begin)
        by_odometry, without = _apart(matched, reported), _apart(matched, expected)
        score = (by_odometry - without) / (by_odometry + without + MATCH_ERROR_M)
        if score > 0.0:
            score *= min(max(by_odometry / SMALL_ERROR_M - 1.0, 0.0), 1.0)
        if self._score == 0.0 or math.isnan(self.since):
            self.since = begin
        self._score = min(max(self._score + score, 0.0), MAX_SCORE)
        self.largest = max(self.largest, self._score)
        self.is_useful = self._score < (WORSE if self.is_useful else BETTER)

    def forget(self, since: float) -> None:
        """Forget the steps that began at a time or later [s], as something else explains them.

        Those that began more than `MEMORY_S` before the last one stay.
        """
        while self._states and self._states[-1].begin >= since:
            _, self._score, self.since, self.largest, self.is_useful = self._states.pop()

    def _remember(self, begin: float) -> None:
        states = self._states
        states.append(_State(begin, self._score, self.since, self.largest, self.is_useful))
        while states[0].begin < begin - MEMORY_S:
            states.popleft()


def _size(motion: Pose) -> float:
    x, y, theta = motion
    return math.hypot(x, y) + LEVER_M * abs(theta)


def _apart(one: Pose, other: Pose) -> float:
    x, y, theta = one
    other_x, other_y, other_theta = other
    turned = math.remainder(theta - other_theta, math.tau)
    return math.hypot(x - other_x, y - other_y) + LEVER_M * abs(turned)
