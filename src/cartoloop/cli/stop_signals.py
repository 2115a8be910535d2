# SPDX-License-Identifier: Apache-2.0
"""Ctrl-C and termination: asked once, the run stops where its result is whole."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType


class StopRequest:
    """Whether the user wants the run to stop.

    Attributes
    ----------
    made : whether a signal has arrived.
    """

    def __init__(self) -> None:
        self.made = False
        self._at_once = False

    def handle(self, number: int, frame: FrameType | None) -> None:
        """Note the first signal; raise KeyboardInterrupt at the second, or while `at_once`."""
        again, self.made = self.made, True
        if again or self._at_once:
            raise KeyboardInterrupt

    @contextmanager
    def at_once(self) -> Iterator[None]:
        """Let a signal raise KeyboardInterrupt in the body, which does not look at `made`."""
        self._at_once = True
        try:
            if self.made:
                raise KeyboardInterrupt
            yield
        finally:
            self._at_once = False


@contextmanager
def stop_signals() -> Iterator[StopRequest]:
    """Yield the request that SIGINT and SIGTERM make while the body runs."""
    request = StopRequest()
    numbers = (signal.SIGINT, signal.SIGTERM)
    before = [signal.signal(number, request.handle) for number in numbers]
    try:
        yield request
    finally:
        for number, handler in zip(numbers, before, strict=True):
            signal.signal(number, handler)
