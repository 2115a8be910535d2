# SPDX-License-Identifier: Apache-2.0
"""Searches in the background: answers in the order of the requests, in bounded memory."""

from __future__ import annotations

from threading import Event

import numpy as np
import pytest

from cartoloop.config import ConstraintSearchConfig
from cartoloop.global_slam import constraint_search
from cartoloop.global_slam.closure_search import NO_MATCHES, FinishedSubmap, SearchOutcome
from cartoloop.global_slam.closure_status import Reason, Status
from cartoloop.global_slam.closures import Closures
from cartoloop.global_slam.constraint_search import ConstraintSearch, spread_out
from cartoloop.sensor.scan_points import NodePoints
from cartoloop.submaps.finished_grid import FinishedGrid
from tests.global_slam.closures import requests, search_matches


def submap(index):
    return FinishedSubmap(index, FinishedGrid(np.ones((10, 10), np.uint8), 0.0, 0.0, 0.1), 0.9)


def submaps(count):
    return [submap(index) for index in range(count)]


class Searches:
    """A search with its record, asked by pairs of submap and node."""

    def __init__(self, submaps, num_threads=1, **limits):
        self.closures = Closures()
        self.search = ConstraintSearch(
            ConstraintSearchConfig(), self.closures, submaps, NodePoints(), num_threads, **limits
        )
        self.start, self.close = self.search.start, self.search.close

    def submit(self, *pairs):
        self.search.submit(self.closures.request(requests(*pairs), 9))

    def collect(self, **options):
        """Return the pairs that were found."""
        rows = self.search.collect(**options).row
        nodes = self.closures.node[rows].tolist()
        return list(zip(self.closures.submap[rows].tolist(), nodes, strict=True))


def found_rows(rows, count=None):
    """As if all of these requests had been searched, and the first `count` found."""
    matches = search_matches(rows[:count]) if len(rows[:count]) else NO_MATCHES
    return SearchOutcome(0.5, False, rows, rows[:0], rows[:0], matches)


@pytest.fixture
def found_in_even_submaps(monkeypatch):
    """Searches that find every node in a submap of even index, after making its smooth map."""

    def search(submap, rows, requests, node_points, config):
        submap.smooth_map  # noqa: B018 - as a search makes it
        assert (requests.submap == submap.index).all()
        return found_rows(rows, 0 if submap.index % 2 else None)

    monkeypatch.setattr(constraint_search, "search", search)


@pytest.mark.usefixtures("found_in_even_submaps")
@pytest.mark.parametrize("num_threads", [1, 4])
def test_closures_come_in_the_order_of_the_requests(num_threads):
    search = Searches(submaps(7), num_threads)
    rng = np.random.default_rng(1)
    expected = []
    for node in range(300):
        index = int(rng.integers(7))
        search.submit((index, node), (index, 1000 + node))
        if index % 2 == 0:
            expected += [(index, node), (index, 1000 + node)]
    search.start()
    assert search.collect() == expected
    assert search.closures.num_searched == 600
    assert len(search.collect()) == 0
    search.close()


@pytest.mark.usefixtures("found_in_even_submaps")
def test_cache_drops_the_least_recently_searched(monkeypatch):
    few = submaps(5)
    monkeypatch.setattr(constraint_search, "PRECOMPUTED_BYTES", 2 * few[0].search_bytes)
    search = Searches(few, 2)
    for node, index in enumerate((0, 1, 2, 3, 0, 4)):
        search.submit((index, node))
        search.start()
        search.collect()
    assert [submap._smooth_map is not None for submap in few] == [
        True, False, False, False, True,
    ]  # fmt: skip
    search.close()


@pytest.mark.usefixtures("found_in_even_submaps")
def test_cache_keeps_some_of_many_submaps(monkeypatch):
    many = submaps(9)
    monkeypatch.setattr(constraint_search, "PRECOMPUTED_BYTES", 3 * many[0].search_bytes)
    search = Searches(many, 2)
    for index in range(9):
        search.submit((index, 0))
    search.start()
    assert len(search.collect()) == 5
    assert sum(submap._smooth_map is not None for submap in many) == 3
    search.close()


@pytest.mark.usefixtures("found_in_even_submaps")
def test_requests_after_a_start_wait_for_the_next():
    search = Searches(submaps(3), 2)
    search.submit((0, 0))
    search.start()
    search.submit((2, 1))
    search.submit((0, 2))
    assert search.collect() == [(0, 0)]
    search.start()
    assert search.collect() == [(2, 1), (0, 2)]
    search.close()


def searched_after(search, submap, counts):
    """Return the searches made after each start that may defer, of `counts` new requests."""
    found = []
    for count in counts:
        search.submit(*((submap, node) for node in range(count)))
        search.start(may_defer=True)
        search.collect()
        found.append(search.closures.num_searched)
    return found


