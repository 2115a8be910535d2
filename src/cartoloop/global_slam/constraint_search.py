# SPDX-License-Identifier: Apache-2.0
"""The background search: requests in, loop closures out, in the order of the requests."""

from __future__ import annotations

import os
from collections.abc import Callable, Container, Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from time import perf_counter
from typing import TypeVar

import numpy as np

from cartoloop.arrays import RowArray
from cartoloop.config import ConstraintSearchConfig
from cartoloop.global_slam.closure_matches import Requests, SearchMatches
from cartoloop.global_slam.closure_search import NO_MATCHES, FinishedSubmap, SearchOutcome, search
from cartoloop.global_slam.closure_status import Reason
from cartoloop.global_slam.closures import Closures
from cartoloop.global_slam.graph_records import outcomes_record, recorded_outcomes, rows_record
from cartoloop.growing_array import GrowingArray
from cartoloop.journal.frames import Kind
from cartoloop.journal.outcomes import NO_OUTCOMES, RecordedOutcomes
from cartoloop.sensor.scan_points import NodePoints

Item = TypeVar("Item")
Answer = TypeVar("Answer")

MAX_THREADS = 4
"""Upper limit of the number of search threads chosen by default: more would be idle."""

PRECOMPUTED_BYTES = 32 * 2**20
"""Size of the cache of precomputed grids [bytes]."""


@dataclass(slots=True, eq=False)
class _Task:
    """Requests in one submap.

    Attributes
    ----------
    submap : where to search.
    rows : of the record.
    requests : of these rows.
    future : what came of it and how long it took [s]; None: not started.
    """

    submap: FinishedSubmap
    rows: RowArray
    requests: Requests
    future: Future[tuple[SearchOutcome, float]] | None = None

    @property
    def is_done(self) -> bool:
        """Whether the search has ended."""
        return self.future is not None and self.future.done()


