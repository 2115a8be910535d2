# SPDX-License-Identifier: Apache-2.0
"""The background search: requests in, loop closures out, in the order of the requests."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from time import perf_counter
from typing import TypeVar

from cartoloop.config import ConstraintSearchConfig
from cartoloop.global_slam.finished_submap import FinishedSubmap, release_least_recent
from cartoloop.global_slam.loop_closure import LoopClosure, SearchRequest, search

Item = TypeVar("Item")
Answer = TypeVar("Answer")

MAX_THREADS = 4
"""More threads than this have nothing to do."""

PRECOMPUTED_BYTES = 96 * 2**20
"""Precomputed grids kept between two rounds of searches."""


class ConstraintSearch:
    """Runs searches in background threads; the results come in the order of the requests.

    The order, and with it the result, does not depend on which thread finishes first.
    """

    def __init__(self, config: ConstraintSearchConfig, num_threads: int) -> None:
        self._config = config
        num_threads = num_threads or min(os.cpu_count() or 1, MAX_THREADS)
        self._threads = ThreadPoolExecutor(num_threads, thread_name_prefix="loop-closure")
        self._pending: list[Future[tuple[list[LoopClosure], float]]] = []
        self._searched: dict[int, FinishedSubmap] = {}
        self._round = 1
        self.num_searched = 0
        self.durations: list[float] = []

    def submit(self, submap: FinishedSubmap, requests: Sequence[SearchRequest]) -> None:
        """Have nodes sought in one submap; returns at once."""
        if requests:
            self.num_searched += len(requests)
            submap.last_used = self._round
            self._searched[submap.index] = submap
            self._pending.append(self._threads.submit(self._run, submap, tuple(requests)))

    def collect(self) -> list[LoopClosure]:
        """Wait for all that was submitted and return what was found, in the order submitted."""
        pending, self._pending = self._pending, []
        found: list[LoopClosure] = []
        for future in pending:
            closures, duration = future.result()
            found += closures
            self.durations.append(duration)
        release_least_recent(self._searched.values(), PRECOMPUTED_BYTES)
        self._round += 1
        return found

    def map(self, task: Callable[[Item], Answer], items: Iterable[Item]) -> list[Answer]:
        """Run a task on each of the items in the background threads; answers in their order."""
        return list(self._threads.map(task, items))

    def close(self) -> None:
        """Drop what is not begun and end the threads."""
        self._threads.shutdown(wait=True, cancel_futures=True)

    def _run(
        self, submap: FinishedSubmap, requests: tuple[SearchRequest, ...]
    ) -> tuple[list[LoopClosure], float]:
        start = perf_counter()
        results = (search(submap, request, self._config) for request in requests)
        return [closure for closure in results if closure is not None], perf_counter() - start
