# SPDX-License-Identifier: Apache-2.0
"""From the stamps of a stream to times, message by message, without waiting for what follows.

A recording is repaired by looking both ways (`cartoloop.sensor.time_repair`). Of a stream only the
past is known; but when each message arrived is known too, and that clock can be relied on.
"""

from __future__ import annotations

import math
from collections import Counter

from cartoloop.sensor.time_repair import MIN_JUMP, NOMINAL_PERIOD

MAX_LATE_S = 1.0
"""Sensors and networks delay messages by less than this against each other; more is a clock that
was set back [s]."""

ABSURD_S = 1e11
"""Three thousand years: such a stamp is none, and would leave no digits for what matters [s]."""

_KNOWN_SHIFTS = 8


class StreamClock:
    """Puts the stamps of all messages of one source onto one scale of time.

    A stamp counts as it is unless it contradicts the time of arrival: where the robot's clock is
    set, or a sensor goes by another, the times go on as the messages arrive.

    Attributes
    ----------
    num_missing : messages without a stamp; they count as measured when they arrived.
    num_set : how often a clock was found to be set, or to be another one.
    """

    def __init__(self) -> None:
        self.num_missing = 0
        self.num_set = 0
        self._shifts = [0.0]
        self._front = math.nan  # the latest time, and when the message before this one arrived
        self._arrival = math.nan

    def time_of(self, stamp: float, arrival: float) -> float:
        """Return the time of a message [s].

        Parameters
        ----------
        stamp : as sent [s]; NaN or infinite where there is none.
        arrival : when it arrived, by a clock that never jumps [s].
        """
        is_told = abs(stamp) < ABSURD_S  # False for NaN
        self.num_missing += not is_told
        if math.isnan(self._front):
            time = stamp if is_told else arrival
            self._front, self._arrival = time, arrival
            return time
        expected = self._front + max(0.0, arrival - self._arrival)
        time = stamp + self._shift_of(stamp, expected) if is_told else expected
        self._front, self._arrival = max(self._front, time), arrival
        return time

    def _shift_of(self, stamp: float, expected: float) -> float:
        """Return what to add to a stamp; nothing if that fits."""
        low, high = self._front - MAX_LATE_S, expected + MIN_JUMP
        fitting = [shift for shift in self._shifts if low <= stamp + shift <= high]
        if fitting:
            # A clock that comes back to where it was needs no shift any more.
            return min(fitting, key=lambda shift: abs(stamp + shift - expected))
        self.num_set += 1
        shift = expected - stamp
        self._shifts = [0.0, *self._shifts[1:][-(_KNOWN_SHIFTS - 2) :], shift]
        return shift


class SensorTimes:
    """Keeps the times of one sensor's scans increasing.

    Attributes
    ----------
    repaired : how many times were lifted, by what was wrong.
    """

    def __init__(self) -> None:
        self.repaired: Counter[str] = Counter()
        self._time = -math.inf
        self._arrival = 0.0
        self._period = NOMINAL_PERIOD

    def increasing(self, time: float, arrival: float) -> float:
        """Return a time after that of the scan before.

        One that is not is taken to have been measured as much later as it arrived, and within a
        period.
        """
        if time <= self._time:
            self.repaired["repeated" if time == self._time else "backwards"] += 1
            since = arrival - self._arrival
            time = self._time + min(max(since, 1e-3 * self._period), self._period)
        elif math.isfinite(self._time) and time - self._time < MIN_JUMP:
            self._period += 0.1 * (time - self._time - self._period)
        self._time, self._arrival = time, arrival
        return time
