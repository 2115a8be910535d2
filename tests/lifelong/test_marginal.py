# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cartoloop.global_slam.pose_adjustment import AdjustmentOptions, adjust
from cartoloop.global_slam.pose_graph import ConstraintKind, PoseGraph
from cartoloop.lifelong.marginal import (
    host_submaps,
    marginalized,
    replacements,
    touching,
)
from cartoloop.sensor.pose import Pose, compose, relative, relative_all
from tests.lifelong.graphs import random_graph
from tests.reference.naive_marginal import naive_hessian, naive_schur

NO_LOSS = AdjustmentOptions(robust_kinds=(), max_iterations=100, relative_tolerance=1e-14)


def _kept_nodes(graph, kept_submaps):
    return host_submaps(graph, kept_submaps) >= 0


def _stand(graph, kept_nodes, hosts):
    """Poses of all vertices, where nodes that stay are rigid parts of their submaps."""
    num_submaps = graph.num_submaps
    poses = np.concatenate((graph.submap_poses, graph.node_poses))
    free = [*range(num_submaps), *(num_submaps + np.flatnonzero(~kept_nodes))]

    def stand(changes):
        if changes is None:
            return 3 * len(free)
        moved = poses.copy()
        moved[free] += changes.reshape(-1, 3)
        for node in np.flatnonzero(kept_nodes):
            own = relative(Pose(*poses[hosts[node]]), Pose(*poses[num_submaps + node]))
            moved[num_submaps + node] = compose(Pose(*moved[hosts[node]]), own)
        return moved

    return stand


@settings(max_examples=10, deadline=None)
@given(st.integers(0, 2**32 - 1), st.lists(st.booleans(), min_size=6, max_size=6))
def test_marginals_equal_those_of_dense_matrices(seed, kept):
    kept = np.array(kept)
    if kept.all() or not kept.any():
        return
    graph = random_graph(np.random.default_rng(seed))
    kept_nodes, hosts = _kept_nodes(graph, kept), host_submaps(graph, kept)
    weights = np.ones(graph.num_constraints)

    marginal = marginalized(graph, kept, kept_nodes, hosts, weights)

    gone = np.flatnonzero(touching(graph, kept, kept_nodes))
    matrix, gradient = naive_hessian(graph, gone, _stand(graph, kept_nodes, hosts))
    axes = (3 * marginal.submaps[:, None] + np.arange(3)).ravel()
    expected, expected_gradient = naive_schur(matrix, gradient, axes)
    scale = np.abs(matrix).max()
    assert marginal.information == pytest.approx(expected, abs=2e-5 * scale)
    assert marginal.gradient == pytest.approx(expected_gradient, abs=2e-5 * scale)


def _chain(rng, num_submaps):
    """Submaps in a row: between neighbours one node, which was inserted into both."""
    return random_graph(rng, num_submaps, nodes_per_submap=1, num_closures=0)


@pytest.mark.parametrize("seed", range(5))
def test_a_removed_stretch_becomes_one_exact_link(seed):
    graph = _chain(np.random.default_rng(seed), 6)
    graph.remove(graph.kinds == ConstraintKind.NODE_TO_NODE)
    adjust(graph, NO_LOSS)
    kept = np.array([True, True, False, False, True, True])
    kept_nodes = _kept_nodes(graph, kept)

    links = replacements(graph, kept, kept_nodes, np.ones(graph.num_constraints), memory=1.0)

    assert len(links.node_a) == 1
    assert kept_nodes[links.node_a[0]]
    assert kept_nodes[links.node_b[0]]
    ends = graph.node_poses[links.node_a], graph.node_poses[links.node_b]
    assert links.tf_a_b == pytest.approx(relative_all(*ends), abs=1e-6)


def _reduced(graph, kept_submaps, links):
    """The graph without what was removed, all vertices kept."""
    kept_nodes = _kept_nodes(graph, kept_submaps)
    smaller = graph.without(touching(graph, kept_submaps, kept_nodes))
    smaller.add_constraints(
        ConstraintKind.NODE_TO_NODE, links.node_a, links.node_b, links.tf_a_b, links.information
    )
    return smaller


@pytest.mark.parametrize("seed", range(8))
def test_what_stays_stays_where_it_was(seed):
    rng = np.random.default_rng(seed)
    graph = random_graph(rng, num_submaps=8, num_closures=12)
    adjust(graph, NO_LOSS)
    kept = np.array([True, True, False, True, False, False, True, True])
    before = graph.submap_poses.copy()
    links = replacements(graph, kept, _kept_nodes(graph, kept), np.ones(graph.num_constraints), 1.0)

    smaller = _reduced(graph, kept, links)
    smaller.submap_poses[kept] += rng.normal(0.0, 0.01, (5, 3)) * (np.arange(5)[:, None] > 0)
    adjust(smaller, NO_LOSS)

    assert np.hypot(*(smaller.submap_poses - before)[kept, :2].T).max() < 5e-3


@pytest.mark.parametrize("seed", range(4))
def test_without_replacement_the_graph_would_fall_apart(seed):
    graph = _chain(np.random.default_rng(seed), 5)
    graph.remove(graph.kinds == ConstraintKind.NODE_TO_NODE)
    kept = np.array([True, False, False, False, True])
    links = replacements(graph, kept, _kept_nodes(graph, kept), np.ones(graph.num_constraints), 1.0)
    smaller = _reduced(graph, kept, links)
    moved = smaller.submap_poses[4].copy()
    smaller.submap_poses[4] += (5.0, 1.0, 0.3)

    adjust(smaller, NO_LOSS)

    assert smaller.submap_poses[4] == pytest.approx(moved, abs=0.02)


def test_memory_scales_the_information():
    graph = _chain(np.random.default_rng(1), 5)
    kept = np.array([True, False, False, False, True])
    nodes, weights = _kept_nodes(graph, kept), np.ones(graph.num_constraints)
    full, half = (replacements(graph, kept, nodes, weights, memory) for memory in (1.0, 0.5))
    assert half.information == pytest.approx(full.information / 2)


def test_a_link_is_as_certain_as_the_path_that_it_replaces():
    graph = PoseGraph()
    graph.add_submaps([(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (2.0, 0.0, 0.0)])
    graph.add_nodes([(0.0, 0.0, 0.0), (0.5, 0.0, 0.0), (1.5, 0.0, 0.0), (2.0, 0.0, 0.0)])
    information = np.diag((400.0, 400.0, 1e8))
    for submap, node in ((0, 0), (0, 1), (1, 1), (1, 2), (2, 2), (2, 3)):
        place = graph.node_poses[node] - graph.submap_poses[submap]
        graph.add_constraint(ConstraintKind.INTRA_SUBMAP, submap, node, place, information)
    kept = np.array([True, False, True])
    links = replacements(
        graph, kept, _kept_nodes(graph, kept), np.ones(graph.num_constraints), memory=1.0
    )
    # Two constraints of the removed submap, one after the other: half the information.
    assert links.information[0, 0, 0] == pytest.approx(200.0, rel=0.01)
    assert links.information[0, 1, 1] == pytest.approx(200.0, rel=0.01)