@pytest.mark.usefixtures("found_in_even_submaps")
def test_small_batches_are_deferred_at_most_twice(monkeypatch):
    monkeypatch.setattr(constraint_search, "PRECOMPUTED_BYTES", 0)
    search = Searches(submaps(3))
    assert searched_after(search, 0, (7, 4, 1)) == [0, 0, 12]
    assert searched_after(search, 2, (1, 0, 0, 11, 1)) == [12, 12, 13, 13, 25]
    search.close()


@pytest.mark.usefixtures("found_in_even_submaps")
def test_the_last_start_defers_nothing():
    search = Searches(submaps(3))
    assert searched_after(search, 0, (3,)) == [0]
    search.start()
    assert len(search.collect()) == 3
    search.close()


@pytest.mark.usefixtures("found_in_even_submaps")
def test_submaps_with_cached_grids_are_not_deferred():
    search = Searches(submaps(3))
    assert searched_after(search, 0, (12, 1, 1)) == [12, 13, 14]
    search.close()


def test_every_fourth_request_comes_first():
    spread = spread_out(np.arange(10, dtype=np.int32), 4)
    assert spread.tolist() == [0, 4, 8, 1, 5, 9, 2, 6, 3, 7]


def test_without_requests_nothing_is_searched():
    search = Searches(submaps(3))
    search.submit()
    search.start()
    assert search.closures.num_searched == 0
    assert len(search.collect()) == 0
    search.close()


@pytest.mark.usefixtures("found_in_even_submaps")
def test_backlog_counts_unfinished_requests():
    search = Searches(submaps(3))
    assert search.search.backlog == 0
    search.submit((0, 0), (0, 1))
    search.submit((2, 2))
    assert search.search.backlog == 3
    search.start()
    search.collect()
    assert search.search.backlog == 0
    search.close()


def test_unfinished_searches_are_collected_later(monkeypatch):
    may_end = Event()

    def search(submap, rows, requests, node_points, config):
        assert may_end.wait(300.0)
        return found_rows(rows)

    monkeypatch.setattr(constraint_search, "search", search)
    search = Searches(submaps(3))
    search.submit((0, 1), (0, 2))
    search.start()

    assert len(search.collect(wait=False)) == 0
    assert search.search.backlog == 2
    may_end.set()
    assert search.collect() == [(0, 1), (0, 2)]
    assert search.closures.num_searched == 2
    search.close()


@pytest.mark.usefixtures("found_in_even_submaps")
def test_requests_beyond_the_backlog_are_dropped():
    search = Searches(submaps(7), max_backlog=5)
    search.submit(*((0, node) for node in range(3)))
    search.submit(*((2, node) for node in range(4)))
    search.submit((4, 0))

    assert (search.search.backlog, search.closures.num_dropped) == (5, 3)
    search.start()
    assert search.collect() == [
        (0, 0), (0, 1), (0, 2), (2, 0), (2, 1),
    ]  # fmt: skip
    search.submit((6, 0))
    assert (search.search.backlog, search.closures.num_dropped) == (1, 3)
    search.close()


def test_the_record_says_what_became_of_requests(monkeypatch):
    def search(submap, rows, requests, node_points, config):
        return SearchOutcome(0.4, False, rows[:2], rows[2:], rows[:0], search_matches(rows[:1]))

    monkeypatch.setattr(constraint_search, "search", search)
    search = Searches(submaps(1))
    search.submit((0, 5), (0, 6), (0, 7))
    search.start()
    search.collect()
    search.close()

    closures = search.closures
    assert closures.status.tolist() == [Status.NOT_FOUND, Status.NOT_FOUND, Status.NOT_SEARCHED]
    assert closures.reason.tolist()[1:] == [Reason.BELOW_THRESHOLD, Reason.ENOUGH_CLOSURES]
    assert closures.min_score[:2].tolist() == [0.4, 0.4]


def test_submaps_without_cells_are_not_searched():
    empty = FinishedSubmap(0, FinishedGrid(np.zeros((0, 0), np.uint8), 0.0, 0.0, 0.1), 0.0)
    closures, points = Closures(), NodePoints()
    points.append(np.ones((30, 2)))
    search = ConstraintSearch(ConstraintSearchConfig(), closures, [empty], points, 1)
    search.submit(closures.request(requests((0, 0)), 1))
    search.start()
    assert len(search.collect().row) == 0
    search.close()

    assert closures.status.tolist() == [Status.NOT_SEARCHED]
    assert closures.reason.tolist() == [Reason.EMPTY_SUBMAP]
