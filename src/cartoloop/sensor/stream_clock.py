# SPDX-License-Identifier: Apache-2.0
"""From the stamps of a stream to times, message by message, without waiting.

The stamps of a recording are repaired by those before and after (`cartoloop.sensor.time_repair`).
Of a stream only the past is known, but also when each message arrived, by a reliable clock.
"""

from __future__ import annotations

import math
from collections import Counter

from cartoloop.sensor.time_repair import MIN_JUMP, NOMINAL_PERIOD

MAX_LATE_S = 1.0
"""Largest relative delay of messages [s]; more is a clock that was set back."""

ABSURD_S = 1e11
"""Limit of a stamp [s]: three thousand years, at which a double resolves 15 microseconds."""

_KNOWN_SHIFTS = 8
"""Number of clocks that are distinguished: more than there are sensors."""

_MIN_STEP_SHARE, _PERIOD_MEMORY = 1e-3, 0.1
"""Least step between repaired times, in periods; and weight of a new step in the mean period."""


class StreamClock:
    """Converts the stamps of all messages of one source to one time scale.

    A stamp is used as it is unless it contradicts the time of arrival. Where the robot's clock is
    set, or a sensor has another clock, the times continue as the messages arrive.

    Attributes
    ----------
    num_missing : number of messages without a stamp; their time is that of their arrival.
    num_set : number of times that a clock was set, or that another clock appeared.
    """

    def __init__(self) -> None:
        self.num_missing = 0
        self.num_set = 0
        self._shifts = [0.0]
        self._front = math.nan  # the latest time, and the arrival of the previous message
        self._arrival = math.nan

    def time_of(self, stamp: float, arrival: float) -> float:
        """Return the time of a message [s].

        Parameters
        ----------
        stamp : as sent [s]; NaN or infinite where there is none.
        arrival : when it arrived, by a clock that never jumps [s].
        """
        has_stamp = abs(stamp) < ABSURD_S  # False for NaN
        self.num_missing += not has_stamp
        if math.isnan(self._front):
            time = stamp if has_stamp else arrival
            self._front, self._arrival = time, arrival
            return time
        expected = self._front + max(0.0, arrival - self._arrival)
        time = stamp + self._shift_of(stamp, expected) if has_stamp else expected
        self._front, self._arrival = max(self._front, time), arrival
        return time

    def _shift_of(self, stamp: float, expected: float) -> float:
        """Return the difference between time and stamp [s]: zero if that is plausible."""
        low, high = self._front - MAX_LATE_S, expected + MIN_JUMP
        fitting = [shift for shift in self._shifts if low <= stamp + shift <= high]
        if fitting:
            # A clock that was set back to its former time has its former shift.
            return min(fitting, key=lambda shift: abs(stamp + shift - expected))
        self.num_set += 1
        shift = expected - stamp
        self._shifts = [0.0, *self._shifts[1:][-(_KNOWN_SHIFTS - 2) :], shift]
        return shift


class SensorTimes:
    """Makes the times of one sensor's scans increase.

    Attributes
    ----------
    repaired : number of changed times, by fault.
    """

    def __init__(self) -> None:
        self.repaired: Counter[str] = Counter()
        self._time = -math.inf
        self._arrival = 0.0
        self._period = NOMINAL_PERIOD

    def increasing(self, time: float, arrival: float) -> float:
        """Return a time after that of the previous scan.

        Where the given one is not, it is later by the difference of the arrivals, at most by a
        period.
        """
        if time <= self._time:
            self.repaired["repeated" if time == self._time else "backwards"] += 1
            since = arrival - self._arrival
            time = self._time + min(max(since, _MIN_STEP_SHARE * self._period), self._period)
        elif math.isfinite(self._time) and time - self._time < MIN_JUMP:
            self._period += _PERIOD_MEMORY * (time - self._time - self._period)
        self._time, self._arrival = time, arrival
        return time