class ConstraintSearch:
    """Runs searches in background threads; the results come in the order of the requests.

    The order, and with it the result, does not depend on which thread finishes first.

    Parameters
    ----------
    config : windows and thresholds.
    closures : the record; requests are read from it, and what became of them is noted in it.
    submaps : the finished submaps by their index; the owner adds to it.
    node_points : the returns of the nodes, likewise.
    num_threads : how many threads search; 0: as many as there are processors, at most 4;
        one less with a bound.
    max_backlog : with more searches than this waiting, new ones are dropped; None: never.
    outcomes : of a run with a journal; those of earlier steps are replayed, new ones are recorded.

    Attributes
    ----------
    durations : time that each task of a thread took [s].
    """

    def __init__(
        self,
        config: ConstraintSearchConfig,
        closures: Closures,
        submaps: Sequence[FinishedSubmap],
        node_points: NodePoints,
        num_threads: int,
        max_backlog: int | None = None,
        outcomes: RecordedOutcomes = NO_OUTCOMES,
    ) -> None:
        self._recorded = outcomes
        self._config = config
        self._closures = closures
        self._submaps = submaps
        self._node_points = node_points
        self._max_backlog = max_backlog
        # In live mapping one processor is left to the rest.
        num_processors = (os.cpu_count() or 1) - (max_backlog is not None)
        num_threads = num_threads or min(max(num_processors, 1), MAX_THREADS)
        self._threads = ThreadPoolExecutor(num_threads, thread_name_prefix="loop-closure")
        self._waiting = GrowingArray((), np.int32)
        self._pending: list[_Task] = []
        self._kept: dict[int, FinishedSubmap] = {}
        self._num_deferrals: dict[int, int] = {}
        self.durations: list[float] = []

    @property
    def backlog(self) -> int:
        """Number of searches that were submitted and are not done; for any thread."""
        return self.num_waiting + self.num_running

    @property
    def num_running(self) -> int:
        """Number of searches that were started and are not done; for any thread."""
        return sum(len(task.rows) for task in self._pending if not task.is_done)

    @property
    def num_waiting(self) -> int:
        """Number of searches that were submitted and not started."""
        return len(self._waiting)

    def submit(self, rows: RowArray) -> None:
        """Add requests, ascending rows of the record; :meth:`start` starts their search."""
        if self._max_backlog is not None:
            room = max(0, self._max_backlog - self.backlog)
            self._note_dropped(rows[room:])
            rows = rows[:room]
        self._waiting.extend(rows)

    def start(self, *, may_defer: bool = False) -> None:
        """Pass the submitted requests to the threads; returns immediately.

        Requests in the same submap go together, so that its grids are precomputed once.

        Parameters
        ----------
        may_defer : whether submaps with few requests may wait for more of them.
        """
        config = self._config
        waiting = by_submap(self._waiting.view, self._closures.submap)
        self._waiting = GrowingArray((), np.int32)
        if may_defer:
            self._defer(waiting)
        # Submaps whose grids are cached come first, before the others replace them.
        for index in sorted(waiting, key=lambda i: (i not in self._kept, waiting[i][0])):
            submap, rows = self._submaps[index], waiting[index]
            self._keep(submap, waiting)
            for first in range(0, len(rows), config.search_batch_size):
                batch = spread_out(
                    rows[first : first + config.search_batch_size], config.search_stride
                )
                requests = self._closures.requests(batch)
                self._pending.append(_Task(submap, batch, requests))
        if not self._recorded.is_replaying:
            self._launch()

    def _defer(self, waiting: dict[int, RowArray]) -> None:
        """Take out the submaps that may wait: to precompute their grids takes longer."""
        config = self._config
        for index in list(waiting):
            times = self._num_deferrals.get(index, 0)
            enough = len(waiting[index]) >= config.min_search_batch
            if index in self._kept or enough or times == config.max_search_deferrals:
                self._num_deferrals.pop(index, None)
            else:
                self._num_deferrals[index] = times + 1
                self._waiting.extend(waiting.pop(index))

    def collect(self, *, wait: bool = True) -> SearchMatches:
        """Return what was found, in the order of the requests; note the others in the record.

        Parameters
        ----------
        wait : for all searches that were started; otherwise unfinished ones are left for the next
            call.
        """
        if (recorded := self._recorded.replay(Kind.SEARCHED)) is not None:
            places, outcomes = recorded_outcomes(recorded)
        else:
            self._launch()
            places, outcomes = self._outcomes(wait=wait)
            if self._recorded.is_recording and (outcomes or self._recorded.is_replayable):
                self._recorded.record(Kind.SEARCHED, outcomes_record(places, outcomes))
        taken = frozenset(places)
        self._pending = [task for i, task in enumerate(self._pending) if i not in taken]
        self._note(outcomes)
        found = [NO_MATCHES, *(each.matches for each in outcomes if len(each.matches.row))]
        together = SearchMatches._make(map(np.concatenate, zip(*found, strict=True)))
        order = np.argsort(together.row, kind="stable")
        return SearchMatches._make(column[order] for column in together)

    def _outcomes(self, *, wait: bool) -> tuple[list[int], list[SearchOutcome]]:
        """Return what searches came to, and their places among those that are running."""
        places, outcomes = [], []
        for place, task in enumerate(self._pending):
            if task.future is not None and (wait or task.is_done):
                outcome, duration = task.future.result()
                places.append(place)
                outcomes.append(outcome)
                self.durations.append(duration)
        return places, outcomes

    def _launch(self) -> None:
        """Start the searches that were not, since their outcomes might have been recorded."""
        for task in self._pending:
            if task.future is None:
                task.future = self._threads.submit(self._run, task)

    def _note_dropped(self, rows: RowArray) -> None:
        self._closures.note_dropped(rows)
        if self._recorded.is_recording and len(rows):
            self._recorded.record(Kind.DROPPED, rows_record(rows))

    def _note(self, outcomes: Sequence[SearchOutcome]) -> None:
        """Note in the record what was searched, and what was not."""
        if outcomes:
            searched = [outcome.searched for outcome in outcomes]
            min_scores = [outcome.min_score for outcome in outcomes]
            self._closures.note_searched(
                np.concatenate(searched), np.repeat(min_scores, [len(rows) for rows in searched])
            )
        for outcome in outcomes:
            self._closures.note_ambiguous(outcome.ambiguous)
            if len(outcome.not_searched):
                reason = Reason.EMPTY_SUBMAP if outcome.is_empty else Reason.ENOUGH_CLOSURES
                self._closures.note_not_searched(outcome.not_searched, reason)

    def map(self, task: Callable[[Item], Answer], items: Iterable[Item]) -> Iterator[Answer]:
        """Run a task on each of the items in the background threads; answers in their order."""
        return self._threads.map(task, items)

    def run(
        self, task: Callable[[FinishedSubmap], Answer], submap: FinishedSubmap
    ) -> Future[Answer]:
        """Run a task on a submap in a background thread."""

        def run() -> Answer:
            answer = task(submap)
            if submap.index not in self._kept:
                submap.release()
            return answer

        return self._threads.submit(run)

    def close(self) -> None:
        """Drop tasks that have not begun and end the threads."""
        self._threads.shutdown(wait=True, cancel_futures=True)

    def _keep(self, submap: FinishedSubmap, wanted: Container[int]) -> None:
        """Cache what is computed for a submap if there is room, or others are not wanted."""
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

    def _run(self, task: _Task) -> tuple[SearchOutcome, float]:
        """Return what one task found, and the time that it took [s]."""
        start = perf_counter()
        submap, points = task.submap, self._node_points.view
        outcome = search(submap, task.rows, task.requests, points, self._config)
        if submap.index not in self._kept:
            submap.release()
        return outcome, perf_counter() - start


def by_submap(rows: RowArray, submap_of_row: RowArray) -> dict[int, RowArray]:
    """Return the requests of each submap in their order, the submaps ascending."""
    submaps = submap_of_row[rows]
    order = np.argsort(submaps, kind="stable")
    numbers, firsts = np.unique(submaps[order], return_index=True)
    return dict(zip(numbers.tolist(), np.split(rows[order], firsts[1:]), strict=False))


def spread_out(rows: RowArray, stride: int) -> RowArray:
    """Return the requests, every `stride`-th first.

    Closures between two submaps are spread along the path then, and after
    ``max_closures_of_pair`` of them the rest is not searched.
    """
    return rows[np.argsort(np.arange(len(rows)) % stride, kind="stable")]
