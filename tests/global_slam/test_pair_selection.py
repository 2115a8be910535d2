# SPDX-License-Identifier: Apache-2.0
"""How well the graph knows a pair, how large a window that asks for, and which pairs are sought."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cartoloop.config import ConstraintSearchConfig
from cartoloop.global_slam.pair_selection import CLOSURE_LENGTH_M, PairSelection

CONFIG = ConstraintSearchConfig(
    linear_search_window=7.0,
    angular_search_window_deg=30.0,
    min_linear_search_window=0.5,
    min_angular_search_window_deg=5.0,
    linear_drift=0.05,
    angular_drift_deg=0.5,
    bound_length=10.0,
    every_nth_node=3,
    every_nth_bound_node=7,
    max_searches_of_bound_pair=4,
    max_closures_of_pair=2,
)
NO_CLOSURES = np.zeros((0, 2), dtype=np.int64)


def selection(travelled, closures=NO_CLOSURES):
    selection = PairSelection(CONFIG)
    selection.update(np.array(travelled, dtype=np.float64), np.array(closures).reshape(-1, 2))
    return selection


def length_of(selection, submap, node_submap, node_from_its_submap, travelled):
    pair = (np.array([submap]), np.array([node_submap]))
    ways = (np.array([node_from_its_submap]), np.array([travelled]))
    return selection.uncertain_lengths(*pair, *ways)[0]


def test_the_window_grows_with_the_uncertain_length():
    known, drifted = (selection([]).window(length) for length in (0.0, 20.0))
    assert known == pytest.approx((0.5, math.radians(5.0)))
    assert drifted == pytest.approx((1.5, math.radians(15.0)))


@settings(deadline=None, max_examples=60)
@given(lengths=st.lists(st.floats(0.0, 1e5), min_size=2, max_size=5))
def test_windows_are_never_larger_than_configured_nor_smaller_for_more_uncertainty(lengths):
    windows = [selection([]).window(length) for length in sorted(lengths)]
    for linear, angular in windows:
        assert 0.5 <= linear <= 7.0
        assert math.radians(5.0) <= angular <= math.radians(30.0) + 1e-12
    for smaller, larger in pairwise(windows):
        assert smaller[0] <= larger[0]
        assert smaller[1] <= larger[1]


def test_before_the_first_adjustment_only_the_way_travelled_is_known():
    assert length_of(PairSelection(CONFIG), 0, 3, 1.0, 42.0) == 42.0


def test_without_closures_the_way_is_the_one_travelled():
    way = selection([0.0, 9.0, 18.0, 27.0, 36.0])
    assert length_of(way, 0, 4, 2.0, 38.0) == pytest.approx(38.0)


def test_a_closure_shortens_the_way_between_its_submaps():
    way = selection([0.0, 9.0, 18.0, 27.0, 36.0], [(0, 4)])
    assert length_of(way, 0, 4, 2.0, 38.0) == pytest.approx(CLOSURE_LENGTH_M + 2.0)


def test_a_closure_shortens_the_way_between_their_neighbours():
    way = selection([0.0, 9.0, 18.0, 27.0, 36.0], [(0, 4)])
    assert length_of(way, 1, 4, 0.0, 27.0) == pytest.approx(9.0 + CLOSURE_LENGTH_M)
    assert length_of(way, 1, 3, 0.0, 18.0) == pytest.approx(18.0)


def test_closures_count_once_and_in_both_directions():
    once = selection([0.0, 9.0, 18.0, 27.0], [(0, 3)])
    often = selection([0.0, 9.0, 18.0, 27.0], [(0, 3), (3, 0), (0, 3), (2, 2)])
    for submap in range(4):
        for node_submap in range(4):
            assert length_of(often, submap, node_submap, 0.0, 1e3) == pytest.approx(
                length_of(once, submap, node_submap, 0.0, 1e3)
            )


def test_the_way_travelled_holds_where_it_is_shorter():
    way = selection([0.0, 9.0, 18.0])
    assert length_of(way, 0, 2, 5.0, 3.0) == 3.0


def test_submaps_begun_since_the_last_adjustment_are_known_by_the_way_travelled():
    way = selection([0.0, 9.0], [(0, 1)])
    assert length_of(way, 0, 2, 1.0, 19.0) == 19.0
    assert length_of(way, 2, 0, 1.0, 19.0) == 19.0


@pytest.mark.parametrize("num_submaps", [0, 1, 2])
def test_few_submaps_are_no_error(num_submaps):
    way = selection(9.0 * np.arange(num_submaps))
    assert length_of(way, 0, 0, 1.5, 1.5) == 1.5


@settings(deadline=None, max_examples=40)
@given(data=st.data(), num_submaps=st.integers(2, 8))
def test_the_way_is_the_shortest_of_all_ways(data, num_submaps):
    steps = data.draw(
        st.lists(st.floats(0.1, 6.0), min_size=num_submaps - 1, max_size=num_submaps - 1)
    )
    # Closures between neighbours are left to the way between these.
    apart = st.tuples(st.integers(0, num_submaps - 1), st.integers(0, num_submaps - 1)).filter(
        lambda pair: abs(pair[0] - pair[1]) != 1
    )
    closures = data.draw(st.lists(apart, max_size=6))
    travelled = np.concatenate(([0.0], np.cumsum(steps)))
    shortest = np.full((num_submaps, num_submaps), np.inf)
    np.fill_diagonal(shortest, 0.0)
    for k, step in enumerate(steps):
        shortest[k, k + 1] = shortest[k + 1, k] = step
    for a, b in closures:
        if a != b:
            shortest[a, b] = shortest[b, a] = min(shortest[a, b], CLOSURE_LENGTH_M)
    for via in range(num_submaps):
        shortest = np.minimum(shortest, shortest[:, via, None] + shortest[None, via, :])

    way = selection(travelled, np.array(closures, dtype=np.int64).reshape(-1, 2))

    for a in range(num_submaps):
        for b in range(num_submaps):
            assert length_of(way, a, b, 0.0, 1e3) == pytest.approx(shortest[a, b])


def taken(selection, length, submap=0, node_submap=5, nodes=range(200)):
    nodes = np.array(nodes)
    due = selection.are_due(np.full(len(nodes), submap), nodes, np.full(len(nodes), length))
    return [node for node in nodes[due].tolist() if selection.take(submap, node_submap, length)]


def test_of_pairs_that_are_not_bound_every_so_manyth_is_sought():
    assert len(taken(selection([]), 50.0)) == pytest.approx(200 / 3, abs=1)


def test_bound_pairs_are_sought_less_often_and_not_for_ever():
    sought = taken(selection([]), 2.0)
    assert np.diff(sought).tolist() == [7] * 3
    assert len(sought) == 4


@pytest.mark.parametrize("length", [2.0, 50.0])
def test_no_pair_is_due_that_may_not_be(length):
    due = selection([]).may_be_due(3, np.arange(200))
    nodes = taken(selection([]), length, submap=3)
    assert nodes
    assert due[nodes].all()
    assert not due.all()


def test_pairs_of_other_submaps_are_counted_by_themselves():
    pairs = selection([])
    taken(pairs, 2.0, node_submap=5)
    assert len(taken(pairs, 2.0, node_submap=6)) == 4
    assert len(taken(pairs, 2.0, submap=1, node_submap=5)) == 4


def test_a_pair_with_closures_enough_is_sought_no_more():
    pairs = selection([])
    pairs.note_found(0, 5)
    assert taken(pairs, 50.0)
    pairs.note_found(0, 5)
    assert taken(pairs, 50.0) == []
    assert taken(pairs, 50.0, node_submap=6)
