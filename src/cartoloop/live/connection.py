# SPDX-License-Identifier: Apache-2.0
"""One connection of a robot: its protocol, and what came so far."""

from __future__ import annotations

import socket
from dataclasses import dataclass
from typing import ClassVar, Protocol

from cartoloop.live.source import LineReceiver


class Receiver(Protocol):
    """The protocol of one connection, on its bytes.

    Attributes
    ----------
    answers_pings : whether a connection that exists answers `ping`.
    """

    answers_pings: ClassVar[bool]

    def feed(self, data: bytes) -> None:
        """Add the next bytes."""

    def end(self) -> str:
        """Note that the connection ended; return how."""

    def ping(self) -> None:
        """Ask the other side whether it is still there."""

    def say_goodbye(self) -> None:
        """Announce to the other side that the connection ends."""

    def answer(self) -> bytes:
        """Return the bytes to send, each once."""

    @property
    def is_over(self) -> bool:
        """Whether the connection is to be closed once the answer is sent."""


class PlainReceiver:
    """Newline-delimited messages without a protocol around them."""

    answers_pings: ClassVar[bool] = False
    is_over = False

    def __init__(self, lines: LineReceiver) -> None:
        self._lines = lines

    def feed(self, data: bytes) -> None:
        """Add the next bytes."""
        self._lines.feed(data)

    def end(self) -> str:
        """Parse a last line without its newline."""
        self._lines.end()
        return "disconnected"

    def ping(self) -> None:
        """Do nothing: the operating system asks."""

    def say_goodbye(self) -> None:
        """Do nothing: the connection just ends."""

    def answer(self) -> bytes:
        """Return nothing: robots are not answered."""
        return b""


@dataclass(eq=False)
class Client:
    """A connection.

    Attributes
    ----------
    unfinished : bytes received since the last complete message.
    last_message : when one was complete, or when it connected [s].
    last_sign : when anything came [s].
    next_ping : when to ask whether it still exists [s].
    closes_at : when it is closed for good [s], if its end was decided.
    """

    socket: socket.socket
    where: str
    lines: LineReceiver
    receiver: Receiver
    last_message: float
    last_sign: float
    next_ping: float
    unfinished: int = 0
    closes_at: float | None = None

    @property
    def has_spoken(self) -> bool:
        """Whether a complete message came."""
        return self.lines.num_lines > 0
