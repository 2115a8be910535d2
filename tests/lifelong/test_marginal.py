# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cartoloop.global_slam.pose_adjustment import AdjustmentOptions, adjust
from cartoloop.global_slam.pose_graph import ConstraintKind, PoseGraph
from cartoloop.lifelong.links import replacements
from cartoloop.lifelong.marginal import host_submaps, lost_information, touching
from cartoloop.lifelong.recovery import fitted_informations
from cartoloop.sensor.pose import relative_all
from tests.lifelong.graphs import random_graph, random_information
from tests.reference.naive_marginal import naive_hessian, naive_schur

NO_LOSS = AdjustmentOptions(robust_kinds=(), max_iterations=100, relative_tolerance=1e-14)


def _kept_nodes(graph, kept_submaps):
    return host_submaps(graph, kept_submaps) >= 0


def _dense_marginal(graph, constraints, kept):
    """Matrix and gradient of the submaps that stay, by dense matrices."""
    poses = np.concatenate((graph.submap_poses, graph.node_poses))

    def stand(changes):
        return poses.size if changes is None else poses + changes.reshape(-1, 3)

    axes = (3 * np.flatnonzero(kept)[:, None] + np.arange(3)).ravel()
    return naive_schur(*naive_hessian(graph, constraints, stand), axes)


@settings(max_examples=10, deadline=None)
@given(st.integers(0, 2**32 - 1), st.lists(st.booleans(), min_size=5, max_size=5))
def test_what_is_lost_equals_that_of_dense_matrices(seed, kept):
    kept = np.array(kept)
    if kept.all() or not kept.any():
        return
    graph = random_graph(np.random.default_rng(seed), num_submaps=5)
    kept_nodes = _kept_nodes(graph, kept)

    lost = lost_information(graph, kept, kept_nodes, np.ones(graph.num_constraints))

    staying = np.flatnonzero(~touching(graph, kept, kept_nodes))
    before, gradient = _dense_marginal(graph, range(graph.num_constraints), kept)
    after, gradient_after = _dense_marginal(graph, staying, kept)
    numbers = np.searchsorted(np.flatnonzero(kept), lost.submaps)
    axes = (3 * numbers[:, None] + np.arange(3)).ravel()
    scale = 1e3 + np.abs(before).max() + np.abs(after).max()
    expected, others = np.zeros_like(before), np.delete(gradient - gradient_after, axes)
    expected[np.ix_(axes, axes)] = lost.information  # nothing is lost about the others
    assert expected == pytest.approx(before - after, abs=1e-4 * scale)
    assert lost.gradient == pytest.approx((gradient - gradient_after)[axes], abs=1e-4 * scale)
    assert others == pytest.approx(np.zeros(len(others)), abs=1e-4 * scale)


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
    links.add_to(smaller)
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

    assert np.hypot(*(smaller.submap_poses - before)[kept, :2].T).max() < 1e-2


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
    # Four constraints, one after the other: a quarter of the information.
    assert links.information[0, 0, 0] == pytest.approx(100.0, rel=0.01)
    assert links.information[0, 1, 1] == pytest.approx(100.0, rel=0.01)


@pytest.mark.parametrize("seed", range(3))
def test_fitted_constraints_make_pairs_as_well_known(seed):
    rng = np.random.default_rng(seed)
    mean = rng.uniform(-3.0, 3.0, (4, 3))
    edges = np.array([(0, 1), (1, 2), (2, 3), (0, 2), (1, 3), (0, 3)])
    true = np.stack([random_information(rng, 1.0) for _ in edges])

    fitted = fitted_informations(mean, edges, _known(mean, edges, true), num_tree=3)

    assert _known(mean, edges, fitted) == pytest.approx(_known(mean, edges, true), rel=0.1)


def _known(mean, edges, informations):
    """Information of the relative poses, given constraints between the same pairs."""
    jacobians = np.zeros((len(edges), 3, mean.size))
    for jacobian, (one, other) in zip(jacobians, edges, strict=True):
        x, y, _ = mean[other] - mean[one]
        jacobian[:, 3 * one : 3 * one + 3] = [(-1, 0, y), (0, -1, -x), (0, 0, -1)]
        jacobian[:, 3 * other : 3 * other + 3] = np.eye(3)
    jacobians = jacobians[:, :, 3:]
    total = sum(j.T @ w @ j for j, w in zip(jacobians, informations, strict=True))
    return np.stack([np.linalg.inv(j @ np.linalg.inv(total) @ j.T) for j in jacobians])


def test_links_of_two_trimmings_are_merged():
    graph = _chain(np.random.default_rng(2), 5)
    graph.remove(graph.kinds == ConstraintKind.NODE_TO_NODE)
    kept = np.array([True, False, False, False, True])
    links = replacements(graph, kept, _kept_nodes(graph, kept), np.ones(graph.num_constraints), 1.0)
    once, twice = (_reduced(graph, kept, links) for _ in range(2))
    moved = links._replace(tf_a_b=links.tf_a_b + np.array((0.02, 0.0, 0.0)))

    moved.add_to(twice)

    assert twice.num_constraints == once.num_constraints
    assert twice.informations[-1] == pytest.approx(2.0 * once.informations[-1])
    expected = once.relative_poses[-1] + np.array((0.01, 0.0, 0.0))
    assert twice.relative_poses[-1] == pytest.approx(expected, abs=1e-6)
