# SPDX-License-Identifier: Apache-2.0
"""Searches in the background: answers in the order of the requests, in bounded memory."""

from __future__ import annotations

from threading import Event

import numpy as np
import pytest

from cartoloop.config import ConstraintSearchConfig
from cartoloop.global_slam import constraint_search
from cartoloop.global_slam.constraint_search import ConstraintSearch, spread_out
from cartoloop.global_slam.finished_submap import FinishedSubmap
from cartoloop.global_slam.loop_closure import Found, LoopClosure, SearchRequest
from cartoloop.sensor.pose import Pose
from cartoloop.submaps.finished_grid import FinishedGrid


def submap(index):
    return FinishedSubmap(index, FinishedGrid(np.ones((10, 10), np.uint8), 0.0, 0.0, 0.1), 0.9)


def request(submap, node):
    return SearchRequest(submap, node, node, np.zeros((1, 2)), Pose(0.0, 0.0, 0.0), 1.0, 0.1)


def closure(submap, node):
    return LoopClosure(submap, node, Pose(0.0, 0.0, 0.0), np.eye(3), 0.9, 0.0)


@pytest.fixture
def found_in_even_submaps(monkeypatch):
    """Searches that find every node in a submap of even index, after making its smooth map."""

    def search(submap, requests, config):
        submap.smooth_map  # noqa: B018 - as a search makes it
        assert all(request.submap == submap.index for request in requests)
        if submap.index % 2:
            return Found([], len(requests))
        closures = [(i, closure(one.submap, one.node)) for i, one in enumerate(requests)]
        return Found(closures, len(requests))

    monkeypatch.setattr(constraint_search, "search", search)


@pytest.mark.usefixtures("found_in_even_submaps")
@pytest.mark.parametrize("num_threads", [1, 4])
def test_closures_come_in_the_order_of_the_requests(num_threads):
    search = ConstraintSearch(ConstraintSearchConfig(), num_threads)
    submaps = [submap(index) for index in range(7)]
    rng = np.random.default_rng(1)
    expected = []
    for node in range(300):
        index = int(rng.integers(7))
        search.submit(submaps[index], [request(index, node), request(index, 1000 + node)])
        if index % 2 == 0:
            expected += [(index, node), (index, 1000 + node)]
    search.start()
    assert [(found.submap, found.node) for found in search.collect()] == expected
    assert search.num_searched == 600
    assert search.collect() == []
    search.close()


@pytest.mark.usefixtures("found_in_even_submaps")
def test_what_was_searched_longest_ago_is_dropped(monkeypatch):
    submaps = [submap(index) for index in range(5)]
    monkeypatch.setattr(constraint_search, "PRECOMPUTED_BYTES", 2 * submaps[0].search_bytes)
    search = ConstraintSearch(ConstraintSearchConfig(), 2)
    for node, index in enumerate((0, 1, 2, 3, 0, 4)):
        search.submit(submaps[index], [request(index, node)])
        search.start()
        search.collect()
    assert [submap._smooth_map is not None for submap in submaps] == [
        True, False, False, False, True,
    ]  # fmt: skip
    search.close()


@pytest.mark.usefixtures("found_in_even_submaps")
def test_a_round_over_more_submaps_than_fit_keeps_some_of_them(monkeypatch):
    submaps = [submap(index) for index in range(9)]
    monkeypatch.setattr(constraint_search, "PRECOMPUTED_BYTES", 3 * submaps[0].search_bytes)
    search = ConstraintSearch(ConstraintSearchConfig(), 2)
    for index in range(9):
        search.submit(submaps[index], [request(index, 0)])
    search.start()
    assert len(search.collect()) == 5
    assert sum(submap._smooth_map is not None for submap in submaps) == 3
    search.close()


@pytest.mark.usefixtures("found_in_even_submaps")
def test_what_is_submitted_after_a_start_is_collected_after_the_next():
    search = ConstraintSearch(ConstraintSearchConfig(), 2)
    first, second = submap(0), submap(2)
    search.submit(first, [request(0, 0)])
    search.start()
    search.submit(second, [request(2, 1)])
    search.submit(first, [request(0, 2)])
    assert [found.node for found in search.collect()] == [0]
    search.start()
    assert [found.node for found in search.collect()] == [1, 2]
    search.close()


