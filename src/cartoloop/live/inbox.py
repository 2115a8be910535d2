# SPDX-License-Identifier: Apache-2.0
"""The queue of messages that wait to be mapped: it is short, and the newest messages win."""

from __future__ import annotations

import time
from collections import Counter, deque
from collections.abc import Callable
from threading import Condition
from typing import NamedTuple

from cartoloop.live.messages import EndMessage, LiveMessage
from cartoloop.sensor.events import LaserScan, PointCloud

MAX_SCANS = 16
"""Scans that may wait: older ones are of no use to a moving robot."""

MAX_OTHERS = 20_000
"""Other messages that may wait: they take little time, and scans are matched better with them."""

ALL_OF_ONE_TAKE = 256
"""Messages taken from the queue at once: bounds the time between two looks at the clock."""


class Arrival(NamedTuple):
    """A message, and its time of arrival by a clock that never jumps [s]."""

    message: LiveMessage
    time: float


def steady_clock() -> Callable[[], float]:
    """Return a clock that agrees with the system's now and never jumps [s since 1970]."""
    offset = time.time() - time.monotonic()
    return lambda: time.monotonic() + offset


class Inbox:
    """A bounded queue between sources and mapping that does not hold up a source.

    Parameters
    ----------
    max_scans : scans and clouds that may wait.
    waits : whether the source is held up instead of dropping anything.
    clock : the clock of arrivals [s]; `steady_clock` by default.

    Attributes
    ----------
    dropped : number of messages dropped, by kind; the oldest are dropped first.
    num_late : number of scans that nobody will take: they waited when it was closed, or came later.
    """

    def __init__(
        self,
        max_scans: int = MAX_SCANS,
        *,
        waits: bool = False,
        clock: Callable[[], float] | None = None,
    ) -> None:
        self.dropped: Counter[str] = Counter()
        self.num_late = 0
        self._clock = clock or steady_clock()
        self._max_scans = max_scans
        self._waits = waits
        self._queue: deque[Arrival] = deque()
        self._num_scans = 0
        self._changed = Condition()
        self._is_closed = False

    def now(self) -> float:
        """Return the present time by the clock of arrivals [s]."""
        return self._clock()

    def put(self, message: LiveMessage) -> None:
        """Add a message; where the queue is full, the oldest of its kind is dropped."""
        is_scan = isinstance(message, LaserScan | PointCloud)
        with self._changed:
            while self._waits and self._is_full(is_scan) and not self._is_closed:
                self._changed.wait(0.1)
            if self._is_closed:
                self.num_late += is_scan
                return
            if self._is_full(is_scan) and not isinstance(message, EndMessage):
                self._drop(is_scan)
            self._queue.append(Arrival(message, self._clock()))
            self._num_scans += is_scan
            self._changed.notify_all()

    def take(self, timeout: float) -> list[Arrival]:
        """Return messages in order of arrival, at most one scan; wait if there are none.

        At most one scan, so that newer scans can replace the waiting ones while it is mapped.
        """
        with self._changed:
            if not self._queue and timeout > 0.0:
                self._changed.wait(timeout)
            taken: list[Arrival] = []
            while self._queue and len(taken) < ALL_OF_ONE_TAKE:
                taken.append(self._queue.popleft())
                if isinstance(taken[-1].message, LaserScan | PointCloud):
                    self._num_scans -= 1
                    break
            if self._waits:
                self._changed.notify_all()
            return taken

    @property
    def num_waiting(self) -> int:
        """Number of waiting messages."""
        return len(self._queue)

    def close(self) -> None:
        """Accept no more messages and forget those that wait; sources that are held up continue."""
        with self._changed:
            self._is_closed = True
            self.num_late += self._num_scans
            self._queue.clear()
            self._num_scans = 0
            self._changed.notify_all()

    def _is_full(self, is_scan: bool) -> bool:
        if is_scan:
            return self._num_scans >= self._max_scans
        return len(self._queue) - self._num_scans >= MAX_OTHERS

    def _drop(self, is_scan: bool) -> None:
        for place, arrival in enumerate(self._queue):
            if isinstance(arrival.message, LaserScan | PointCloud) == is_scan:
                del self._queue[place]
                break
        self._num_scans -= is_scan
        self.dropped["scans" if is_scan else "readings"] += 1
