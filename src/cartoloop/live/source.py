# SPDX-License-Identifier: Apache-2.0
"""What every live source offers, and lines out of whatever bytes it sends."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from threading import Event
from typing import Protocol

from cartoloop.live.messages import LiveMessage, MessageError, parse_message
from cartoloop.live.notices import Notices

MAX_LINE_BYTES = 2**24
"""No message is longer; a line that is will be skipped."""

POLL_S = 0.2
"""Sources look so often whether they are to end [s]."""

Put = Callable[[LiveMessage], None]
ParseLine = Callable[[bytes], Iterable[LiveMessage]]


class Source(Protocol):
    """Where messages come from."""

    @property
    def name(self) -> str:
        """What it is called in the report."""

    def open(self) -> str:
        """Make ready to receive; return a line that says of what.

        Raises
        ------
        InputError
            That is not possible.
        """

    def run(self, put: Put, notices: Notices, stop: Event) -> None:
        """Hand on messages until the source ends or `stop` is set; in a thread of its own.

        Trouble is noted, and survived.
        """


def parse_json_line(line: bytes) -> tuple[LiveMessage, ...]:
    """Return the message in a line of JSON, none in an empty one; see `parse_message`."""
    return (parse_message(line),) if line.strip() else ()


class LineReceiver:
    """Cuts the bytes of one connection into lines, and the lines into messages.

    Parameters
    ----------
    put : receives the messages.
    notices : is told of lines that cannot be used.
    where : name of the connection, for messages to the user.
    parse : what makes messages of a line.
    """

    def __init__(
        self, put: Put, notices: Notices, where: str, parse: ParseLine = parse_json_line
    ) -> None:
        self._put = put
        self._notices = notices
        self._where = where
        self._parse = parse
        self._parts: list[bytes] = []
        self._size = 0
        self._is_overlong = False
        self.num_lines = 0

    def feed(self, data: bytes) -> None:
        """Take in the next bytes."""
        first, *rest = data.split(b"\n")
        self._extend(first)
        for part in rest:
            self._end_line()
            self._extend(part)

    def end(self) -> None:
        """Take leave of the connection: a line that was not ended is lost if it is cut off."""
        if self._size:
            self._end_line()

    def reset(self) -> None:
        """Forget a line that has begun."""
        self._parts, self._size, self._is_overlong = [], 0, False

    def _extend(self, part: bytes) -> None:
        if not part or self._is_overlong:
            return
        self._size += len(part)
        if self._size > MAX_LINE_BYTES:
            self._is_overlong, self._parts = True, []
        else:
            self._parts.append(part)

    def _end_line(self) -> None:
        line, is_overlong = b"".join(self._parts), self._is_overlong
        self.reset()
        self.num_lines += 1
        if is_overlong:
            self._skip("line too long", f"is longer than {MAX_LINE_BYTES >> 20} MB")
            return
        self.take(line)

    def take(self, line: bytes) -> None:
        """Take in a whole line."""
        try:
            for message in self._parse(line):
                self._put(message)
        except MessageError as error:
            self._skip(error.reason, str(error))

    def _skip(self, reason: str, detail: str) -> None:
        self._notices.skip(
            f"message skipped: {reason}",
            f"{self._where}: message {self.num_lines} skipped: {detail}",
        )
