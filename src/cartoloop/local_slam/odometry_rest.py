# SPDX-License-Identifier: Apache-2.0
"""Whether odometry that does not change is of a robot at rest, or misses a motion.

Along bare walls, odometry that stops while the robot goes on holds it. The ranges show it, unless
people change them.
"""

from __future__ import annotations

import math
from collections import deque
from statistics import fmean

from cartoloop.local_slam.moving_gain import ALL_BY_REST
from cartoloop.local_slam.odometry_window import Evidence
from cartoloop.sensor.pose import Pose

MIN_REST_S, CHANGE_OVER_S, MAX_CHANGED_SHARE = 0.5, 1.0, 0.15
"""Odometry that has not changed for the first [s] misses a motion if more than this share of the
ranges has changed over the second [s], or since then: around a robot at rest, only people move."""

MIN_GAIN = 0.05
"""And if a motion explains this share more of the scans than rest does, in the mean of the latest
scans. Among people who walk it is 0.01."""

ABRUPT_SPEED, ABRUPT_S, WORSE_SHARE = 0.1, 5.0, 0.02
"""Odometry that was faster than the first [m/s] in the last second before it came to rest may have
stopped alone. For the second [s], that motion must explain this share less than rest does."""

MIN_BETTER, BETTER_SHARE = 2, 0.01
"""Where fewer ranges have changed, that motion must explain the second share more than rest does,
in the mean of at least the first number of scans: along bare walls, little is seen to move. By as
much less, the scans show rest."""

MIN_MISSED = 3
"""Odometry that has missed the motion in this many rests, and in as many as it has not, does so
where scans do not show it, too."""

REST_M, REST_RAD = 1e-6, 0.005
"""Odometry that reports less from scan to scan has not changed [m], [rad]: its heading may have
noise."""

BEFORE_S = 1.0
"""Time before a rest over which the speed is measured [s]."""

NUM_GAINS = 15
"""Number of latest scans over which the gain is averaged."""


class OdometryRest:
    """A time in which the odometry does not change.

    Attributes
    ----------
    since : its begin [s]; infinite while the odometry changes.
    driven_until : time until which the odometry has surely measured the motion before [s].
    velocity_before : over the last second before, along x and y of the robot [m/s].
    num_missed, num_rests : earlier rests in which scans have shown that the robot moved on, and
        that it did not.
    """

    def __init__(self) -> None:
        self.since = self.driven_until = math.inf
        self.velocity_before = (0.0, 0.0)
        self.num_missed = self.num_rests = 0
        self._gains: deque[float] = deque(maxlen=NUM_GAINS)
        self._better: list[float] = []
        self._steps: deque[tuple[float, float, Pose]] = deque()  # begin, end, motion

    def misses_motion(
        self, begin: float, end: float, step: Pose, evidence: Evidence | None
    ) -> bool:
        """Add a step; return whether the odometry rests though the robot moves.

        Parameters
        ----------
        begin, end : of the step, from scan to scan [s].
        step : as reported.
        evidence : of the match of the later scan; None where it says nothing.
        """
        if not is_at_rest(step):
            self.move(begin, end, step)
            return False
        self.begin(begin, end)
        rests_for = end - self.since
        if evidence is None or rests_for < MIN_REST_S:
            return False
        since = max(self.since, end - CHANGE_OVER_S)
        has_changed = evidence.changed_share(since) > MAX_CHANGED_SHARE
        is_abrupt = rests_for < ABRUPT_S and math.hypot(*self.velocity_before) > ABRUPT_SPEED
        if not (has_changed or is_abrupt):
            return False
        explained = evidence.explained(since, self.velocity_before)
        by_rest, by_expected, by_motion = explained
        if is_abrupt and explained != ALL_BY_REST:
            self._better.append(by_expected - by_rest)
        if not has_changed:
            return self.shows_motion()
        gain = self.mean_gain(by_motion - by_rest)
        return by_expected > by_rest - WORSE_SHARE if is_abrupt else gain > MIN_GAIN

    def shows_motion(self) -> bool:
        """Return whether the motion before goes on, as far as scans show while it rests.

        Along bare walls they may show nothing. Then the rests before that they have shown decide.
        """
        if len(self._better) < MIN_BETTER:
            return False
        often_misses = self.num_missed >= max(MIN_MISSED, self.num_rests)
        return fmean(self._better) > (-BETTER_SHARE if often_misses else BETTER_SHARE)

    def move(self, begin: float, end: float, step: Pose) -> None:
        """Note a step between two times [s], which ends the rest."""
        self.since = math.inf
        if len(self._better) >= MIN_BETTER:
            better = fmean(self._better)
            self.num_missed += better > BETTER_SHARE
            self.num_rests += better < -BETTER_SHARE
        self._gains.clear()
        self._better.clear()
        self._steps.append((begin, end, step))
        while end - self._steps[0][1] > BEFORE_S:
            self._steps.popleft()

    def begin(self, begin: float, end: float) -> None:
        """Begin to rest with a step between two times [s], if it does not already."""
        if self.since < math.inf:
            return
        self.since, self.driven_until = end, begin
        self.velocity_before = (0.0, 0.0)
        seconds = math.fsum(end - begin for begin, end, _ in self._steps)
        if seconds > 0.0:
            x = math.fsum(step.x for _, _, step in self._steps)
            y = math.fsum(step.y for _, _, step in self._steps)
            self.velocity_before = (x / seconds, y / seconds)
            before_begin, before_end, _ = self._steps[-1]
            if before_end >= begin:  # It may have stopped within the step before.
                self.driven_until = min(begin, before_begin)
        self._steps.clear()

    def mean_gain(self, gain: float) -> float:
        """Add what motion explains more of a scan than rest; return the mean of the latest."""
        self._gains.append(gain)
        return math.fsum(self._gains) / len(self._gains)


def is_at_rest(step: Pose) -> bool:
    """Return whether odometry reports no distance and hardly any turn."""
    return math.hypot(step.x, step.y) < REST_M and abs(step.theta) < REST_RAD
