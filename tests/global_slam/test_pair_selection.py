# SPDX-License-Identifier: Apache-2.0
"""How well the graph knows a pair, how large a window that asks for, and which pairs are sought."""

from __future__ import annotations

import math

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


def test_the_window_grows_with_the_uncertain_length():
    linear, angular = selection([]).windows(np.array((0.0, 20.0)))
    assert linear == pytest.approx([0.5, 1.5])
    assert angular == pytest.approx(np.radians((5.0, 15.0)))


@settings(deadline=None, max_examples=60)
@given(lengths=st.lists(st.floats(0.0, 1e5), min_size=2, max_size=5))
def test_windows_are_never_larger_than_configured_nor_smaller_for_more_uncertainty(lengths):
    linear, angular = selection([]).windows(np.sort(lengths))
    assert (linear >= 0.5).all()
    assert (linear <= 7.0).all()
    assert (angular >= math.radians(5.0)).all()
    assert (angular <= math.radians(30.0) + 1e-12).all()
    assert (np.diff(linear) >= 0.0).all()
    assert (np.diff(angular) >= 0.0).all()


def test_before_the_first_adjustment_no_ways_are_known():
    assert len(PairSelection(CONFIG).ways_from(0)) == 0


def test_without_closures_ways_lead_along_the_path():
    assert selection([0.0, 9.0, 18.0, 28.0]).ways_from(1) == pytest.approx([9.0, 0.0, 9.0, 19.0])


def test_a_closure_shortens_the_ways_between_its_submaps_and_their_neighbours():
    way = selection([0.0, 9.0, 18.0, 27.0, 36.0], [(0, 4)])
    closure = CLOSURE_LENGTH_M
    assert way.ways_from(0) == pytest.approx([0.0, 9.0, 18.0, 9.0 + closure, closure])
    assert way.ways_from(1) == pytest.approx([9.0, 0.0, 9.0, 18.0, 9.0 + closure])


def test_closures_count_once_and_in_both_directions():
    once = selection([0.0, 9.0, 18.0, 27.0], [(0, 3)])
    often = selection([0.0, 9.0, 18.0, 27.0], [(0, 3), (3, 0), (0, 3), (2, 2)])
    for submap in range(4):
        assert often.ways_from(submap) == pytest.approx(once.ways_from(submap))


def test_from_submaps_begun_since_the_last_adjustment_no_ways_are_known():
    assert len(selection([0.0, 9.0], [(0, 1)]).ways_from(2)) == 0


@pytest.mark.parametrize("num_submaps", [1, 2])
def test_few_submaps_are_no_error(num_submaps):
    assert selection(9.0 * np.arange(num_submaps)).ways_from(0)[0] == 0.0


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

    for submap in range(num_submaps):
        assert way.ways_from(submap) == pytest.approx(shortest[submap])


def num_taken(selection, length, submap=0, node_submap=5):
    return sum(selection.take(submap, node_submap, length) for _ in range(200))


def test_pairs_that_are_not_bound_are_sought_as_often_as_they_are_due():
    assert num_taken(selection([]), 50.0) == 200


def test_bound_pairs_are_not_sought_for_ever():
    assert num_taken(selection([]), 2.0) == 4


def test_pairs_of_other_submaps_are_counted_by_themselves():
    pairs = selection([])
    num_taken(pairs, 2.0, node_submap=5)
    assert num_taken(pairs, 2.0, node_submap=6) == 4
    assert num_taken(pairs, 2.0, submap=1, node_submap=5) == 4


def test_a_pair_with_closures_enough_is_sought_no_more():
    pairs = selection([])
    pairs.note_found(0, 5)
    assert pairs.take(0, 5, 50.0)
    pairs.note_found(0, 5)
    assert not pairs.take(0, 5, 50.0)
    assert pairs.take(0, 6, 50.0)
