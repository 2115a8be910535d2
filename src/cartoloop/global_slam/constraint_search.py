# SPDX-License-Identifier: Apache-2.0
"""The background search: requests in, loop closures out, in the order of the requests."""

from __future__ import annotations

import os
from collections.abc import Callable, Container, Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from time import perf_counter
from typing import TypeVar

import numpy as np

from cartoloop.config import ConstraintSearchConfig
from cartoloop.global_slam.closure_search import FoundClosures, search
from cartoloop.global_slam.finished_submap import FinishedSubmap
from cartoloop.global_slam.loop_closure import FOUND, REQUEST, Closures, Requests
from cartoloop.global_slam.node_points import NodePoints
from cartoloop.growing_array import GrowingArray

Item = TypeVar("Item")
Answer = TypeVar("Answer")

MAX_THREADS = 4
"""More threads than this have nothing to do."""

BATCH = 50
"""Nodes sought in one submap by one task of a background thread."""

STRIDE = 4
"""In a task every so many-th node is sought first, then those between: if closures enough are found
between two submaps, they are spread over the way, and the rest need not be sought."""

FEW, PATIENCE = 12, 2
"""Submaps in which fewer nodes are to be sought are put off, so many times at the most."""

PRECOMPUTED_BYTES = 32 * 2**20
"""About how much is kept of what was computed of submaps to search them."""


class ConstraintSearch:
    """Runs searches in background threads; the results come in the order of the requests.

    The order, and with it the result, does not depend on which thread finishes first.

    Parameters
    ----------
    config : what is accepted.
    submaps : the finished submaps by their index; whoever owns it adds to it.
    node_points : the returns of the nodes, likewise.
    num_threads : how many threads search; 0: as many as there are processors, at most 4;
        one less with a bound.
    max_backlog : with more searches than this behind, new ones are dropped; None: never.

    Attributes
    ----------
    num_searched : how many searches were made.
    num_dropped : how many were dropped instead.
    durations : time that each task of a thread took [s].
    """

    def __init__(
        self,
        config: ConstraintSearchConfig,
        submaps: Sequence[FinishedSubmap],
        node_points: NodePoints,
        num_threads: int,
        max_backlog: int | None = None,
    ) -> None:
        self._config = config
        self._submaps = submaps
        self._node_points = node_points
        self._max_backlog = max_backlog
        # Where nobody is to wait, one processor is left to the rest.
        num_processors = (os.cpu_count() or 1) - (max_backlog is not None)
        num_threads = num_threads or min(max(num_processors, 1), MAX_THREADS)
        self._threads = ThreadPoolExecutor(num_threads, thread_name_prefix="loop-closure")
        self._waiting = GrowingArray((), REQUEST)
        self._pending: list[tuple[Future[tuple[FoundClosures, float]], int]] = []
        self._kept: dict[int, FinishedSubmap] = {}
        self._num_submitted = 0
        self._times_put_off: dict[int, int] = {}
        self.num_searched = 0
        self.num_dropped = 0
        self.durations: list[float] = []

    @property
    def backlog(self) -> int:
        """How many searches were submitted and are not done; may be asked in any thread."""
        return len(self._waiting) + self.num_running

    @property
    def num_running(self) -> int:
        """How many of them were started; may be asked in any thread."""
        return sum(size for future, size in self._pending if not future.done())

    def submit(self, requests: Requests) -> None:
        """Note what is to be searched when :meth:`start` is called next; numbers it in place."""
        if self._max_backlog is not None:
            room = max(0, self._max_backlog - self.backlog)
            self.num_dropped += max(0, len(requests) - room)
            requests = requests[:room]
        if len(requests):
            requests["number"] = np.arange(len(requests)) + self._num_submitted
            self._num_submitted += len(requests)
            self._waiting.extend(requests)

    def start(self, *, put_off: bool = False) -> None:
        """Hand what was submitted to the threads; returns at once.

        Those in the same submap go together: what a search needs of it is made once.

        Parameters
        ----------
        put_off : whether submaps in which few nodes are to be sought may wait for more of them.
        """
        waiting, self._waiting = by_submap(self._waiting.view), GrowingArray((), REQUEST)
        if put_off:
            self._put_off(waiting)
        # those first of which there is something, lest it be dropped for the others
        for index in sorted(waiting, key=lambda i: (i not in self._kept, waiting[i]["number"][0])):
            submap, requests = self._submaps[index], waiting[index]
            self._keep(submap, waiting)
            for first in range(0, len(requests), BATCH):
                batch = requests[first : first + BATCH]
                future = self._threads.submit(self._run, submap, batch)
                self._pending.append((future, len(batch)))

    def _put_off(self, waiting: dict[int, Requests]) -> None:
        """Take out the submaps that may wait: to make their precomputed grids takes longer."""
        for index in list(waiting):
            times = self._times_put_off.get(index, 0)
            if index in self._kept or len(waiting[index]) >= FEW or times == PATIENCE:
                self._times_put_off.pop(index, None)
            else:
                self._times_put_off[index] = times + 1
                self._waiting.extend(waiting.pop(index))

    def collect(self, *, wait: bool = True) -> Closures:
        """Return what was found, in the order submitted.

        Parameters
        ----------
        wait : for all that was started; otherwise what is not done is left for the next time.
        """
        pending, self._pending = self._pending, []
        if not wait:
            started, pending = pending, [task for task in pending if task[0].done()]
            self._pending = [task for task in started if task not in pending]
        found = GrowingArray((), FOUND)
        for future, _ in pending:
            batch, duration = future.result()
            found.extend(batch.closures)
            self.num_searched += batch.num_searched
            self.durations.append(duration)
        return found.view[np.argsort(found.view["request"]["number"], kind="stable")]

    def map(self, task: Callable[[Item], Answer], items: Iterable[Item]) -> Iterator[Answer]:
        """Run a task on each of the items in the background threads; answers in their order."""
        return self._threads.map(task, items)

    def close(self) -> None:
        """Drop what is not begun and end the threads."""
        self._threads.shutdown(wait=True, cancel_futures=True)

    def _keep(self, submap: FinishedSubmap, wanted: Container[int]) -> None:
        """Keep what is computed of a submap if there is room, or others that are not wanted."""
        self._kept.pop(submap.index, None)
        room = PRECOMPUTED_BYTES - submap.search_bytes
        room -= sum(kept.search_bytes for kept in self._kept.values())
        for index in [index for index in self._kept if index not in wanted]:
            if room < 0:
                dropped = self._kept.pop(index)
                room += dropped.search_bytes
                dropped.release()
        if room >= 0:
            self._kept[submap.index] = submap

    def _run(self, submap: FinishedSubmap, requests: Requests) -> tuple[FoundClosures, float]:
        """Return what one task found, and the time that it took [s]."""
        start = perf_counter()
        found = search(submap, spread_out(requests), self._node_points.view, self._config)
        if submap.index not in self._kept:
            submap.release()
        return found, perf_counter() - start


def by_submap(requests: Requests) -> dict[int, Requests]:
    """Return the requests of each submap in their order, the submaps ascending."""
    together = requests[np.argsort(requests["submap"], kind="stable")]
    submaps, firsts = np.unique(together["submap"], return_index=True)
    return dict(zip(submaps.tolist(), np.split(together, firsts[1:]), strict=False))


def spread_out(requests: Requests) -> Requests:
    """Return the requests, every :data:`STRIDE`-th first."""
    return requests[np.argsort(np.arange(len(requests)) % STRIDE, kind="stable")]
