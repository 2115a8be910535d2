# SPDX-License-Identifier: Apache-2.0
"""Synthetic graphs have the requested size and noise, and are reproducible."""

import numpy as np
import pytest

from bench.adjustment.problem import Problem
from bench.adjustment.synthetic_graphs import (
    INFORMATION,
    NOISE,
    bipartite_graph,
)
from cartoloop.errors import InputError
from cartoloop.global_slam.pose_adjustment import AdjustmentOptions, adjust
from cartoloop.global_slam.pose_graph import ConstraintKind
from cartoloop.pose_adjustment import Loss
from cartoloop.sensor.pose import relative_all

SIZE = (2_000, 22, 6_200)


@pytest.fixture(scope="module")
def made():
    return bipartite_graph(*SIZE, seed=3)


def test_graph_has_the_requested_size(made):
    graph = made.graph
    assert (graph.num_nodes, graph.num_submaps, graph.num_constraints) == SIZE


def test_nodes_are_in_two_submaps_or_in_the_first_one(made):
    graph = made.graph
    intra = graph.kinds == ConstraintKind.INTRA_SUBMAP
    memberships = np.bincount(graph.index_b[intra], minlength=graph.num_nodes)
    num_in_first = np.count_nonzero(memberships == 1)
    assert set(memberships) == {1, 2}
    assert 1 <= num_in_first <= 1 + graph.num_nodes // graph.num_submaps


def test_closures_are_local_and_not_between_neighbours_in_time(made):
    graph = made.graph
    closing = graph.kinds == ConstraintKind.LOOP_CLOSURE
    far = np.hypot(*(made.submaps[graph.index_a] - made.nodes[graph.index_b])[closing, :2].T)
    extent = np.hypot(*np.ptp(made.nodes[:, :2], axis=0))
    assert np.count_nonzero(closing) > 0.3 * graph.num_nodes
    assert np.median(far) < 0.3 * extent
    own_submap = graph.index_b[closing] * graph.num_submaps // graph.num_nodes
    assert np.all(np.abs(own_submap - graph.index_a[closing]) > 1)
    pairs = graph.index_a[closing] * graph.num_nodes + graph.index_b[closing]
    assert np.unique(pairs).size == pairs.size


def test_consecutive_nodes_are_a_step_apart(made):
    steps = np.hypot(*np.diff(made.nodes[:, :2], axis=0).T)
    assert steps.max() < 0.21
    assert np.median(steps) > 0.19


def test_equal_arguments_give_equal_bytes(made):
    again, other = bipartite_graph(*SIZE, seed=3).graph, bipartite_graph(*SIZE, seed=4).graph
    for name in ("node_poses", "submap_poses", "index_a", "index_b", "relative_poses"):
        assert getattr(again, name).tobytes() == getattr(made.graph, name).tobytes()
    assert other.relative_poses.tobytes() != made.graph.relative_poses.tobytes()


def test_the_cost_at_the_truth_is_that_of_the_noise(made):
    truth = np.concatenate((made.submaps, made.nodes))
    per_edge = 2.0 * INFORMATION[0] * NOISE[0] ** 2 + INFORMATION[1] * NOISE[1] ** 2
    expected = 0.5 * made.graph.num_constraints * per_edge
    problem = Problem.of(bipartite_graph(*SIZE, seed=3).graph, AdjustmentOptions(loss=Loss.NONE))
    assert problem.cost(truth) == pytest.approx(expected, rel=0.05)


def test_adjustment_moves_the_start_to_the_truth():
    made = bipartite_graph(*SIZE, seed=5)
    before = np.hypot(*(made.graph.node_poses - made.nodes)[:, :2].T).max()
    assert adjust(made.graph).converged
    after = np.hypot(*(made.graph.node_poses - made.nodes)[:, :2].T).max()
    assert after < 0.1
    assert before > 3.0 * after


def test_without_noise_and_drift_the_measurements_are_the_truth():
    made = bipartite_graph(300, 6, 700, noise=(0.0, 0.0), drift=(0.0, 0.0))
    graph = made.graph
    seen = relative_all(made.submaps[graph.index_a], made.nodes[graph.index_b])
    np.testing.assert_allclose(graph.relative_poses, seen, atol=1e-12)
    np.testing.assert_allclose(graph.submap_poses, made.submaps, atol=1e-9)
    np.testing.assert_allclose(graph.node_poses, made.nodes, atol=1e-9)


@pytest.mark.parametrize(
    ("size", "message"),
    [
        ((10, 11, 30), "11 submaps of 10 nodes"),
        ((100, 5, 150), "give at least 180"),
        ((100, 5, 5_000), "are possible"),
    ],
)
def test_impossible_sizes_are_refused(size, message):
    with pytest.raises(InputError, match=message):
        bipartite_graph(*size)
