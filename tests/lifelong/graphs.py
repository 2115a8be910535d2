# SPDX-License-Identifier: Apache-2.0
"""Pose graphs of submaps in a row, each of the nodes inserted into two of them."""

from __future__ import annotations

import numpy as np

from cartoloop.global_slam.pose_graph import ConstraintKind, PoseGraph
from cartoloop.sensor.pose import relative_all


def random_information(rng, scale=1e3):
    factor = rng.normal(size=(3, 3))
    return scale * (factor @ factor.T + 0.5 * np.eye(3))


def random_graph(rng, num_submaps=6, nodes_per_submap=2, num_closures=6, noise=1e-3):
    """A graph whose constraints are violated by noise [m, rad]."""
    graph = PoseGraph()
    graph.add_submaps(rng.uniform(-3.0, 3.0, (num_submaps, 3)))
    graph.add_nodes(rng.uniform(-3.0, 3.0, (num_submaps * nodes_per_submap, 3)))
    graph.fix_submap(0)
    pairs = []
    for node in range(graph.num_nodes):
        first = node // nodes_per_submap
        pairs += [(0, submap, node) for submap in (first, first + 1) if submap < num_submaps]
    for _ in range(num_closures):
        submap, node = int(rng.integers(num_submaps)), int(rng.integers(graph.num_nodes))
        if abs(node // nodes_per_submap - submap) > 1:
            pairs.append((1, submap, node))
    pairs.append((2, 0, graph.num_nodes - 1))
    for kind, a, b in pairs:
        begin = (
            graph.node_poses[a] if kind == ConstraintKind.NODE_TO_NODE else graph.submap_poses[a]
        )
        seen = relative_all(begin[None], graph.node_poses[b][None])[0]
        measured = seen + rng.normal(0.0, noise, 3)
        graph.add_constraint(ConstraintKind(kind), a, b, measured, random_information(rng))
    return graph
