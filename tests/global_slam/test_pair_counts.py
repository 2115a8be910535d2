# SPDX-License-Identifier: Apache-2.0
"""How many searches and closures of two submaps are enough."""

import numpy as np

from cartoloop.config import ConstraintSearchConfig
from cartoloop.global_slam.pair_counts import PairCounts


def counts(**changes):
    return PairCounts(ConstraintSearchConfig(**changes))


def taken(of, path_length, submap=0, node_submap=4):
    """Return how many of equal requests the counts allow."""
    count = 200
    submaps, node_submaps = np.full(count, submap), np.full(count, node_submap)
    return len(of.take(submaps, node_submaps, np.full(count, path_length)))


def test_other_pairs_are_searched_whenever_they_are_due():
    few = counts(well_constrained_length=10.0, max_searches_of_well_constrained_pair=4)
    assert taken(few, 50.0) == 200


def test_searches_of_well_constrained_pairs_are_limited():
    few = counts(well_constrained_length=10.0, max_searches_of_well_constrained_pair=4)
    assert taken(few, 2.0) == 4
    assert few.has_enough_searches((0, 4), 2.0)
    assert not few.has_enough_searches((0, 4), 50.0)
    assert taken(few, 2.0, node_submap=5) == 4
    assert taken(few, 2.0, submap=1) == 4


def test_the_first_of_the_due_pairs_are_taken():
    few = counts(well_constrained_length=10.0, max_searches_of_well_constrained_pair=1)
    submaps, lengths = np.array((0, 0, 1, 0)), np.array((2.0, 2.0, 2.0, 50.0))
    assert few.take(submaps, np.full(4, 4), lengths).tolist() == [0, 2, 3]


def test_earlier_searches_of_well_constrained_pairs_count():
    few = counts(well_constrained_length=10.0, max_searches_of_well_constrained_pair=2)
    config = ConstraintSearchConfig()
    narrow, wide = config.min_linear_search_window, config.linear_search_window
    few.note_searched(np.array((0, 1)), np.array((4, 4)), np.array((narrow, wide)))
    assert taken(few, 2.0) == 1
    assert taken(few, 2.0, submap=1) == 2


def test_a_pair_with_enough_closures_is_not_searched():
    limited, found = counts(max_closures_of_pair=2), (np.array((0,)), np.array((4,)))
    limited.note_found(*found)
    assert taken(limited, 50.0) == 200
    limited.note_found(*found)
    assert limited.has_enough_closures((0, 4))
    assert taken(limited, 50.0) == 0
    assert taken(limited, 50.0, node_submap=5) == 200
