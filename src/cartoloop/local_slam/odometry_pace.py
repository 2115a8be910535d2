# SPDX-License-Identifier: Apache-2.0
"""How fast the odometry has shown the robot to be: what is a jump, and what took longer."""

from __future__ import annotations

import math
from typing import NamedTuple

from cartoloop.sensor.pose import Pose, wrap_angle

MAX_PERIOD_S = 1.0
"""Readings further apart do not determine a speed [s]."""

KNOWN_STEP_M, KNOWN_STEP_RAD, TIMES_FASTEST = 0.3, 0.3, 3.0
"""Once a robot has shown how fast it is, a step longer than KNOWN_STEP + TIMES_FASTEST * duration *
its largest speed is a reset, too [m], [rad]. Steps of real robots remain below half of that."""

LEAST_FASTEST, LEAST_FASTEST_RATE = 0.3, 0.6
"""Least of these largest speeds [m/s], [rad/s]: a robot may not have turned yet."""

PACE_S, NUM_PACES, MIN_PACE = 1.0, 10, 0.1
"""Time over which a speed is measured [s], so that jitter of the stamps is not in it; number of
such times in which the robot moved by more than the third [m], [rad], after which its largest speed
is known."""

HASTY_M, HASTY_RAD, HASTY_TIMES_FASTEST = 0.1, 0.1, 1.5
"""A step from repeated readings that is longer than the first and this many times the largest speed
[m], [rad] is that of the time in which they were repeated."""

ANY_RATE, LEAST_STEP_S = 2.0, 0.1
"""The largest speed that is assumed of turns while the robot's own is not known [rad/s], and the
shortest time of a step then [s]: messages that arrived late have stamps close to the next."""


class Pace(NamedTuple):
    """The largest speeds of the odometry so far.

    Attributes
    ----------
    begin, moved, turned : of the time over which a speed is being measured [s], and the motion in
        it [m], [rad].
    last, changed : times of the last reading, and of the last one that differed from the one before
        [s].
    num_paces : number of such times in which the robot moved.
    fastest, fastest_rate : the largest speeds [m/s], [rad/s].
    """

    begin: float = math.nan
    last: float = math.nan
    changed: float = math.nan
    moved: float = 0.0
    turned: float = 0.0
    num_paces: int = 0
    fastest: float = LEAST_FASTEST
    fastest_rate: float = LEAST_FASTEST_RATE

    def with_step(self, time: float, before: Pose, after: Pose) -> Pace:
        """Return it with the step to another reading."""
        if math.isnan(self.begin):
            return self._replace(begin=time, last=time, changed=time)
        # The first reading after a gap in the recording may be of before it.
        has_changed = after != before and time - self.last <= MAX_PERIOD_S
        changed = time if has_changed else self.changed
        moved = self.moved + math.hypot(after.x - before.x, after.y - before.y)
        turned = self.turned + abs(wrap_angle(after.theta - before.theta))
        duration = time - self.begin
        if duration < PACE_S:
            return Pace(  # a third of the time of _replace
                self.begin,
                time,
                changed,
                moved,
                turned,
                self.num_paces,
                self.fastest,
                self.fastest_rate,
            )
        return Pace(
            begin=time,
            last=time,
            changed=changed,
            num_paces=self.num_paces + (moved > MIN_PACE or turned > MIN_PACE),
            fastest=max(self.fastest, moved / duration),
            fastest_rate=max(self.fastest_rate, turned / duration),
        )

    def is_hasty(self, before: Pose, after: Pose, duration: float) -> bool:
        """Return whether a step took longer than a duration, by the largest speeds so far."""
        distance = math.hypot(after.x - before.x, after.y - before.y)
        turn = abs(wrap_angle(after.theta - before.theta))
        times = HASTY_TIMES_FASTEST * duration
        return self.num_paces >= NUM_PACES and (
            distance > HASTY_M + times * self.fastest
            or turn > HASTY_RAD + times * self.fastest_rate
        )

    def has_caught_up(self, before: Pose, after: Pose, duration: float) -> bool:
        """Return whether a step from readings that repeat each other took longer than a duration.

        While the largest speeds are unknown, only a turn shows it: a reset of the position is as
        likely as a long step.
        """
        if self.num_paces >= NUM_PACES:
            return self.is_hasty(before, after, duration)
        times = HASTY_TIMES_FASTEST * max(duration, LEAST_STEP_S)
        turn = abs(wrap_angle(after.theta - before.theta))
        return turn > HASTY_RAD + times * max(self.fastest_rate, ANY_RATE)

    def is_exceeded(self, distance: float, turn: float, time: float, period: float) -> bool:
        """Return whether the step to a reading at a time is much faster than any so far.

        It may be that of all the time since the last reading that was another, and of a usual
        period at least: readings that arrived late have stamps close to the next.
        """
        if self.num_paces < NUM_PACES:
            return False
        duration = TIMES_FASTEST * max(time - self.changed, period)
        return (
            distance > KNOWN_STEP_M + self.fastest * duration
            or turn > KNOWN_STEP_RAD + self.fastest_rate * duration
        )
