# SPDX-License-Identifier: Apache-2.0
"""The interface of live sources, and the lines in the bytes that they send."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from threading import Event
from typing import Protocol

from cartoloop.live.messages import LiveMessage, MessageError, parse_message
from cartoloop.live.notices import Notices

MAX_LINE_BYTES = 2**24
"""Longer lines are skipped [bytes]: the largest clouds need 10 MB."""

POLL_S = 0.2
"""Period at which sources check whether to stop [s]."""

Put = Callable[[LiveMessage], None]
ParseLine = Callable[[bytes], Iterable[LiveMessage]]


class Source(Protocol):
    """A source of messages."""

    @property
    def name(self) -> str:
        """Its name in the report."""

    def open(self) -> str:
        """Open the source; return a line that describes it.

        Raises
        ------
        InputError
            The source cannot be opened.
        """

    def run(self, put: Put, notices: Notices, stop: Event) -> None:
        """Pass on messages until the source ends or `stop` is set; runs in a background thread.

        Problems are noted and do not end it.
        """


def parse_json_line(line: bytes) -> tuple[LiveMessage, ...]:
    """Return the message in a line of JSON, none in an empty one; see `parse_message`."""
    return (parse_message(line),) if line.strip() else ()


class LineReceiver:
    """Cuts the bytes of one connection into lines, and the lines into messages.

    Parameters
    ----------
    put : receives the messages.
    notices : receives a line for each message that cannot be used.
    where : name of the connection, for messages to the user.
    parse : returns the messages in a line.
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

    @property
    def num_unfinished(self) -> int:
        """Bytes of the incomplete line that are kept."""
        return 0 if self._is_overlong else self._size

    def feed(self, data: bytes) -> None:
        """Add the next bytes."""
        first, *rest = data.split(b"\n")
        self._extend(first)
        for part in rest:
            self._end_line()
            self._extend(part)

    def end(self) -> None:
        """End the connection; a last line without its newline is parsed, and skipped if cut off."""
        if self._size:
            self._end_line()

    def reset(self) -> None:
        """Discard an incomplete line."""
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
        """Parse a complete line."""
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
