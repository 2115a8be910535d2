# SPDX-License-Identifier: Apache-2.0
"""Ctrl-C, termination, hanging up: the first signal stops at the next event, the second at once."""

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
        if (again or self.is_immediate) and not self.is_shielded:
            raise KeyboardInterrupt


@contextmanager
def stop_signals() -> Iterator[SignalStop]:
    """Yield the request that SIGINT, SIGTERM and SIGHUP make while the body runs.

    A terminal that is closed, as by a dropped connection, sends SIGHUP; nohup has it ignored.
    """
    request = SignalStop()
    numbers = [signal.SIGINT, signal.SIGTERM]
    if hasattr(signal, "SIGHUP") and signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN:
        numbers.append(signal.SIGHUP)
    before = [signal.signal(number, request.handle) for number in numbers]
    try:
        yield request
    finally:
        for number, handler in zip(numbers, before, strict=True):
            signal.signal(number, handler)
