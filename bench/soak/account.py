# SPDX-License-Identifier: Apache-2.0
"""Which scans were sent, on which connection, and which of them came."""

from __future__ import annotations

import numpy as np

from cartoloop.arrays import BoolArray, FloatArray

SERIAL_S = 1e-6
"""The clock of the robot is fast by this time per scan [s], so that no two stamps are the same."""


class Account:
    """Knows each scan by its stamp.

    What was on its way when a connection was cut by force is lost in it: those sent last. Any other
    scan that does not come is missing.

    Parameters
    ----------
    most : number of scans that may be sent.

    Attributes
    ----------
    num_sent : number of scans sent.
    """

    def __init__(self, most: int) -> None:
        self.num_sent = 0
        # Not zeros, whose memory the system would hand out scan by scan, as if the mapper grew.
        self._stamps = np.full(most, np.nan)
        self._came = np.full(most, False)
        self._next, self._newest = 0, -1
        self._cuts: list[tuple[int, int]] = []
        self._first = 0

    def stamp(self, time_s: float) -> float:
        """Return the stamp of the next scan, which is sent now, at a time of the robot [s]."""
        stamp = time_s + SERIAL_S * self.num_sent
        self._stamps[self.num_sent] = stamp
        self.num_sent += 1
        return stamp

    def connected(self) -> None:
        """Note that what follows is sent on another connection."""
        self._first = self.num_sent
        self._newest = self.num_sent - 1

    def cut(self) -> None:
        """Note that the connection was cut by force."""
        self._cuts.append((self._first, self.num_sent))

    def came(self, stamp: float) -> None:
        """Note that a scan came; may be called in another thread."""
        number = self._next  # as long as nothing is lost or overtaken
        if not _same(self._stamps[number : min(number + 1, self.num_sent)], stamp).any():
            found = np.flatnonzero(_same(self._stamps[: self.num_sent], stamp))
            if len(found) != 1:
                raise ValueError(f"a scan of the time {stamp} was never sent")
            number = int(found[0])
        self._came[number] = True
        self._next, self._newest = number + 1, max(number, self._newest)

    @property
    def num_ahead(self) -> int:
        """Number of scans sent on this connection after the last that came."""
        return self.num_sent - 1 - self._newest

    @property
    def num_came(self) -> int:
        """Number of different scans that came."""
        return int(np.count_nonzero(self._came))

    @property
    def num_lost(self) -> int:
        """Number of scans lost in connections that were cut."""
        return sum(_num_after_last(self._came[first:end]) for first, end in self._cuts)

    @property
    def num_missing(self) -> int:
        """Number of scans that did not come, and were not lost in a connection."""
        return self.num_sent - self.num_came - self.num_lost


def _num_after_last(came: BoolArray) -> int:
    """Return how many of the last scans did not come."""
    found = np.flatnonzero(came)
    return len(came) - (int(found[-1]) + 1 if len(found) else 0)


def _same(sent: FloatArray, stamp: float) -> BoolArray:
    """Return which stamps are this one; those of ROS are rounded to nanoseconds."""
    same: BoolArray = np.abs(sent - stamp) < 0.4 * SERIAL_S
    return same
