# SPDX-License-Identifier: Apache-2.0
"""Which pairs are searched, in how large a window, and why others are not."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cartoloop.config import ConstraintSearchConfig, WideSearchConfig
from cartoloop.global_slam.pair_selection import PairSelection, SubmapPaths
from cartoloop.global_slam.pair_verdict import WhyNot
from cartoloop.global_slam.pose_graph import ConstraintKind, PoseGraph
from cartoloop.global_slam.search_windows import path_length_of, windows
from cartoloop.global_slam.submap_paths import LOST_M
from cartoloop.sensor.pose import Pose
from cartoloop.submaps.node import Node

CONFIG = ConstraintSearchConfig(
    linear_search_window=7.0,
    angular_search_window_deg=30.0,
    min_linear_search_window=0.5,
    min_angular_search_window_deg=5.0,
    linear_drift=0.05,
    angular_drift_deg=0.5,
    well_constrained_length=10.0,
    every_nth_node=3,
    every_nth_well_constrained_node=7,
    max_searches_of_well_constrained_pair=4,
    max_closures_of_pair=2,
)
NO_CLOSURES = np.zeros((0, 2), dtype=np.int64)


CLOSURE_LENGTH_M = CONFIG.closure_path_length


def paths(travelled, closures=NO_CLOSURES, inside=None):
    ends = np.array(closures).reshape(-1, 2)
    inside = np.zeros(len(ends)) if inside is None else np.array(inside)
    return SubmapPaths(CONFIG, np.array(travelled, dtype=np.float64), ends, inside)


def test_the_window_grows_with_the_path_length():
    linear, angular = windows(CONFIG, np.array((0.0, 20.0)))
    assert linear == pytest.approx([0.5, 1.5])
    assert angular == pytest.approx(np.radians((5.0, 15.0)))


@settings(deadline=None, max_examples=60)
@given(lengths=st.lists(st.floats(0.0, 1e5), min_size=2, max_size=5))
def test_windows_stay_within_their_limits(lengths):
    linear, angular = windows(CONFIG, np.sort(lengths))
    assert (linear >= 0.5).all()
    assert (linear <= 7.0).all()
    assert (angular >= math.radians(5.0)).all()
    assert (angular <= math.radians(30.0) + 1e-12).all()
    assert (np.diff(linear) >= 0.0).all()
    assert (np.diff(angular) >= 0.0).all()


def test_the_path_length_follows_from_the_window():
    for length in (0.0, 20.0):
        linear, angular = windows(CONFIG, np.array((length,)))
        assert path_length_of(CONFIG, linear[0], angular[0]) == pytest.approx(length)
    assert path_length_of(CONFIG, linear[0], 1.1 * angular[0]) is None


def test_before_the_first_adjustment_no_path_is_known():
    assert len(SubmapPaths(CONFIG).lengths_from(0)) == 0


def test_without_closures_paths_follow_the_robot():
    assert paths([0.0, 9.0, 18.0, 28.0]).lengths_from(1) == pytest.approx([9.0, 0.0, 9.0, 19.0])


def test_a_closure_shortens_paths():
    known = paths([0.0, 9.0, 18.0, 27.0, 36.0], [(0, 4)])
    closure = CLOSURE_LENGTH_M
    assert known.lengths_from(0) == pytest.approx([0.0, 9.0, 18.0, 9.0 + closure, closure])
    assert known.lengths_from(1) == pytest.approx([9.0, 0.0, 9.0, 18.0, 9.0 + closure])


def test_the_path_inside_the_submap_of_the_node_counts():
    known = paths([0.0, 9.0, 18.0, 27.0], [(0, 3), (0, 3)], inside=[5.0, 2.0])
    assert known.lengths_from(0)[3] == pytest.approx(CLOSURE_LENGTH_M + 2.0)


def test_closures_count_once_and_in_both_directions():
    once = paths([0.0, 9.0, 18.0, 27.0], [(0, 3)])
    often = paths([0.0, 9.0, 18.0, 27.0], [(0, 3), (3, 0), (0, 3), (2, 2)])
    for submap in range(4):
        assert often.lengths_from(submap) == pytest.approx(once.lengths_from(submap))


def test_submaps_since_the_last_adjustment_are_unknown():
    assert len(paths([0.0, 9.0], [(0, 1)]).lengths_from(2)) == 0


@pytest.mark.parametrize("num_submaps", [1, 2])
def test_few_submaps_are_no_error(num_submaps):
    assert paths(9.0 * np.arange(num_submaps)).lengths_from(0)[0] == 0.0


@settings(deadline=None, max_examples=40)
@given(data=st.data(), num_submaps=st.integers(2, 8))
def test_the_shortest_path_is_taken(data, num_submaps):
    steps = data.draw(
        st.lists(st.floats(0.1, 6.0), min_size=num_submaps - 1, max_size=num_submaps - 1)
    )
    # Closures between neighbours are left to the path between these.
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

    known = paths(travelled, np.array(closures, dtype=np.int64).reshape(-1, 2))

    for submap in range(num_submaps):
        assert known.lengths_from(submap) == pytest.approx(shortest[submap])


WALK_CONFIG = ConstraintSearchConfig(
    every_nth_node=1,
    every_nth_well_constrained_node=1,
    well_constrained_length=0.0,
    max_constraint_distance=1.5,
    min_linear_search_window=1.0,
    linear_search_window=100.0,
    linear_drift=1.0,
    min_num_points=1,
    sparse_drift=1.0,
    wide_search=WideSearchConfig(min_path_length=1e3),
)
NODES_A_SUBMAP = 10
ROUND = 40
"""Nodes of one round along the sides of a square, a metre apart."""


def place(node):
    side, step = divmod(node % ROUND, ROUND // 4)
    corner = [(0.0, 0.0), (10.0, 0.0), (10.0, 10.0), (0.0, 10.0)][side]
    along = [(1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0)][side]
    return Pose(corner[0] + step * along[0], corner[1] + step * along[1], 0.0)


class Walk:
    """Two rounds; each node is in one submap, which is begun where its first node stands."""

    def __init__(self, num_nodes=2 * ROUND, num_points=3, lost_at=-1, **changes):
        self.lost_at = lost_at
        self.graph = PoseGraph()
        self.pairs = PairSelection(WALK_CONFIG.model_copy(update=changes))
        self.go_on(num_nodes, num_points)

    def go_on(self, num_nodes, num_points=3):
        """Walk until there are `num_nodes`."""
        for k in range(self.graph.num_nodes, num_nodes):
            index = k // NODES_A_SUBMAP
            if k % NODES_A_SUBMAP == 0:
                self.graph.add_submap(place(k))
            self.graph.add_node(place(k))
            submaps = (SimpleNamespace(index=index),)
            points = np.zeros((num_points, 2))
            known = np.diag((4.0, 4.0, 1.0)) if k == self.lost_at else 1e4 * np.eye(3)
            self.pairs.add_node(Node(k, 0.1 * k, place(k), points, submaps, known, None))

    def close(self, *closures, are_trusted=False):
        """Note loop closures, pairs of submap and node, that hold."""
        submaps, nodes = np.array(closures).T
        count = len(closures)
        first = self.graph.add_constraints(
            ConstraintKind.LOOP_CLOSURE,
            submaps,
            nodes,
            np.zeros((count, 3)),
            [np.eye(3)] * count,
            is_trusted=are_trusted,
        )
        self.pairs.note_adjusted(self.graph, np.arange(first, first + count))

    def window(self, submap, node):
        """Return the search window radius of a node in a submap [m]."""
        found = self.pairs.of_node(self.graph, node, 4)
        [alone] = found.linear_window[found.submap == submap]
        other = self.pairs.in_submap(self.graph, submap)
        [same] = other.linear_window[other.node == node]
        assert same == pytest.approx(alone)
        return alone


def test_nodes_are_searched_in_other_submaps_nearby():
    walk = Walk()
    assert walk.pairs.of_node(walk.graph, 40, 4).submap.tolist() == [0]
    assert walk.pairs.in_submap(walk.graph, 0).node.tolist() == [39, 40, 41, 79]


def test_scans_with_few_points_are_not_searched():
    assert len(Walk(num_points=0).pairs.of_node(Walk().graph, 40, 4).node) == 0


def test_without_closures_the_window_is_for_the_whole_path():
    assert Walk().window(submap=0, node=41) == pytest.approx(1.0 + 41.0)


def test_a_gap_in_which_the_robot_was_lost_is_a_long_path():
    walk = Walk(lost_at=20)
    assert walk.pairs.path_length(walk.graph, 1, 19) == pytest.approx(9.0)
    assert walk.pairs.path_length(walk.graph, 1, 30) == pytest.approx(LOST_M + 20.0)
    assert walk.pairs.verdict(walk.graph, 1, 30).path_length == pytest.approx(20.0)


@pytest.mark.parametrize("are_trusted", [False, True])
def test_only_closures_that_are_trusted_end_such_a_path(are_trusted):
    walk = Walk(lost_at=20)
    walk.close((0, 42), are_trusted=are_trusted)
    length = walk.pairs.path_length(walk.graph, 0, 41)
    assert length == pytest.approx(CLOSURE_LENGTH_M + 3.0 if are_trusted else LOST_M + 41.0)
    # One between submaps on one side of the gap is no such closure.
    walk.close((2, 62), are_trusted=are_trusted)
    assert walk.pairs.path_length(walk.graph, 2, 61) == pytest.approx(CLOSURE_LENGTH_M + 3.0)


def test_a_closure_of_the_own_submap_shortens_the_path():
    walk = Walk()
    walk.close((0, 42))
    there = 1.0 + CLOSURE_LENGTH_M + 2.0
    assert walk.window(submap=0, node=40) == pytest.approx(1.0 + there - 1.0)


@pytest.mark.parametrize("closed", [47, 51])
def test_the_path_begins_at_the_nearest_closed_node(closed):
    walk = Walk()
    walk.close((1, closed))
    assert walk.window(submap=1, node=49) == pytest.approx(1.0 + 2.0 + CLOSURE_LENGTH_M)


def test_from_there_the_path_follows_the_first_round():
    walk = Walk()
    walk.close((0, 48))
    assert walk.window(submap=1, node=49) == pytest.approx(1.0 + 1.0 + CLOSURE_LENGTH_M + 10.0)


def test_the_nearer_of_two_closed_nodes_counts():
    walk = Walk()
    walk.close((1, 52), (1, 46))
    assert walk.window(submap=1, node=50) == pytest.approx(1.0 + 2.0 + CLOSURE_LENGTH_M)
    by_the_own_submap = 1.0 + 2.0 + CLOSURE_LENGTH_M
    assert walk.window(submap=1, node=51) == pytest.approx(1.0 + by_the_own_submap)


def test_in_a_new_submap_only_the_path_travelled_counts():
    walk = Walk(num_nodes=45)
    walk.close((0, 44))
    walk.go_on(2 * ROUND)
    by_the_own_submap = 1.0 + 4.0 + CLOSURE_LENGTH_M
    assert walk.window(submap=0, node=41) == pytest.approx(1.0 + by_the_own_submap)
    assert walk.window(submap=1, node=51) == pytest.approx(1.0 + 41.0)
    requests = walk.pairs.in_submap(walk.graph, 5)  # of the nodes 50 to 59
    [back] = requests.linear_window[requests.node == 10]
    assert back == pytest.approx(1.0 + 40.0)


def test_windows_do_not_depend_on_the_order_of_the_closures():
    one, other = Walk(), Walk()
    one.close((0, 41), (1, 52), (1, 46))
    other.close((1, 46), (0, 41), (1, 52))
    for node in (49, 50, 51):
        assert one.window(1, node) == other.window(1, node)


def verdict(walk, submap, node):
    return walk.pairs.verdict(walk.graph, submap, node)


def strict_walk(**changes):
    walk = Walk(num_nodes=0)
    walk.pairs = PairSelection(WALK_CONFIG.model_copy(update=changes))
    walk.go_on(2 * ROUND)
    return walk


def test_a_pair_with_enough_closures_is_not_requested():
    walk = strict_walk(max_closures_of_pair=2)
    found = np.array((0,)), np.array((40,))
    walk.pairs.note_found(*found)
    assert 0 in walk.pairs.of_node(walk.graph, 41, 4).submap
    walk.pairs.note_found(*found)
    assert 0 not in walk.pairs.of_node(walk.graph, 41, 4).submap
    assert verdict(walk, 0, 40).why_not == WhyNot.ENOUGH_CLOSURES


def test_every_pair_is_requested_or_has_a_reason():
    walk = strict_walk(every_nth_node=3, every_nth_well_constrained_node=2)
    walk.close((0, 45))
    wanted = {
        (submap, node)
        for node in range(2 * ROUND)
        for submap in walk.pairs.of_node(walk.graph, node, 4).submap.tolist()
    }
    assert len(wanted) >= 5
    for node in range(2 * ROUND):
        for submap in range(4):
            assert (verdict(walk, submap, node).why_not is None) == ((submap, node) in wanted)


def test_reasons_name_the_rule():
    walk = strict_walk(every_nth_node=2)
    assert verdict(walk, 0, 5).why_not == WhyNot.OWN_SUBMAP
    assert verdict(walk, 0, 15).why_not == WhyNot.TOO_FAR
    assert verdict(walk, 0, 41).why_not == WhyNot.EVERY_NTH_NODE
    assert verdict(walk, 0, 40).why_not is None
    assert verdict(walk, 0, 40).path_length == pytest.approx(40.0)
    assert verdict(walk, 0, 40).distance == pytest.approx(0.0)
    sparse = Walk(num_points=0)
    assert verdict(sparse, 0, 40).why_not == WhyNot.FEW_POINTS
    many = strict_walk(well_constrained_length=99.0, every_nth_well_constrained_node=7)
    assert verdict(many, 0, 41).why_not == WhyNot.WELL_CONSTRAINED
    limited = strict_walk(well_constrained_length=99.0, max_searches_of_well_constrained_pair=0)
    assert verdict(limited, 0, 40).why_not == WhyNot.ENOUGH_SEARCHES


def test_paths_between_sparse_scans_count_for_more():
    dense, sparse = Walk(), Walk(sparse_drift=2.5)
    for node in (25, 40):
        length = dense.pairs.path_length(dense.graph, 0, node)
        assert sparse.pairs.path_length(sparse.graph, 0, node) == pytest.approx(2.5 * length)
