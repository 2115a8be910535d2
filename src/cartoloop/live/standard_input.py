# SPDX-License-Identifier: Apache-2.0
"""Messages from a file descriptor: standard input, a pipe, a serial line."""

from __future__ import annotations

import os
import sys
from threading import Event

from cartoloop.live.notices import Notices
from cartoloop.live.source import LineReceiver, Put

_CHUNK = 2**16


class StandardInput:
    """Newline-delimited JSON from standard input, until that ends.

    Parameters
    ----------
    descriptor : the file descriptor; standard input if None.
    """

    name = "standard input"

    def __init__(self, descriptor: int | None = None) -> None:
        self._descriptor = descriptor

    def open(self) -> str:
        """Return a line that describes the source."""
        return "reading messages from standard input"

    def run(self, put: Put, notices: Notices, stop: Event) -> None:
        """Pass on messages until the input ends."""
        lines = LineReceiver(put, notices, self.name)
        descriptor = sys.stdin.fileno() if self._descriptor is None else self._descriptor
        try:
            while not stop.is_set() and (data := os.read(descriptor, _CHUNK)):
                lines.feed(data)
        except OSError as error:
            notices.say(f"{self.name} failed: {error.strerror}; the messages before are mapped")
        lines.end()
