# SPDX-License-Identifier: Apache-2.0
"""Runs searches of the whole map: at once, or in a thread beside the scans that follow.

A search takes longer than a scan may. A recording waits for it, so that its answers are the same in
every run; a robot gets the answer with the first scan after the search has ended.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import NamedTuple

from cartoloop.localisation.decision import Decision
from cartoloop.sensor.pose import Pose


class Finished(NamedTuple):
    """A search that has ended.

    Attributes
    ----------
    decision : what it amounts to.
    tf_local_searched : pose of the newest scan that was searched, local frame.
    """

    decision: Decision
    tf_local_searched: Pose


class SearchRunner:
    """Runs one search after the other.

    Parameters
    ----------
    in_background : whether searches run in a thread; otherwise `begin` waits for them.
    """

    def __init__(self, *, in_background: bool) -> None:
        self._threads = (
            ThreadPoolExecutor(1, thread_name_prefix="localisation") if in_background else None
        )
        self._running: Future[Finished] | None = None
        self._finished: Finished | None = None

    @property
    def is_busy(self) -> bool:
        """Whether a search has begun whose result was not taken."""
        return self._running is not None or self._finished is not None

    def begin(self, search: Callable[[], Decision], tf_local_searched: Pose) -> None:
        """Begin a search; the runner must not be busy."""

        def run() -> Finished:
            return Finished(search(), tf_local_searched)

        if self._threads is None:
            self._finished = run()
        else:
            self._running = self._threads.submit(run)

    def take(self) -> Finished | None:
        """Return the result of the search if it has ended, once; errors of it are raised."""
        if self._running is not None and self._running.done():
            self._finished, self._running = self._running.result(), None
        finished, self._finished = self._finished, None
        return finished

    def call_when_ended(self, function: Callable[[], None]) -> None:
        """Call a function, in any thread, when the search has ended; at once if none is running."""
        running = self._running
        if running is None:
            function()
        else:
            running.add_done_callback(lambda _: function())

    def forget(self) -> None:
        """Do not wait for the search any longer; its result is not wanted."""
        if self._running is not None:
            self._running.cancel()
        self._running = self._finished = None
