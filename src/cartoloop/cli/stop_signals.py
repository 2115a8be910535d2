# SPDX-License-Identifier: Apache-2.0
"""Ctrl-C and termination: the first signal stops the run at the next event, the second at once."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

from cartoloop.stop_request import StopRequest


class SignalStop(StopRequest):
    """A stop request that signals make."""

    def handle(self, number: int, frame: FrameType | None) -> None:
        """Note the first signal; raise KeyboardInterrupt at the second, or in `at_once`."""
        again, self.made = self.made, True
        if again or self.is_immediate:
            raise KeyboardInterrupt


@contextmanager
def stop_signals() -> Iterator[SignalStop]:
    """Yield the request that SIGINT and SIGTERM make while the body runs."""
    request = SignalStop()
    numbers = (signal.SIGINT, signal.SIGTERM)
    before = [signal.signal(number, request.handle) for number in numbers]
    try:
        yield request
    finally:
        for number, handler in zip(numbers, before, strict=True):
            signal.signal(number, handler)
