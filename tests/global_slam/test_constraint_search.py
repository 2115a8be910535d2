# SPDX-License-Identifier: Apache-2.0
"""Searches in the background: answers in the order of the requests, in bounded memory."""

from __future__ import annotations

from threading import Event

import numpy as np
import pytest

from cartoloop.config import ConstraintSearchConfig
from cartoloop.global_slam import constraint_search
from cartoloop.global_slam.closure_search import FoundClosures
from cartoloop.global_slam.constraint_search import ConstraintSearch, spread_out
from cartoloop.global_slam.finished_submap import FinishedSubmap
from cartoloop.global_slam.loop_closure import FOUND
from cartoloop.global_slam.node_points import NodePoints
from cartoloop.submaps.finished_grid import FinishedGrid
from tests.global_slam.closures import requests


def submap(index):
    return FinishedSubmap(index, FinishedGrid(np.ones((10, 10), np.uint8), 0.0, 0.0, 0.1), 0.9)


def submaps(count):
    return [submap(index) for index in range(count)]


def search_in(submaps, num_threads=1, **limits):
    return ConstraintSearch(ConstraintSearchConfig(), submaps, NodePoints(), num_threads, **limits)


def all_met(requests):
    """As if every request had been met."""
    met = np.zeros(len(requests), FOUND)
    met["submap"], met["node"], met["request"] = requests["submap"], requests["node"], requests
    return met


def pairs(closures):
    return list(zip(closures["submap"].tolist(), closures["node"].tolist(), strict=True))


@pytest.fixture
def found_in_even_submaps(monkeypatch):
    """Searches that find every node in a submap of even index, after making its smooth map."""

    def search(submap, requests, node_points, config):
        submap.smooth_map  # noqa: B018 - as a search makes it
        assert (requests["submap"] == submap.index).all()
        return FoundClosures(all_met(requests[: 0 if submap.index % 2 else None]), len(requests))

    monkeypatch.setattr(constraint_search, "search", search)


@pytest.mark.usefixtures("found_in_even_submaps")
@pytest.mark.parametrize("num_threads", [1, 4])
def test_closures_come_in_the_order_of_the_requests(num_threads):
    search = search_in(submaps(7), num_threads)
    rng = np.random.default_rng(1)
    expected = []
    for node in range(300):
        index = int(rng.integers(7))
        search.submit(requests((index, node), (index, 1000 + node)))
        if index % 2 == 0:
            expected += [(index, node), (index, 1000 + node)]
    search.start()
    assert pairs(search.collect()) == expected
    assert search.num_searched == 600
    assert len(search.collect()) == 0
    search.close()


@pytest.mark.usefixtures("found_in_even_submaps")
def test_what_was_searched_longest_ago_is_dropped(monkeypatch):
    few = submaps(5)
    monkeypatch.setattr(constraint_search, "PRECOMPUTED_BYTES", 2 * few[0].search_bytes)
    search = search_in(few, 2)
    for node, index in enumerate((0, 1, 2, 3, 0, 4)):
        search.submit(requests((index, node)))
        search.start()
        search.collect()
    assert [submap._smooth_map is not None for submap in few] == [
        True, False, False, False, True,
    ]  # fmt: skip
    search.close()


@pytest.mark.usefixtures("found_in_even_submaps")
def test_a_round_over_more_submaps_than_fit_keeps_some_of_them(monkeypatch):
    many = submaps(9)
    monkeypatch.setattr(constraint_search, "PRECOMPUTED_BYTES", 3 * many[0].search_bytes)
    search = search_in(many, 2)
    for index in range(9):
        search.submit(requests((index, 0)))
    search.start()
    assert len(search.collect()) == 5
    assert sum(submap._smooth_map is not None for submap in many) == 3
    search.close()


