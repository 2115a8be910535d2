# SPDX-License-Identifier: Apache-2.0
"""Where messages wait to be mapped: little room, and the newest win."""

from __future__ import annotations

import time
from collections import Counter, deque
from collections.abc import Callable
from threading import Condition
from typing import NamedTuple

from cartoloop.live.messages import CloudMessage, EndMessage, Message, ScanMessage

MAX_SCANS = 16
"""So many scans wait at the most: older ones are of no use to a robot that moves on."""

MAX_OTHERS = 20_000
"""So many other messages: they take no time, and scans are worth more with them."""

ALL_OF_ONE_TAKE = 256


class Arrival(NamedTuple):
    """A message, and when it arrived by a clock that never jumps [s]."""

    message: Message
    time: float


def steady_clock() -> Callable[[], float]:
    """Return a clock that now is the system's, and never jumps [s since 1970]."""
    offset = time.time() - time.monotonic()
    return lambda: time.monotonic() + offset


class Inbox:
    """A queue between sources and mapping that never holds up a source, nor grows.

    Parameters
    ----------
    max_scans : scans and clouds that may wait.
    waits : whether the source is held up instead of dropping anything.
    clock : tells when a message arrives.

    Attributes
    ----------
    dropped : how many messages were dropped, by kind; those that had waited longest.
    """

    def __init__(
        self,
        max_scans: int = MAX_SCANS,
        *,
        waits: bool = False,
        clock: Callable[[], float] | None = None,
    ) -> None:
        self.dropped: Counter[str] = Counter()
        self._clock = clock or steady_clock()
        self._max_scans = max_scans
        self._waits = waits
        self._queue: deque[Arrival] = deque()
        self._num_scans = 0
        self._changed = Condition()
        self._is_closed = False

    def now(self) -> float:
        """Return the time by which arrivals are told [s]."""
        return self._clock()

    def put(self, message: Message) -> None:
        """Add a message; where there is no room, the oldest of its sort goes."""
        is_scan = isinstance(message, ScanMessage | CloudMessage)
        with self._changed:
            while self._waits and self._is_full(is_scan) and not self._is_closed:
                self._changed.wait(0.1)
            if self._is_closed:
                return
            if self._is_full(is_scan) and not isinstance(message, EndMessage):
                self._drop(is_scan)
            self._queue.append(Arrival(message, self._clock()))
            self._num_scans += is_scan
            self._changed.notify_all()

    def take(self, timeout: float) -> list[Arrival]:
        """Return what has arrived, in order, one scan at the most; wait for it if there is nothing.

        One scan, so that those behind it give way to newer ones while it is being mapped.
        """
        with self._changed:
            if not self._queue and timeout > 0.0:
                self._changed.wait(timeout)
            taken: list[Arrival] = []
            while self._queue and len(taken) < ALL_OF_ONE_TAKE:
                taken.append(self._queue.popleft())
                if isinstance(taken[-1].message, ScanMessage | CloudMessage):
                    self._num_scans -= 1
                    break
            if self._waits:
                self._changed.notify_all()
            return taken

    @property
    def num_waiting(self) -> int:
        """How many messages wait."""
        return len(self._queue)

    def close(self) -> None:
        """Take no more; sources that are held up go on."""
        with self._changed:
            self._is_closed = True
            self._changed.notify_all()

    def _is_full(self, is_scan: bool) -> bool:
        if is_scan:
            return self._num_scans >= self._max_scans
        return len(self._queue) - self._num_scans >= MAX_OTHERS

    def _drop(self, is_scan: bool) -> None:
        for place, arrival in enumerate(self._queue):
            if isinstance(arrival.message, ScanMessage | CloudMessage) == is_scan:
                del self._queue[place]
                break
        self._num_scans -= is_scan
        self.dropped["scans" if is_scan else "readings"] += 1
