# SPDX-License-Identifier: Apache-2.0
"""A chordal start is near the true poses for any poses of the graph."""

import numpy as np
import pytest

from bench.adjustment.chordal_initialization import initialize_from_constraints
from cartoloop.global_slam.pose_graph import PoseGraph
from cartoloop.sensor.pose import wrap_angles
from tests.global_slam.bipartite_graph import walk

EXACT = {"noise": (0.0, 0.0), "drift": (0.3, 0.05)}


@pytest.mark.parametrize("num_odometry", [0, 20])
def test_chordal_start_does_not_depend_on_the_poses(num_odometry):
    graph, submaps, nodes = walk(120, 8, 60, **EXACT, seed=4, num_odometry=num_odometry)
    rng = np.random.default_rng(0)
    graph.submap_poses[1:] = rng.normal(0.0, 30.0, graph.submap_poses[1:].shape)
    graph.node_poses[:] = rng.normal(0.0, 30.0, graph.node_poses.shape)
    initialize_from_constraints(graph)
    np.testing.assert_allclose(graph.submap_poses[:, :2], submaps[:, :2], atol=0.2)
    np.testing.assert_allclose(graph.node_poses[:, :2], nodes[:, :2], atol=0.2)
    np.testing.assert_allclose(wrap_angles(graph.node_poses[:, 2] - nodes[:, 2]), 0.0, atol=0.05)


def test_chordal_start_of_an_empty_graph_is_empty():
    graph = PoseGraph()
    initialize_from_constraints(graph)
    assert graph.num_nodes == 0