@pytest.mark.usefixtures("found_in_even_submaps")
def test_what_is_submitted_after_a_start_is_collected_after_the_next():
    search = search_in(submaps(3), 2)
    search.submit(requests((0, 0)))
    search.start()
    search.submit(requests((2, 1)))
    search.submit(requests((0, 2)))
    assert pairs(search.collect()) == [(0, 0)]
    search.start()
    assert pairs(search.collect()) == [(2, 1), (0, 2)]
    search.close()


def searched_after(search, submap, counts):
    """Return how many searches were made after each start that may put off, of so many new ones."""
    found = []
    for count in counts:
        search.submit(requests(*((submap, node) for node in range(count))))
        search.start(put_off=True)
        search.collect()
        found.append(search.num_searched)
    return found


@pytest.mark.usefixtures("found_in_even_submaps")
def test_submaps_wait_until_they_are_worth_their_grids_but_not_for_long(monkeypatch):
    monkeypatch.setattr(constraint_search, "PRECOMPUTED_BYTES", 0)
    search = search_in(submaps(3))
    assert searched_after(search, 0, (7, 4, 1)) == [0, 0, 12]
    assert searched_after(search, 2, (1, 0, 0, 11, 1)) == [12, 12, 13, 13, 25]
    search.close()


@pytest.mark.usefixtures("found_in_even_submaps")
def test_in_the_end_nothing_is_put_off():
    search = search_in(submaps(3))
    assert searched_after(search, 0, (3,)) == [0]
    search.start()
    assert len(search.collect()) == 3
    search.close()


@pytest.mark.usefixtures("found_in_even_submaps")
def test_submaps_whose_grids_are_there_do_not_wait():
    search = search_in(submaps(3))
    assert searched_after(search, 0, (12, 1, 1)) == [12, 13, 14]
    search.close()


def test_nodes_are_sought_spread_over_the_way():
    spread = spread_out(requests(*((0, node) for node in range(10))))
    assert spread["node"].tolist() == [0, 4, 8, 1, 5, 9, 2, 6, 3, 7]


def test_nothing_is_sought_for_no_requests():
    search = search_in(submaps(3))
    search.submit(requests())
    search.start()
    assert search.num_searched == 0
    assert len(search.collect()) == 0
    search.close()


@pytest.mark.usefixtures("found_in_even_submaps")
def test_the_backlog_is_what_was_submitted_and_is_not_done():
    search = search_in(submaps(3))
    assert search.backlog == 0
    search.submit(requests((0, 0), (0, 1)))
    search.submit(requests((2, 2)))
    assert search.backlog == 3
    search.start()
    search.collect()
    assert search.backlog == 0
    search.close()


def test_what_is_not_done_is_left_for_the_next_time(monkeypatch):
    may_end = Event()

    def search(submap, requests, node_points, config):
        assert may_end.wait(300.0)
        return FoundClosures(all_met(requests), len(requests))

    monkeypatch.setattr(constraint_search, "search", search)
    search = search_in(submaps(3))
    search.submit(requests((0, 1), (0, 2)))
    search.start()

    assert len(search.collect(wait=False)) == 0
    assert search.backlog == 2
    may_end.set()
    assert pairs(search.collect()) == [(0, 1), (0, 2)]
    assert search.num_searched == 2
    search.close()


@pytest.mark.usefixtures("found_in_even_submaps")
def test_searches_too_far_behind_are_dropped_and_counted():
    search = search_in(submaps(7), max_backlog=5)
    search.submit(requests(*((0, node) for node in range(3))))
    search.submit(requests(*((2, node) for node in range(4))))
    search.submit(requests((4, 0)))

    assert (search.backlog, search.num_dropped) == (5, 3)
    search.start()
    assert pairs(search.collect()) == [
        (0, 0), (0, 1), (0, 2), (2, 0), (2, 1),
    ]  # fmt: skip
    search.submit(requests((6, 0)))
    assert (search.backlog, search.num_dropped) == (1, 3)
    search.close()
