# SPDX-License-Identifier: Apache-2.0
"""Where nodes are sought, and in how large a window: a robot that comes back to where it began."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from cartoloop.config import ConstraintSearchConfig
from cartoloop.global_slam.pair_selection import CLOSURE_LENGTH_M
from cartoloop.global_slam.pose_graph import ConstraintKind, PoseGraph
from cartoloop.global_slam.search_requests import SearchRequests
from cartoloop.sensor.pose import Pose
from cartoloop.submaps.node import Node

CONFIG = ConstraintSearchConfig(
    every_nth_node=1,
    every_nth_bound_node=1,
    bound_length=0.0,
    max_constraint_distance=1.5,
    min_linear_search_window=1.0,
    linear_search_window=100.0,
    linear_drift=1.0,
    min_num_points=1,
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

    def __init__(self, num_nodes=2 * ROUND, num_points=3):
        self.graph = PoseGraph()
        self.requests = SearchRequests(CONFIG)
        self.go_on(num_nodes, num_points)

    def go_on(self, num_nodes, num_points=3):
        """Walk until there are so many nodes."""
        for k in range(self.graph.num_nodes, num_nodes):
            index = k // NODES_A_SUBMAP
            if k % NODES_A_SUBMAP == 0:
                self.graph.add_submap(place(k))
            self.graph.add_node(place(k))
            submaps = (SimpleNamespace(index=index),)
            points = np.zeros((num_points, 2))
            self.requests.add_node(Node(k, 0.1 * k, place(k), points, submaps, np.eye(3), None))

    def close(self, *closures):
        """Tell of loop closures, pairs of submap and node, that hold."""
        submaps, nodes = np.array(closures).T
        count = len(closures)
        first = self.graph.add_constraints(
            ConstraintKind.LOOP_CLOSURE, submaps, nodes, np.zeros((count, 3)), [np.eye(3)] * count
        )
        self.requests.note_adjusted(self.graph, np.arange(first, first + count))

    def window(self, submap, node):
        """Return how far each way a node is sought in a submap [m]."""
        found = self.requests.of_node(self.graph, node, 4)
        [alone] = found.linear_window[found.submap == submap]
        other = self.requests.in_submap(self.graph, submap)
        [same] = other.linear_window[other.node == node]
        assert same == pytest.approx(alone)
        return alone


def test_nodes_are_sought_in_the_submaps_nearby_that_they_are_not_in():
    walk = Walk()
    assert walk.requests.of_node(walk.graph, 40, 4).submap.tolist() == [0]
    assert walk.requests.in_submap(walk.graph, 0).node.tolist() == [39, 40, 41, 79]


def test_scans_with_few_points_are_not_sought():
    assert len(Walk(num_points=0).requests.of_node(Walk().graph, 40, 4).node) == 0


def test_without_closures_the_window_is_for_the_whole_way():
    assert Walk().window(submap=0, node=41) == pytest.approx(1.0 + 41.0)


def test_a_closure_of_the_nodes_own_submap_leaves_the_way_within_it():
    walk = Walk()
    walk.close((0, 49))
    assert walk.window(submap=0, node=41) == pytest.approx(1.0 + CLOSURE_LENGTH_M + 1.0)


@pytest.mark.parametrize("closed", [47, 51])
def test_the_way_begins_at_the_nearest_node_that_closed_a_loop(closed):
    walk = Walk()
    walk.close((1, closed))
    assert walk.window(submap=1, node=49) == pytest.approx(1.0 + 2.0 + CLOSURE_LENGTH_M)


def test_from_there_it_leads_on_along_the_first_round():
    walk = Walk()
    walk.close((0, 48))
    assert walk.window(submap=1, node=49) == pytest.approx(1.0 + 1.0 + CLOSURE_LENGTH_M + 10.0)


def test_of_two_nodes_that_closed_loops_the_nearer_counts():
    walk = Walk()
    walk.close((1, 52), (1, 46))
    assert walk.window(submap=1, node=50) == pytest.approx(1.0 + CLOSURE_LENGTH_M)
    assert walk.window(submap=1, node=51) == pytest.approx(1.0 + 1.0 + CLOSURE_LENGTH_M)


def test_in_a_submap_begun_since_only_the_way_travelled_is_known():
    walk = Walk(num_nodes=45)
    walk.close((0, 44))
    walk.go_on(2 * ROUND)
    assert walk.window(submap=0, node=41) == pytest.approx(1.0 + 1.0 + CLOSURE_LENGTH_M)
    assert walk.window(submap=1, node=51) == pytest.approx(1.0 + 41.0)
    requests = walk.requests.in_submap(walk.graph, 5)  # of the nodes 50 to 59
    [back] = requests.linear_window[requests.node == 10]
    assert back == pytest.approx(1.0 + 40.0)


def test_windows_do_not_depend_on_the_order_of_the_closures():
    one, other = Walk(), Walk()
    one.close((0, 41), (1, 52), (1, 46))
    other.close((1, 46), (0, 41), (1, 52))
    for node in (49, 50, 51):
        assert one.window(1, node) == other.window(1, node)
