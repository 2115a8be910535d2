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


def end_orderly() -> None:
    """Let SIGTERM and SIGHUP end this process as its last line does: temporary files are removed.

    While something is mapped, `stop_signals` gives them another meaning.
    """
    for number in _endings():
        signal.signal(number, _end)


def _end(number: int, frame: FrameType | None) -> None:
    raise SystemExit(128 + number)


def _endings() -> list[signal.Signals]:
    """Return the signals that end a process from outside; without SIGHUP where it is ignored."""
    numbers = [signal.SIGTERM]
    if hasattr(signal, "SIGHUP") and signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN:
        numbers.append(signal.SIGHUP)
    return numbers


@contextmanager
def stop_signals() -> Iterator[SignalStop]:
    """Yield the request that SIGINT, SIGTERM and SIGHUP make while the body runs.

    A terminal that is closed, as by a dropped connection, sends SIGHUP; nohup has it ignored.
    """
    request = SignalStop()
    numbers = [signal.SIGINT, *_endings()]
    before = [signal.signal(number, request.handle) for number in numbers]
    try:
        yield request
    finally:
        for number, handler in zip(numbers, before, strict=True):
            signal.signal(number, handler)
