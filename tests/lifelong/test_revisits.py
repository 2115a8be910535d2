# SPDX-License-Identifier: Apache-2.0
"""A submap was driven through again if later nodes lie where most of its own do."""

from __future__ import annotations

import numpy as np

from cartoloop.global_slam.pose_graph import ConstraintKind, PoseGraph
from cartoloop.lifelong.revisits import driven_again


def graph_of(*paths):
    """A graph with a submap for each path of nodes."""
    graph = PoseGraph()
    for submap, path in enumerate(paths):
        graph.add_submap((0.0, 0.0, 0.0))
        for x, y in path:
            node = graph.add_node((x, y, 0.0))
            graph.add_constraint(ConstraintKind.INTRA_SUBMAP, submap, node, (x, y, 0.0), np.eye(3))
    return graph


def row(first, last, y=0.0):
    return [(x, y) for x in np.arange(first, last, 0.5)]


def again(graph, first_nodes, sessions, parts=None, distance=3.0):
    parts = np.zeros(graph.num_nodes, int) if parts is None else np.array(parts)
    return driven_again(graph, first_nodes, np.array(sessions), parts, distance).tolist()


def test_only_a_path_that_is_driven_again_counts():
    first, second, later = row(0, 10), row(20, 30), row(0, 12, y=1.0)
    graph = graph_of(first, second, later)
    assert again(graph, [0, 40], [0, 0, 1]) == [True, False, False]


def test_half_of_the_nodes_are_enough():
    first = row(0, 10)
    for end, expected in ((4.5, True), (1.0, False)):
        graph = graph_of(first, row(0, end - 2.5))
        assert again(graph, [0, len(first)], [0, 1])[0] is expected


def test_what_was_seen_from_afar_was_not_driven_through():
    graph = graph_of(row(0, 10), row(0, 10, y=3.5))
    assert again(graph, [0, 20], [0, 1]) == [False, False]
    assert again(graph, [0, 20], [0, 1], distance=4.0) == [True, False]


def test_parts_that_are_apart_do_not_count():
    graph = graph_of(row(0, 10), row(0, 10))
    assert again(graph, [0, 20], [0, 1], parts=[0] * 20 + [1] * 20) == [False, False]


def test_a_submap_without_nodes_stays():
    graph = graph_of(row(0, 10), [], row(0, 10))
    assert again(graph, [0, 20], [0, 0, 1]) == [True, False, False]
