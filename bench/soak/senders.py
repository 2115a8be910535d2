# SPDX-License-Identifier: Apache-2.0
"""How a robot is connected to a source: what the soak needs of each kind of connection."""

from __future__ import annotations

from collections.abc import Callable
from threading import Event
from typing import Protocol

from cartoloop.live.messages import LiveMessage
from cartoloop.live.notices import Notices
from cartoloop.live.source import Put, Source
from cartoloop.sensor.events import LaserScan, SensorEvent


class Sender(Protocol):
    """A connection of the robot."""

    def send(self, event: SensorEvent, stamp: float) -> None:
        """Send a message with a stamp [s]."""

    def flood(self, count: int) -> int:
        """Send messages of an unknown kind; return how many of them must be counted."""

    def send_garbage(self, data: bytes) -> int:
        """Send a message that is nonsense; return the number of messages to be counted."""

    def break_off(self) -> int:
        """Close it in the middle of a message; return the number of messages to be counted."""

    def cut(self) -> None:
        """End it by force: what is on its way may be lost."""

    def close(self) -> None:
        """Close it when all was read; what comes later cannot overtake it then."""

    def end(self) -> None:
        """Announce the end of the day, and close it."""


class Silent(Protocol):
    """A connection that never sends anything."""

    def close(self) -> None:
        """Close it."""


class Network(Protocol):
    """A source, and how to connect to it."""

    @property
    def max_ahead(self) -> int:
        """Scans that may be on their way at a time."""

    @property
    def end_after(self) -> float | None:
        """Time without messages that ends the day [s]; None where a message does."""

    @property
    def source(self) -> Source:
        """The source."""

    def connect(self) -> Sender:
        """Return a connection, once the source is open."""

    def connect_silent(self) -> Silent:
        """Return a connection that never sends anything."""


class Watched:
    """A source that also reports each scan when it comes.

    Parameters
    ----------
    source : the source.
    came : called with the stamp of each scan, in the thread of the source.
    """

    def __init__(self, source: Source, came: Callable[[float], None]) -> None:
        self._source = source
        self._came = came

    @property
    def name(self) -> str:
        """Its name in the report."""
        return self._source.name

    def open(self) -> str:
        """Open the source; return a line that describes it."""
        return self._source.open()

    def run(self, put: Put, notices: Notices, stop: Event) -> None:
        """Pass on messages until the source ends or `stop` is set."""

        def report(message: LiveMessage) -> None:
            if isinstance(message, LaserScan):
                self._came(message.stamp)
            put(message)

        self._source.run(report, notices, stop)