def searched_after(search, submaps, counts):
    """Return how many searches were made after each start that may put off, of so many new ones."""
    found = []
    for count in counts:
        search.submit(submaps, [request(submaps.index, node) for node in range(count)])
        search.start(put_off=True)
        search.collect()
        found.append(search.num_searched)
    return found


@pytest.mark.usefixtures("found_in_even_submaps")
def test_submaps_wait_until_they_are_worth_their_grids_but_not_for_long(monkeypatch):
    monkeypatch.setattr(constraint_search, "PRECOMPUTED_BYTES", 0)
    search = ConstraintSearch(ConstraintSearchConfig(), 1)
    assert searched_after(search, submap(0), (7, 4, 1)) == [0, 0, 12]
    assert searched_after(search, submap(2), (1, 0, 0, 11, 1)) == [12, 12, 13, 13, 25]
    search.close()


@pytest.mark.usefixtures("found_in_even_submaps")
def test_in_the_end_nothing_is_put_off():
    search = ConstraintSearch(ConstraintSearchConfig(), 1)
    assert searched_after(search, submap(0), (3,)) == [0]
    search.start()
    assert len(search.collect()) == 3
    search.close()


@pytest.mark.usefixtures("found_in_even_submaps")
def test_submaps_whose_grids_are_there_do_not_wait():
    search = ConstraintSearch(ConstraintSearchConfig(), 1)
    assert searched_after(search, submap(0), (12, 1, 1)) == [12, 13, 14]
    search.close()


def test_nodes_are_sought_spread_over_the_way():
    numbered = [(number, request(0, number)) for number in range(10)]
    assert [number for number, _ in spread_out(numbered)] == [0, 4, 8, 1, 5, 9, 2, 6, 3, 7]


def test_nothing_is_sought_for_no_requests():
    search = ConstraintSearch(ConstraintSearchConfig(), 1)
    search.submit(submap(0), [])
    search.start()
    assert search.num_searched == 0
    assert search.collect() == []
    search.close()


@pytest.mark.usefixtures("found_in_even_submaps")
def test_the_backlog_is_what_was_submitted_and_is_not_done():
    search = ConstraintSearch(ConstraintSearchConfig(), 1)
    assert search.backlog == 0
    search.submit(submap(0), [request(0, 0), request(0, 1)])
    search.submit(submap(2), [request(2, 2)])
    assert search.backlog == 3
    search.start()
    search.collect()
    assert search.backlog == 0
    search.close()


def test_what_is_not_done_is_left_for_the_next_time(monkeypatch):
    may_end = Event()

    def search(submap, requests, config):
        assert may_end.wait(10.0)
        closures = [(i, closure(one.submap, one.node)) for i, one in enumerate(requests)]
        return Found(closures, len(requests))

    monkeypatch.setattr(constraint_search, "search", search)
    search = ConstraintSearch(ConstraintSearchConfig(), 1)
    search.submit(submap(0), [request(0, 1), request(0, 2)])
    search.start()

    assert search.collect(wait=False) == []
    assert search.backlog == 2
    may_end.set()
    assert [found.node for found in search.collect()] == [1, 2]
    assert search.num_searched == 2
    search.close()


@pytest.mark.usefixtures("found_in_even_submaps")
def test_searches_too_far_behind_are_dropped_and_counted():
    search = ConstraintSearch(ConstraintSearchConfig(), 1, max_backlog=5)
    search.submit(submap(0), [request(0, node) for node in range(3)])
    search.submit(submap(2), [request(2, node) for node in range(4)])
    search.submit(submap(4), [request(4, 0)])

    assert (search.backlog, search.num_dropped) == (5, 3)
    search.start()
    assert [(found.submap, found.node) for found in search.collect()] == [
        (0, 0), (0, 1), (0, 2), (2, 0), (2, 1),
    ]  # fmt: skip
    search.submit(submap(6), [request(6, 0)])
    assert (search.backlog, search.num_dropped) == (1, 3)
    search.close()
